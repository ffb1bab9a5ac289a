"""How the memory of the scheduler's container is shared out: whatever its processes take, the kernel has no reason to end one."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.shell.planner.container_memory import (
    DEFAULT_LIMIT,
    FORK_BYTES,
    PAGE,
    PLANNER_BYTES,
    PLANNER_MODULE,
    RESERVE,
    measure_planner_share,
    measure_simulation_share,
    measure_tree,
    read_limit,
)

VALUES = Path(__file__).parents[4] / "helm" / "robotapp" / "values.yaml"
GIB = 1 << 30


def write_process(proc: Path, pid: int, pages: int, *children: int, module: str = "robotapp_scheduler") -> None:
    folder = proc / f"{pid}" / "task" / f"{pid}"
    folder.mkdir(parents=True)
    (proc / f"{pid}" / "cmdline").write_text(f"python\0-m\0{module}\0")
    (proc / f"{pid}" / "statm").write_text(f"9999 {pages} 1 1 0 1 0\n")
    (folder / "children").write_text("".join(f"{child} " for child in children))


def test_a_process_counts_with_all_below_it_and_one_that_has_ended_counts_nothing(tmp_path: Path) -> None:
    write_process(tmp_path, 1, 100, 2, 3)
    write_process(tmp_path, 2, 20, 4)
    write_process(tmp_path, 4, 3)
    assert measure_tree(1, tmp_path) == 123 * PAGE


@pytest.mark.parametrize("limit", [DEFAULT_LIMIT, 2 * GIB])
def test_what_all_may_take_together_is_the_limit_however_much_the_planner_has_now(tmp_path: Path, limit: int) -> None:
    write_process(tmp_path, 1, 40_000, 2)
    write_process(tmp_path, 2, 50_000, module=PLANNER_MODULE)
    simulation, planner = measure_simulation_share(limit, 1, tmp_path), measure_planner_share(limit, 1, tmp_path)
    assert planner == PLANNER_BYTES
    assert simulation + planner + FORK_BYTES + RESERVE + 40_000 * PAGE == limit


@given(limit=st.integers(1, 4 * GIB), pages=st.integers(0, 2 * GIB // 4096))
def test_no_share_exceeds_what_the_others_leave(
    tmp_path_factory: pytest.TempPathFactory, limit: int, pages: int
) -> None:
    proc = tmp_path_factory.mktemp("proc")
    write_process(proc, 1, pages)
    shares: list[Callable[[int, int, Path], int]] = [measure_simulation_share, measure_planner_share]
    simulation, planner = (share(limit, 1, proc) for share in shares)
    assert simulation >= 0 <= planner
    if simulation or planner:
        assert simulation + planner + FORK_BYTES + RESERVE + pages * PAGE <= limit
    assert planner >= min(simulation, PLANNER_BYTES), "places for pods come before simulations"


def test_the_limit_is_the_containers_or_that_of_the_charts_values() -> None:
    assert read_limit({"MEMORY_LIMIT_BYTES": "2147483648"}) == 2 * GIB
    assert read_limit({}) == read_limit({"MEMORY_LIMIT_BYTES": "much"}) == read_limit({"MEMORY_LIMIT_BYTES": "0"})
    limit = yaml.safe_load(VALUES.read_text())["scheduler"]["resources"]["limits"]["memory"]
    assert limit == f"{read_limit({}) >> 20}Mi"
