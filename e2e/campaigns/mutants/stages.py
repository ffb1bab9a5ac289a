"""The order in which tests run against a fault, until one of them fails."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from campaigns.mutants.catalogue import Fault
from suite.__main__ import EXAMPLES, SAMPLES
from suite.lanes import ON_ALL_CORES
from suite.plan import QUICK_FOLDERS, plan_essential, read_entries

ESSENTIAL: Final = "tests/essential.txt"
LIVE: Final = "tests/live"
OTHERS: Final = "e2e/tests"
NO_NOTICE: Final = "e2e/tests/campaigns/mutants/test_mutants.py"
"""Fails with every fault, because it looks for the text that the fault replaces."""
FEW: Final[Mapping[str, str]] = MappingProxyType({EXAMPLES: "few"})
"""Variables of the quick tests in `scripts/test`."""
ALL: Final[Mapping[str, str]] = MappingProxyType({SAMPLES: "all"})


class Stage(NamedTuple):
    """Tests of one run of pytest. `is_daily`: `scripts/test` without arguments runs them as well."""

    name: str
    tests: tuple[str, ...]
    is_daily: bool
    options: tuple[str, ...] = ()
    environment: Mapping[str, str] = MappingProxyType({})


def plan_stages(fault: Fault, tree: Path, *, rest: bool) -> Iterator[Stage]:
    """The touched package's quick tests, all quick ones, the essential live tests, and with `rest` everything else."""
    if fault.quick_tests:
        yield Stage("own tests", fault.quick_tests, is_daily=True, environment=FEW)
    yield Stage("unit and property", QUICK_FOLDERS, is_daily=True, options=ON_ALL_CORES, environment=FEW)
    entries = read_entries((tree / ESSENTIAL).read_text(encoding="utf-8"))
    folders = {group.name: group.selectors for group in plan_essential(entries, {})}
    for folder in order_folders(list(folders), first=fault.live_tests):
        yield Stage("essential live tests", folders[folder], is_daily=True)
    if rest:
        yield Stage("all examples", QUICK_FOLDERS, is_daily=False, options=ON_ALL_CORES, environment=ALL)
        live = [f"{LIVE}/{path.name}" for path in sorted((tree / LIVE).iterdir()) if _has_tests(path)]
        for folder in order_folders(live, first=fault.live_tests):
            yield Stage("live tests", (folder,), is_daily=False, environment=ALL)
        yield Stage("tests of the tools", (OTHERS,), is_daily=False, options=(f"--ignore={NO_NOTICE}",))


def order_folders(folders: Sequence[str], *, first: tuple[str, ...]) -> list[str]:
    """Returns the folders, each of which has a control plane of its own; those that hold a test of `first` lead."""
    return sorted(folders, key=lambda folder: not any(f"{test}/".startswith(f"{folder}/") for test in first))


def _has_tests(path: Path) -> bool:
    return path.is_dir() and any(path.rglob("test_*.py"))
