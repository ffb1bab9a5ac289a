"""Tunes garbage collector and huge pages for what the process keeps: hundreds of thousands of decoded objects without cycles.

With Python's defaults the collector walks them again and again: a fifth of the cold start, a tenth of a burst, and pauses of
tens of milliseconds between a pod and its bind. So an object is walked once, in small lots, and frozen if it survived.
Objects that form a cycle later (an exception with its stack, a task) are few and small, and are collected once an hour.

A decision reads from some hundred megabytes, here and there. With pages of 4 KiB each access walks the page tables, in a virtual
machine two of them: beside a busy API server a tenth of the process' CPU. Python's allocators request no huge pages, and
khugepaged takes minutes to come round. So the process requests them when the caches are filled, and once an hour for
what has grown since. It costs a tenth of a second in a thread and some 10 MB for pages that are half filled.

glibc keeps what large temporary objects needed (a page of a list, a matrix of round trips) for the next ones, between objects that
stay; of 240 MB of its heap 100 lay idle. So what is larger than 2 MB goes back to the system when it is freed.
"""

import asyncio
import ctypes
import gc
import logging
import mmap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

from robotapp_client.serving.heap import return_large_objects

log = logging.getLogger(__name__)

PERIOD_S: Final = 3600.0
FILLING: Final = (500_000, 10, 10)
"""Thresholds while the initial lists are read: nearly every object stays, so there is nothing to collect."""
LARGE: Final = 2 << 20
LOT: Final = 5_000
"""Objects made and not freed before a collection; walking so many takes a millisecond or two."""
DEFAULTS: Final = (700, 10, 10)
SIZE: Final = 2 << 20
"""Bytes of a huge page on x86-64, and on arm64 with pages of 4 KiB; elsewhere the kernel refuses, which does no harm."""
COLLAPSE: Final = 25
"""MADV_COLLAPSE of Linux 6.1, which `mmap` does not know; older kernels refuse it and leave the work to khugepaged."""
MAPS: Final = Path("/proc/self/maps")
SETTING: Final = Path("/sys/kernel/mm/transparent_hugepage/enabled")


# --- Garbage collector ---------------------------------------------------------------------------------------------------


def filling() -> None:
    """The caches are about to be filled."""
    gc.set_threshold(*FILLING)
    return_large_objects(LARGE)


def filled() -> None:
    """The caches are filled: freeze all objects, which live as long as the process."""
    thorough()
    if _set_aside not in gc.callbacks:
        gc.callbacks.append(_set_aside)
    gc.set_threshold(LOT, 10, 10)


def released() -> None:
    """Restore Python's defaults, for a process that goes on afterwards (tests)."""
    if _set_aside in gc.callbacks:
        gc.callbacks.remove(_set_aside)
    gc.set_threshold(*DEFAULTS)
    gc.unfreeze()


async def collect_hourly() -> None:
    """Look at everything once an hour, until cancelled."""
    while True:
        await asyncio.sleep(PERIOD_S)
        thorough()


def thorough() -> None:
    """Walk all there is, whatever was set aside as well: a tenth of a second and more in a large cluster."""
    gc.unfreeze()
    gc.collect()
    gc.freeze()


def _set_aside(phase: str, _: dict[str, Any]) -> None:
    if phase == "stop":
        gc.freeze()


# --- Huge pages ----------------------------------------------------------------------------------------------------------


async def use_huge_pages(filled: asyncio.Event) -> None:
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
    """Whether the machine has huge pages and they are not set to `never`."""
    found = _read(setting)
    return bool(found) and "[never]" not in found


def whole_pages(maps: Iterable[str]) -> Iterator[tuple[int, int]]:
    """Begin and end of private, writable, anonymous mappings by lines of /proc/PID/maps, cut to whole huge pages."""
    for line in maps:
        span, rights, *_, inode = line.split(maxsplit=5)[:5]
        begin, end = (int(address, 16) for address in span.split("-"))
        begin, end = -(-begin // SIZE) * SIZE, end // SIZE * SIZE
        if rights == "rw-p" and inode == "0" and "[stack]" not in line and begin < end:
            yield begin, end


def _read(path: Path) -> str:
    """The file's text, "" when it cannot be read: huge pages are never worth an error."""
    try:
        return path.read_text()
    except OSError:
        return ""
