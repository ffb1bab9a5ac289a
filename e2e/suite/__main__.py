"""Runs the tests for `scripts/test`; `scripts/test --help` explains the options."""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from suite import durations, landing
from suite.lanes import Lanes
from suite.plan import (
    QUICK_FOLDERS,
    UNKNOWN_SECONDS,
    Group,
    Variables,
    choose_touched,
    cut_parts,
    join_groups,
    list_folders,
    plan_essential,
    plan_rest,
    read_entries,
    take_turn,
)
from suite.repository import REPOSITORY
from suite.summary import format_summary

ESSENTIAL: Final = REPOSITORY / "tests" / "essential.txt"
EXAMPLES: Final = "ROBOTAPP_EXAMPLES"
SAMPLES: Final = "ROBOTAPP_SAMPLES"
FEW_EXAMPLES: Final[Variables] = ((EXAMPLES, "few"),)
"""Makes property tests try few examples: the quick tests of plain `scripts/test`."""
ALL_SAMPLES: Final[Variables] = ((SAMPLES, "all"),)
"""Makes tests take all of what otherwise rotates by the day: the rest, and everything in `--all`."""
TOUCHED_BUDGET_S: Final = 900.0
"""At most so many seconds of tests that a landing's files concern, by measured durations; more waits for its turn."""
QUICK: Final = "unit and property tests"
ALL_EXAMPLES: Final = "property tests with all examples"
REAL_NODES: Final = ("tests/live/nodes", "tests/live/images", "tests/live/reference", "e2e/tests/live")
"""Groups that start kubelets or build images; all others do with the programs of simulated nodes."""
TOOLS: Final = ("testbed", "campaigns", "ros_nodes", "suite")
EPILOG: Final = """\
examples:
  scripts/test                     a quarter of an hour: unit, property and essential live tests
  scripts/test tests/live/cli      a path or any arguments of pytest
  scripts/test --part 3/8          the third of eight parts of everything else
  scripts/test --all --record      everything, and keep the measured durations
  scripts/test --list --all        what would run, and how long it should take
"""


