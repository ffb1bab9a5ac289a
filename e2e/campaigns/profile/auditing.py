"""What this process does to the machine, by audit events: files, folders, processes, sockets, imports."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_LISTS = frozenset({"os.listdir", "os.scandir"})
_FORBIDDEN = (
    *("subprocess.", "socket.", "ctypes.", "shutil.", "tempfile.", "pty.", "urllib.", "http.", "glob."),
    *("os.system", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "os.startfile", "os.chdir", "os.mkdir"),
    *("os.remove", "os.rename", "os.rmdir", "os.link", "os.symlink", "os.chmod", "os.chown", "os.truncate", "os.kill"),
    *("import", "exec", "marshal.", "pickle."),
)
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_watch: "Watch | None" = None


@dataclass(slots=True)
class Watch:
    """Reading below `allowed` is all that may happen. `found` lists every event that goes beyond it."""

    allowed: Path
    found: list[str] = field(default_factory=list)
    opened: int = 0

    def see(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" or event in _LISTS:
            self._path(event, arguments)
        elif event.startswith(_FORBIDDEN):
            self.found.append(f"{event} {arguments[:1]!r}")

    def _path(self, event: str, arguments: tuple[Any, ...]) -> None:
        given = arguments[0]
        if not given or not isinstance(given, str | bytes | os.PathLike):
            return  # a descriptor, which an open before this one gave; or no name at all, which opens nothing
        self.opened += event == "open"
        path = os.fsdecode(given)
        inside = Path(os.path.realpath(path)).is_relative_to(self.allowed)
        if not inside or (event == "open" and arguments[2] & _WRITES):
            self.found.append(f"{event} {path}")


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _watch is not None:
        _watch.see(event, arguments)


sys.addaudithook(_hook)


@contextmanager
def watched(allowed: Path) -> Iterator[Watch]:
    """Every event within the block is judged; an audit hook cannot be removed, so it looks at what is set here."""
    global _watch  # noqa: PLW0603
    _watch = watch = Watch(Path(os.path.realpath(allowed)))
    try:
        yield watch
    finally:
        _watch = None
