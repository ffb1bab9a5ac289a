"""The bridge run on one file under watch: what it opens, starts and connects to, how long it computes, how much it writes."""

import contextlib
import io
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rigel_bridge.main import main

_WATCHED: Final = (
    "open",
    "socket.",
    "subprocess.",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.fork",
    "shutil.",
    "import",
)
_OWN: Final = (str(Path(__file__).resolve().parents[3]), sys.prefix, sys.base_prefix)
_seen: list[tuple[str, str]] | None = None
_hooked = False


@dataclass(slots=True)
class Run:
    """One run of one command."""

    code: int
    cpu_s: float
    written: int
    """Characters on both streams."""
    lines: list[str]
    foreign: list[tuple[str, str]] = field(default_factory=list)
    """What was touched that was not given."""


def run(path: Path, *arguments: str) -> Run:
    """`rigel-bridge ARGUMENTS path`; an exception that escapes is the caller's to see."""
    out, err = io.StringIO(), io.StringIO()
    started_s = time.process_time()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), _watch() as seen:
        code = main([*arguments, str(path)])
    used_s = time.process_time() - started_s
    foreign = [(event, what) for event, what in seen if what != str(path)]
    return Run(code, used_s, len(out.getvalue()) + len(err.getvalue()), err.getvalue().splitlines(), foreign)


@contextlib.contextmanager
def _watch() -> Iterator[list[tuple[str, str]]]:
    global _seen, _hooked  # noqa: PLW0603  # an audit hook stays for the life of the process
    if not _hooked:
        sys.addaudithook(_hook)
        _hooked = True
    _seen = []
    try:
        yield _seen
    finally:
        _seen = None


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _seen is None or not event.startswith(_WATCHED) or event == "import":
        return
    what = str(arguments[0]) if arguments else ""
    if event == "open" and (isinstance(arguments[0], int) or what.startswith(_OWN)):
        return  # a descriptor that is open already, or our own modules and data
    _seen.append((event, what))
