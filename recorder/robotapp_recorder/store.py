"""The bags of one recording in its folder: begun, split, repaired and deleted."""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from robotapp_recorder.bags import CHUNK_BYTES, MESSAGE_HEAD_BYTES, BagWriter, repair
from robotapp_recorder.retention import Bag, choose_deleted

CLOSED: Final = ".mcap"
OPEN: Final = ".mcap.open"
_REPAIRED: Final = ".mcap.repaired"
_NUMBER: Final = re.compile(r"-(\d{6})-[^-]*$")
_CHUNKS_PER_SPLIT: Final = 4
"""A chunk is at most this part of a bag, so that small bags keep near their size."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of one bag, and of all together."""

    split_bytes: int
    retain_bytes: int
    split_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic as every bag holds it."""

    topic: str
    type_name: str
    definition: str | None
    qos: str


class BagStore:
    """The folder of one recording. `name` begins the name of every bag; a number orders them, because a robot's clock may jump."""

    def __init__(self, folder: Path, name: str, limits: Limits, *, clock_ns: Callable[[], int] = time.time_ns) -> None:
        self._folder = folder
        self._name = name
        self._limits = limits
        self._clock_ns = clock_ns
        self._channels: dict[str, Channel] = {}
        self._writer: BagWriter | None = None

    def open(self) -> list[str]:
        """Makes the folder, and completes the bags that a killed recorder left. Returns a line for each of them.

        Until the one without an end is deleted, its copy exceeds the bound, by at most a split.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        for path in self._folder.glob(f"*{_REPAIRED}"):
            path.unlink()
        lines = []
        for path in sorted(self._folder.glob(f"*{OPEN}")):
            target = path.with_name(path.name.removesuffix(OPEN) + _REPAIRED)
            count = repair(path, target)
            if count:
                target.rename(path.with_name(path.name.removesuffix(OPEN) + CLOSED))
            else:
                target.unlink()
            path.unlink()
            lines.append(f"{path.name.removesuffix(OPEN)}: {count} messages of a recorder that was killed are kept")
        return lines

    def add_channel(self, channel: Channel) -> None:
        """Adds a topic to the open bag and to all later ones."""
        self._channels[channel.topic] = channel
        if self._writer is not None:
            self._write_channel(self._writer, channel)

    def add_message(self, topic: str, data: bytes, *, published_ns: int, sequence: int = 0) -> None:
        """Writes a message, into a new bag where the open one is full."""
        now_ns = self._clock_ns()
        writer = self._writer
        if writer is None or self._is_full(writer, len(data) + MESSAGE_HEAD_BYTES, now_ns):
            writer = self._begin()
        writer.add_message(topic, data, received_ns=now_ns, published_ns=published_ns, sequence=sequence)

    def pass_time(self) -> None:
        """Closes the open chunk where it is old. To be called about once a second."""
        if self._writer is not None:
            self._writer.close_old_chunk()

    def close(self) -> None:
        """Completes the open bag."""
        if self._writer is not None:
            self._writer.close()
            path = self._writer.path
            path.rename(path.with_name(path.name.removesuffix(OPEN) + CLOSED))
            self._writer = None

    def abandon(self) -> None:
        """Leaves the open bag without an end; the next `open` completes it."""
        if self._writer is not None:
            self._writer.abandon()
            self._writer = None

    def _is_full(self, writer: BagWriter, more_bytes: int, now_ns: int) -> bool:
        if writer.is_empty:
            return False
        limits = self._limits
        is_old = limits.split_ns is not None and now_ns - writer.began_ns >= limits.split_ns
        return is_old or writer.size_bytes + more_bytes > limits.split_bytes

    def _begin(self) -> BagWriter:
        self.close()
        number = self._next_number()  # before the last bag may be deleted
        self._make_room()
        began = datetime.fromtimestamp(self._clock_ns() / 1e9, tz=UTC)
        path = self._folder / f"{self._name}-{number:06d}-{began:%Y%m%dT%H%M%SZ}{OPEN}"
        chunk_bytes = min(CHUNK_BYTES, self._limits.split_bytes // _CHUNKS_PER_SPLIT)
        self._writer = BagWriter(path, clock_ns=self._clock_ns, chunk_bytes=chunk_bytes)
        for channel in self._channels.values():
            self._write_channel(self._writer, channel)
        return self._writer

    def _make_room(self) -> None:
        bags = [Bag(path.name, path.stat().st_size) for path in self._folder.glob(f"*{CLOSED}")]
        limits = self._limits
        for bag in choose_deleted(bags, retain_bytes=limits.retain_bytes, split_bytes=limits.split_bytes):
            (self._folder / bag.name).unlink()

    def _next_number(self) -> int:
        numbers = (_NUMBER.search(path.name.split(".", 1)[0]) for path in self._folder.glob("*.mcap*"))
        return max((int(number[1]) for number in numbers if number), default=0) + 1

    def _write_channel(self, writer: BagWriter, channel: Channel) -> None:
        writer.add_channel(channel.topic, channel.type_name, channel.definition, channel.qos)
