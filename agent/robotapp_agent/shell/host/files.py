"""Reads the host's sysfs, device folder and udev database into a snapshot: bounded, without following links, skipping what fails."""

import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

from robotapp_agent.devices.tree import MOST_TEXT

_FOLDER: Final = os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
_FILE: Final = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
_MOST_OPEN: Final = 128
"""Folders that are kept open at a time."""


class Bounds(NamedTuple):
    """What one scan may read. A machine with 500 containers and 100 USB devices needs a tenth."""

    entries: int = 4096
    """In one folder."""
    files: int = 16_384
    total_bytes: int = 4 << 20
    file_bytes: int = 4096
    depth: int = 32
    """Folders on the way to a device."""
    seconds: float = 5.0


class Stopped(Exception):  # noqa: N818 - not an error: a bound was met or the agent ends
    """Reading ends here; what was read so far counts."""


class Budget:
    """What is left of a scan's bounds."""

    def __init__(self, bounds: Bounds, clock: Callable[[], float], cancelled: Callable[[], bool]) -> None:
        self.bounds = bounds
        self._clock = clock
        self._cancelled = cancelled
        self._deadline_s = clock() + bounds.seconds
        self._files = bounds.files
        self._bytes = bounds.total_bytes

    def spend(self, size_bytes: int = 0) -> None:
        """Before or after each access of a file. Raises `Stopped`."""
        self._files -= 1
        self._bytes -= size_bytes
        if self._files < 0 or self._bytes < 0:
            raise Stopped("more files than a scan reads")
        if self._cancelled():
            raise Stopped("the agent ends")
        if self._clock() > self._deadline_s:
            raise Stopped(f"reading took more than {self.bounds.seconds:g} s")


class Tree:
    """One tree of the host, read below its root only: every step on the way is opened without following links."""

    def __init__(self, root: Path, budget: Budget) -> None:
        """A root that is not there is an empty tree."""
        self._budget = budget
        self._fds: dict[str, int | None] = {}
        try:
            self._fds[""] = os.open(root, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError:
            self._fds[""] = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()
        if (root := self._fds.pop("", None)) is not None:
            os.close(root)

    def _close(self) -> None:
        """All but the root."""
        for path in [path for path in self._fds if path]:
            if (fd := self._fds.pop(path)) is not None:
                os.close(fd)

    @property
    def exists(self) -> bool:
        return self._fds[""] is not None

    def names(self, path: str) -> list[str]:
        """Entries of a folder, sorted; none of one that is not there. Raises OSError when it cannot be read."""
        if len(self._fds) > _MOST_OPEN:
            self._close()
        fd = self._folder(path)
        if fd is None:
            return []
        self._budget.spend()
        readable = os.open(".", os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC, dir_fd=fd)
        try:
            with os.scandir(readable) as entries:
                found = [entry.name for entry, _ in zip(entries, range(self._budget.bounds.entries + 1), strict=False)]
        finally:
            os.close(readable)
        if len(found) > self._budget.bounds.entries:
            raise Stopped(f"more than {self._budget.bounds.entries} entries in {path}")
        return sorted(found)

    def link(self, path: str, name: str) -> str:
        """Where a link leads, as a path below the root; "" when it is none or leads out."""
        fd = self._reached(path)
        self._budget.spend()
        if fd is None:
            return ""
        try:
            target = os.readlink(name, dir_fd=fd)
        except (OSError, ValueError):
            return ""
        parts = [] if target.startswith("/") else path.split("/")
        for part in target.split("/"):
            if part == "..":
                if not parts:
                    return ""
                parts.pop()
            elif part not in {"", "."}:
                parts.append(part)
        return "" if target.startswith("/") or len(parts) > self._budget.bounds.depth else "/".join(parts)

    def text(self, path: str, name: str) -> str | None:
        """A file's text without its line end, at most 256 characters; None when it is none that can be read."""
        content = self.content(path, name)
        return None if content is None else " ".join(content[: MOST_TEXT * 4].split())[:MOST_TEXT]

    def content(self, path: str, name: str) -> str | None:
        """The first 4 KiB of a plain file. Device files, pipes and links are never opened."""
        inner, _, name = name.rpartition("/")
        fd = self._reached("/".join(part for part in (path, inner) if part))
        self._budget.spend()
        if fd is None:
            return None
        try:
            if not stat.S_ISREG(os.stat(name, dir_fd=fd, follow_symlinks=False).st_mode):
                return None
            file = os.open(name, _FILE, dir_fd=fd)
            try:
                data = os.read(file, self._budget.bounds.file_bytes)
            finally:
                os.close(file)
        except (OSError, ValueError):
            return None
        self._budget.spend(len(data))
        return data.decode("utf-8", "replace").replace("\0", " ")

    def mark(self, path: str) -> tuple[int, int] | None:
        """What changes when a folder is made anew under the same name: a device that was unplugged and plugged in again."""
        above, _, name = path.rpartition("/")
        fd = self._reached(above)
        self._budget.spend()
        if fd is None:
            return None
        try:
            found = os.stat(name, dir_fd=fd, follow_symlinks=False)
        except (OSError, ValueError):
            return None
        return (found.st_ino, found.st_mtime_ns)

    def _reached(self, path: str) -> int | None:
        """None when the folder is not there or cannot be opened."""
        if len(self._fds) > _MOST_OPEN:
            self._close()
        try:
            return self._folder(path)
        except OSError:
            return None

    def _folder(self, path: str) -> int | None:
        """Opened once per scan; None when it is not there. Raises OSError when it is and cannot be opened."""
        if path in self._fds:
            return self._fds[path]
        self._budget.spend()
        above, _, name = path.rpartition("/")
        fd = self._folder(above)
        found = None
        if fd is not None and name not in {"", ".", ".."}:
            with suppress(FileNotFoundError, NotADirectoryError, ValueError):
                found = os.open(name, _FOLDER, dir_fd=fd)
        self._fds[path] = found
        return found
