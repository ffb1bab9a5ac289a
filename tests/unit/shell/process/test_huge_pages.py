"""What the process keeps is put in huge pages, where the machine has them."""

import mmap
import re
from pathlib import Path

import pytest

from robotapp_scheduler.shell.process import memory_tuning
from robotapp_scheduler.shell.process.memory_tuning import SIZE, whole_pages

MIB = 1 << 20


def maps_line(begin: int, end: int, *, rights: str = "rw-p", inode: int = 0, name: str = "") -> str:
    return f"{begin:012x}-{end:012x} {rights} 00000000 00:00 {inode} {name}"


def test_only_whole_huge_pages_are_asked_for() -> None:
    line = maps_line(3 * MIB, 9 * MIB)
    assert list(whole_pages([line])) == [(4 * MIB, 8 * MIB)]


def test_less_than_a_huge_page_is_left_alone() -> None:
    assert list(whole_pages([maps_line(3 * MIB, 5 * MIB)])) == []


@pytest.mark.parametrize(
    "line",
    [
        maps_line(0, 8 * MIB, rights="r-xp"),
        maps_line(0, 8 * MIB, rights="rw-s"),
        maps_line(0, 8 * MIB, rights="---p"),
        maps_line(0, 8 * MIB, inode=7, name="/usr/lib/libc.so.6"),
        maps_line(0, 8 * MIB, name="[stack]"),
    ],
    ids=["code", "shared", "reserved", "file", "stack"],
)
def test_memory_that_is_not_our_heap_is_left_alone(line: str) -> None:
    assert list(whole_pages([line])) == []


def test_the_heap_is_ours() -> None:
    assert list(whole_pages([maps_line(0, 8 * MIB, name="[heap]")])) == [(0, 8 * MIB)]


def test_who_has_forbidden_huge_pages_or_has_none_is_not_asked(tmp_path: Path) -> None:
    setting = tmp_path / "enabled"
    assert not memory_tuning.allowed(setting)
    setting.write_text("always madvise [never]\n")
    assert not memory_tuning.allowed(setting)
    setting.write_text("always [madvise] never\n")
    assert memory_tuning.allowed(setting)


def test_a_machine_that_does_not_tell_where_our_memory_is_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory_tuning, "MAPS", tmp_path / "maps")
    assert memory_tuning.collapse() == 0


def test_written_memory_comes_to_lie_in_huge_pages() -> None:
    """On a kernel that refuses (older than 6.1, or none to be had) nothing happens, and what was written is still there."""
    with mmap.mmap(-1, 8 * SIZE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as memory:
        memory.write(b"x" * (8 * SIZE))
        made = memory_tuning.collapse()
        rollup = Path("/proc/self/smaps_rollup").read_text()
        found = re.search(r"^AnonHugePages: +(\d+) kB", rollup, re.MULTILINE)
        assert found
        assert int(found[1]) * 1024 >= min(made, 7) * SIZE
        assert memory[:] == b"x" * (8 * SIZE)
