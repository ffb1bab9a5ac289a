"""Writes the labels of the node's devices as a feature file of Node Feature Discovery, where that is installed."""

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from robotapp_agent.devices.device import Device
from robotapp_agent.devices.labels import labels_of

FOLDER: Final = Path("/etc/kubernetes/node-feature-discovery/features.d")
FILE: Final = "robotapp"
EXPIRES_AFTER: Final = timedelta(hours=1)
"""Labels of an agent that is gone go away by themselves."""
_REFRESH_BEFORE: Final = timedelta(minutes=30)


class FeatureFile:
    """NFD's worker reads the file when it changes and every minute, and its master labels the node: no right of ours needed."""

    def __init__(self, folder: Path, *, now: Callable[[], datetime] = lambda: datetime.now(UTC)) -> None:
        """folder: where NFD's worker reads, mounted from the host."""
        self._path = folder / FILE
        self._now = now
        self._labels: dict[str, str] | None = None
        self._expires = now()
        self.problem = ""
        """Why the file could not be written, "" when it could or when NFD is not there."""

    def __repr__(self) -> str:
        return f"FeatureFile({self._path}, {len(self._labels or ())} labels)"

    def write(self, devices: Iterable[Device]) -> bool:
        """Write the labels of these devices if they are others than before or expire soon; whether something was written.

        Where the folder is not there NFD is not either: nothing is done. An error is kept in `problem`, never raised.
        """
        labels = labels_of(devices)
        # The clock may jump either way: what expires too late is written anew as well.
        left = self._expires - self._now()
        if labels == self._labels and _REFRESH_BEFORE < left <= EXPIRES_AFTER and self._path.exists():
            return False
        if not self._path.parent.is_dir():
            self._labels, self.problem = None, ""
            return False
        expires = self._now() + EXPIRES_AFTER
        try:
            _replace(self._path, _text(labels, expires))
        except OSError as error:
            self._labels, self.problem = None, f"{self._path} cannot be written: {error.strerror}"
            return False
        self._labels, self._expires, self.problem = labels, expires, ""
        return True


def _text(labels: dict[str, str], expires: datetime) -> str:
    head = "# Written by the RobotApp node agent: the devices it sees.\n"
    directive = f"# +expiry-time={expires.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}\n"
    return head + directive + "".join(f"{key}={value}\n" for key, value in sorted(labels.items()))


def _replace(path: Path, text: str) -> None:
    """Whole or not at all: NFD passes over names that begin with a dot, so it never reads half a file."""
    draft = path.with_name(f".{path.name}")
    with suppress(FileNotFoundError):
        draft.unlink()
    try:
        fd = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        with os.fdopen(fd, "w") as file:
            file.write(text)
        draft.replace(path)
    except OSError:
        with suppress(OSError):
            draft.unlink()
        raise
