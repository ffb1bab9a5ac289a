"""The order in which tests run against a fault, until one of them fails."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

from campaigns.mutants.catalogue import QUICK, Fault

ESSENTIAL: Final = "tests/essential.txt"
"""Live tests of `scripts/test`: a path or an id of pytest on each line, # begins a remark."""
LIVE: Final = "tests/live"
OTHERS: Final = "e2e/tests"
NO_NOTICE: Final = "e2e/tests/campaigns/mutants/test_mutants.py"
"""Fails with every fault, because it looks for the text that the fault replaces."""
SHARED: Final = ("--numprocesses=auto", "--maxprocesses=4", "--dist=worksteal")
"""Quick tests run on all cores, as in `scripts/test`."""


class Stage(NamedTuple):
    """Tests of one run of pytest. `is_daily`: `scripts/test` without arguments runs them as well."""

    name: str
    tests: tuple[str, ...]
    is_daily: bool
    options: tuple[str, ...] = ()


def plan_stages(fault: Fault, tree: Path, *, rest: bool) -> Iterator[Stage]:
    """The touched package's quick tests, all quick ones, the essential live tests, and with `rest` everything else."""
    if fault.quick_tests:
        yield Stage("own tests", fault.quick_tests, is_daily=True)
    yield Stage("unit and property", QUICK, is_daily=True, options=SHARED)
    essential = read_essential(tree)
    if essential:
        for tests in group_by_folder(essential, first=fault.live_tests):
            yield Stage("essential live tests", tests, is_daily=True)
    if rest or not essential:
        folders = [f"{LIVE}/{path.name}" for path in sorted((tree / LIVE).iterdir()) if _has_tests(path)]
        for tests in group_by_folder(folders, first=fault.live_tests):
            yield Stage("live tests", tests, is_daily=not essential)
    if rest:
        yield Stage("tests of the tools", (OTHERS,), is_daily=False, options=(f"--ignore={NO_NOTICE}",))


def read_essential(tree: Path) -> tuple[str, ...]:
    """Returns the tests that the list names; none when there is no list."""
    path = tree / ESSENTIAL
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return tuple(test for line in lines if (test := line.partition(" #")[0].strip()) and not test.startswith("#"))


def group_by_folder(tests: Iterable[str], *, first: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Groups tests by their folder of `tests/live`, each of which has a control plane of its own; those in `first` lead."""
    groups: dict[str, list[str]] = {}
    for test in tests:
        groups.setdefault("/".join(test.split("/")[:3]), []).append(test)
    ordered = sorted(groups, key=lambda folder: not folder.startswith(first) if first else True)
    return [tuple(groups[folder]) for folder in ordered]


def _has_tests(path: Path) -> bool:
    return path.is_dir() and any(path.rglob("test_*.py"))
