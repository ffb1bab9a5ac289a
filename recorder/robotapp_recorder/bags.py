"""One bag: an MCAP file that is written in chunks, each of which is on disk when it is complete."""

import os
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, Writer

PROFILE: Final = "ros2"
CHUNK_BYTES: Final = 1 << 20
CHUNK_NS: Final = 1_000_000_000
"""A chunk is closed after this time, also if little is in it: a recorder that is killed loses at most the open chunk."""
MESSAGE_HEAD_BYTES: Final = 31 + 16
"""What a message takes in a chunk beside its data, and its entry in the index."""
_SUMMARY_BYTES: Final = 4096
"""What the end of a file takes, about: its index has 100 bytes per chunk."""


class BagWriter:
    """Writes one bag. `size_bytes` is what it takes on disk with the open chunk, before compression."""

    def __init__(
        self, path: Path, *, clock_ns: Callable[[], int] = time.time_ns, chunk_bytes: int = CHUNK_BYTES
    ) -> None:
        self.path = path
        self.began_ns = clock_ns()
        self._clock_ns = clock_ns
        self._file = path.open("xb")
        self._writer = Writer(self._file, chunk_size=chunk_bytes, compression=CompressionType.LZ4)
        self._writer.start(profile=PROFILE, library="robotapp-recorder")
        self._channels: dict[str, int] = {}
        self._open_bytes = 0
        self._chunk_began_ns = 0
        self._chunks = 0
        self._flush()

    @property
    def size_bytes(self) -> int:
        return self._file.tell() + self._open_bytes + _SUMMARY_BYTES + 100 * self._chunks

    @property
    def is_empty(self) -> bool:
        """Returns whether no message was written."""
        return self._chunks == 0 and self._open_bytes == 0

    def add_channel(self, topic: str, type_name: str, definition: str | None, qos: str) -> None:
        """Adds a topic. Without a definition readers need the message package themselves."""
        encoding = "ros2msg" if definition is not None else ""
        schema = self._writer.register_schema(type_name, encoding, (definition or "").encode())
        self._channels[topic] = self._writer.register_channel(
            topic, "cdr", schema, {"offered_qos_profiles": qos, "topic_type_hash": ""}
        )

    def add_message(self, topic: str, data: bytes, *, received_ns: int, published_ns: int, sequence: int = 0) -> None:
        """Adds a serialized message of a topic that was added before."""
        before = self._file.tell()
        self._writer.add_message(
            self._channels[topic], log_time=received_ns, data=data, publish_time=published_ns, sequence=sequence
        )
        if self._file.tell() > before:
            self._open_bytes, self._chunks = 0, self._chunks + 1
            self._flush()
        else:
            if self._open_bytes == 0:
                self._chunk_began_ns = self._clock_ns()
            self._open_bytes += len(data) + MESSAGE_HEAD_BYTES
            self.close_old_chunk()

    def close_old_chunk(self) -> None:
        """Closes the open chunk if it was begun long enough ago."""
        if self._open_bytes and self._clock_ns() - self._chunk_began_ns >= CHUNK_NS:
            self._writer.flush()
            self._open_bytes, self._chunks = 0, self._chunks + 1
            self._flush()

    def close(self) -> None:
        """Completes the file: its index is at its end."""
        self._writer.finish()
        self._flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def abandon(self) -> None:
        """Closes the file without an end, as a kill does; the next start completes it. For a disk that takes no more."""
        with suppress(OSError):
            self._file.close()

    def _flush(self) -> None:
        self._file.flush()


def repair(path: Path, target: Path) -> int:
    """Writes the complete messages of a bag without an end to `target`, and returns how many they are."""
    count = 0
    with path.open("rb") as source, target.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4)
        writer.start(profile=PROFILE, library="robotapp-recorder")
        schemas: dict[int, int] = {0: 0}
        channels: dict[int, int] = {}
        try:
            for schema, channel, message in NonSeekingReader(source, validate_crcs=True).iter_messages(
                log_time_order=False
            ):
                if schema is not None and schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                if channel.id not in channels:
                    channels[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, schemas[channel.schema_id], channel.metadata
                    )
                writer.add_message(
                    channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
                )
                count += 1
        except (McapError, EOFError, ValueError, RuntimeError, struct.error):
            pass  # what follows was being written when the recorder was killed; lz4 and the reader raise their own for it
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    return count
