"""What a simulation may take of the container's memory."""

from pathlib import Path

import pytest

from robotapp_scheduler.port.forked_worker import MOST_NEW_MEMORY
from robotapp_scheduler.port.memory_share import DEFAULT_LIMIT, PAGE, RESERVE, measure_share, measure_tree, read_limit


def write_process(proc: Path, pid: int, pages: int, *children: int) -> None:
    folder = proc / f"{pid}" / "task" / f"{pid}"
    folder.mkdir(parents=True)
    (proc / f"{pid}" / "statm").write_text(f"9999 {pages} 1 1 0 1 0\n")
    (folder / "children").write_text("".join(f"{child} " for child in children))


def test_a_process_counts_with_all_below_it_and_one_that_has_ended_counts_nothing(tmp_path: Path) -> None:
    write_process(tmp_path, 1, 100, 2, 3)
    write_process(tmp_path, 2, 20, 4)
    write_process(tmp_path, 4, 3)
    assert measure_tree(1, tmp_path) == 123 * PAGE


@pytest.mark.parametrize("limit", [1 << 30, 2 << 30])
def test_what_all_may_take_together_fits_into_the_limit(tmp_path: Path, limit: int) -> None:
    write_process(tmp_path, 1, 50_000)
    share = measure_share(limit, 1, tmp_path)
    assert share + MOST_NEW_MEMORY + RESERVE + 50_000 * PAGE == limit


def test_there_may_be_nothing_left(tmp_path: Path) -> None:
    write_process(tmp_path, 1, 1 << 20)
    assert measure_share(1 << 30, 1, tmp_path) == 0


def test_the_limit_is_the_containers_or_that_of_the_charts_values() -> None:
    assert read_limit({"MEMORY_LIMIT_BYTES": "2147483648"}) == 2 << 30
    assert read_limit({}) == read_limit({"MEMORY_LIMIT_BYTES": "much"}) == read_limit({"MEMORY_LIMIT_BYTES": "0"})
    assert read_limit({}) == DEFAULT_LIMIT == 1 << 30
