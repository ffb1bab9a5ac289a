"""Huge pages for what we keep: a decision looks here and there in some hundred megabytes, and in pages of 4 KiB each look is
a walk through the page tables, in a virtual machine through two. Beside a busy API server that is a tenth of our CPU.

Python's allocators do not ask for them, and khugepaged takes minutes to come round. So we ask once the caches are filled,
and once an hour for what has grown since. It costs a tenth of a second in a thread and some 10 MB, for pages half filled.
"""

import asyncio
import ctypes
import logging
import mmap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

log = logging.getLogger(__name__)

SIZE: Final = 2 << 20
"""Of a huge page, in bytes, on x86-64 and on arm64 with pages of 4 KiB; elsewhere the kernel refuses, and nothing is lost."""
COLLAPSE: Final = 25
"""MADV_COLLAPSE of Linux 6.1, which `mmap` does not know; older kernels refuse it and leave the work to khugepaged."""
MAPS: Final = Path("/proc/self/maps")
SETTING: Final = Path("/sys/kernel/mm/transparent_hugepage/enabled")
PERIOD_S: Final = 3600.0


async def run(filled: asyncio.Event) -> None:
    """Ask once the caches are `filled`, then hourly, until cancelled."""
    await filled.wait()
    while True:
        made = await asyncio.to_thread(collapse)
        log.info("%d MiB are in huge pages", made * SIZE >> 20)
        await asyncio.sleep(PERIOD_S)


def collapse() -> int:
    """Put private memory of this process in huge pages, where the machine's settings allow them. How many there are now."""
    maps = _read(MAPS) if allowed(SETTING) else ""
    advise = ctypes.CDLL(None, use_errno=True).madvise
    advise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    made = 0
    for begin, end in whole_pages(maps.splitlines()):
        advise(begin, end - begin, mmap.MADV_HUGEPAGE)
        for page in range(begin, end, SIZE):
            if advise(page, SIZE, COLLAPSE) == 0:  # refused where nothing was ever written, such as unused stacks
                made += 1
    return made


def allowed(setting: Path) -> bool:
    """Whether the machine has huge pages and its owner has not said `never`."""
    said = _read(setting)
    return bool(said) and "[never]" not in said


def whole_pages(maps: Iterable[str]) -> Iterator[tuple[int, int]]:
    """Begin and end of what lines of /proc/PID/maps say is private, writable and of no file, cut to whole huge pages."""
    for line in maps:
        span, rights, *_, inode = line.split(maxsplit=5)[:5]
        begin, end = (int(address, 16) for address in span.split("-"))
        begin, end = -(-begin // SIZE) * SIZE, end // SIZE * SIZE
        if rights == "rw-p" and inode == "0" and "[stack]" not in line and begin < end:
            yield begin, end


def _read(path: Path) -> str:
    """Nothing when it is not there or not for us: what this is for is never worth an error."""
    try:
        return path.read_text()
    except OSError:
        return ""