class Plan(NamedTuple):
    """Groups to run, and what the last line prints of them."""

    groups: list[Group]
    ran: str
    first: Group | None = None
    """Runs before the programs of the control plane are built."""
    is_everything: bool = False
    next_turn: str = ""
    waiting: tuple[str, ...] = ()

    def list_groups(self) -> list[Group]:
        """Returns all groups in the order in which they begin."""
        return [self.first, *self.groups] if self.first else self.groups


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs what the arguments ask for and returns 0 when every test passed."""
    options = parse_arguments(arguments)
    entries = read_entries(ESSENTIAL.read_text())
    plan = make_plan(options, entries)
    if options.list:
        _print_plan(plan.list_groups())
        return 0
    if options.part and not plan.groups:
        sys.stdout.write(f"{plan.ran} holds no tests: the parts before it hold all, because no module is divided\n")
        return 0
    if options.landed:
        last_landing = landing.record_landing(plan.waiting)
        sys.stdout.write(f"landed {last_landing.landed[:12]}; next in turn: {plan.next_turn}\n")
        return 0
    return _run(plan, entries, record=options.record)


def parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/test",
        description="Runs the tests. Without options: what a newcomer runs. A command line that begins with anything else than "
        "these options goes to pytest whole.",
        allow_abbrev=False,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--all", action="store_true", help="all tests, and property tests with all their examples")
    mode.add_argument(
        "--part", metavar="K/N", type=_parse_part, help="part K of N of what plain scripts/test leaves out"
    )
    mode.add_argument(
        "--ci",
        action="store_true",
        help="plain scripts/test, then what changed files concern and the groups whose turn it is",
    )
    mode.add_argument(
        "--landed", action="store_true", help="record that HEAD has landed: its turn is over (.ci/landing.json)"
    )
    parser.add_argument(
        "--list", action="store_true", help="print the groups and their expected durations; run nothing"
    )
    parser.add_argument("--record", action="store_true", help="keep the measured durations in e2e/suite/durations.json")
    options = parser.parse_args(arguments)
    if options.record and (options.list or options.landed):
        parser.error("--record keeps what a run has measured; --list and --landed run nothing: leave one of them out")
    return options


def _parse_part(text: str) -> tuple[int, int]:
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise argparse.ArgumentTypeError(f"{text!r} is no part: write K/N with 1 <= K <= N, for example 3/8")
    return int(number), int(count)


def make_plan(options: argparse.Namespace, entries: list[str]) -> Plan:
    seconds_by_name = durations.load_durations()
    rest = [
        replace(group, variables=ALL_SAMPLES)
        for group in (
            *_plan_tools(seconds_by_name),
            *plan_rest(landing.list_test_modules(), entries, seconds_by_name),
        )
    ]
    essential = plan_essential(entries, seconds_by_name)
    if options.all:
        groups = [*(replace(group, variables=ALL_SAMPLES) for group in essential), *join_groups(rest)]
        return Plan(groups, "everything", is_everything=True)
    if options.part:
        number, count = options.part
        return Plan(join_groups(cut_parts(rest, count)[number - 1]), f"part {number}/{count}")
    quick = Group(QUICK, QUICK_FOLDERS, seconds_by_name.get(QUICK, 180.0), on_all_cores=True, variables=FEW_EXAMPLES)
    if options.ci or options.landed:
        return _plan_landing(quick, essential, rest)
    return Plan(essential, "unit, property and essential live tests", first=quick)


def _plan_landing(quick: Group, essential: list[Group], rest: list[Group]) -> Plan:
    """Plans what a landing runs: the essential tests, what its files concern, and the tests of the rest whose turn it is."""
    last_landing = landing.read_landing()
    changed_files = landing.list_changed_files(last_landing.landed)
    concerned_groups, later_groups = choose_touched(rest, changed_files or (), TOUCHED_BUDGET_S)
    turn, waiting_names = take_turn(rest, last_landing.waiting, landing.LANDINGS_PER_ROUND)
    next_turn, _ = take_turn(rest, waiting_names, landing.LANDINGS_PER_ROUND)
    groups = list({group.name: group for group in (*concerned_groups, *turn)}.values())
    remark = f"{len(concerned_groups)} modules that changed files concern"
    if changed_files is None:
        remark = "changed files are unknown without a git repository"
    if waiting_count := len({group.name for group in later_groups} - {group.name for group in turn}):
        remark += f" ({waiting_count} more wait for their turn)"
    ran = f"essential tests; in turn: {_name_folders(turn)}; {remark}"
    return Plan(
        [*essential, *join_groups(groups)],
        ran,
        first=quick,
        next_turn=_name_folders(next_turn),
        waiting=tuple(waiting_names),
    )


def _name_folders(groups: Sequence[Group]) -> str:
    return " + ".join(list_folders(groups))


def _plan_tools(seconds_by_name: Mapping[str, float]) -> list[Group]:
    """Returns the groups without control planes: the property tests with all examples, and the tests of the tools."""
    selectors = {ALL_EXAMPLES: QUICK_FOLDERS} | {f"e2e/tests/{tool}/": (f"e2e/tests/{tool}",) for tool in TOOLS}
    return [
        Group(name, folders, max(1.0, seconds_by_name.get(name, UNKNOWN_SECONDS)), on_all_cores=True)
        for name, folders in selectors.items()
    ]


def _print_plan(groups: Sequence[Group]) -> None:
    for group in groups:
        note = "alone" if group.exclusive else "up to four workers" if group.on_all_cores else ""
        sys.stdout.write(f"{group.seconds:6.0f} s  {group.name}  {note}\n")
        for selector in group.selectors:
            sys.stdout.write(f"          {selector}\n")
    sys.stdout.write(f"{sum(group.seconds for group in groups):6.0f} s  in all, if one ran after the other\n")


def _run(plan: Plan, entries: list[str], *, record: bool) -> int:
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="robotapp-test-") as folder:
        lanes = Lanes(Path(folder))
        if plan.first:
            lanes.run([plan.first], os.environ)
        if _build_binaries(plan.groups):
            lanes.run(plan.groups, os.environ)
        else:
            lanes.give_up(plan.groups)
        sys.stdout.write("\n".join(("", *format_summary(lanes.results), "")))
        if record:
            _record(lanes, plan, entries)
    _print_last_line(plan, time.monotonic() - began)
    return 0 if lanes.succeeded else 1


def _build_binaries(groups: Sequence[Group]) -> bool:
    """Gets or compiles the programs of the control plane that the groups start. Returns False when that failed."""
    live = [group for group in groups if not group.on_all_cores]
    if not live:
        return True
    real = any(group.name.startswith(REAL_NODES) for group in live)
    purpose = () if real else ("--for", "simulated")
    return subprocess.run([sys.executable, "-m", "robotapp_testbed", "build", *purpose], check=False).returncode == 0


def _record(lanes: Lanes, plan: Plan, entries: list[str]) -> None:
    """Keeps the measured durations of what succeeded. A module is measured only when all of its tests ran."""
    seconds_by_name = durations.read_reports(lanes.reports, entries)
    if not (plan.is_everything and lanes.succeeded):
        for entry in entries:
            module, _, test = entry.partition("::")
            if test:
                seconds_by_name.pop(module, None)
    seconds_by_name |= {
        result.name: result.seconds for result in lanes.results if result.succeeded and result.seconds is not None
    }
    tools = [group.name for group in _plan_tools({})]
    durations.save_durations(seconds_by_name, [*landing.list_test_modules(), *entries, *tools, QUICK])


def _print_last_line(plan: Plan, seconds: float) -> None:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = usage.ru_utime + usage.ru_stime
    sys.stdout.write(f"ran: {plan.ran}; in {seconds:.0f} s ({cpu_s:.0f} s of CPU)")
    sys.stdout.write(f"; next in turn: {plan.next_turn}\n" if plan.next_turn else "\n")


if __name__ == "__main__":
    try:
        sys.exit(main())
    except landing.LandingError as problem:
        sys.exit(f"scripts/test: {problem}")
    except KeyboardInterrupt:
        sys.exit(130)
