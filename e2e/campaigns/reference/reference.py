"""The ten reference applications under our scheduler and kube-scheduler: placement on simulated nodes, or with --real what they do.

Without --real each application is placed on eight simulated nodes: where its components go, which of the promises of its RobotApp
hold there, and which plugins decided, beside the thesis' tables 4.1 and 4.3. With --real it runs on real nodes with everything of
the chart as pods, all in one cluster: its own figures, and whether it keeps what its README promises through a fault.

A file given by --json keeps the outcomes of earlier runs. With --budget-minutes a long comparison is made in short turns: what the
file does not have yet comes first.
"""

import argparse
import os
import platform
import shlex
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.table import Table

from campaigns.common import options
from campaigns.common.output import save, say
from campaigns.reference import report as reports
from campaigns.reference import turns as agenda
from campaigns.reference.catalogue import (
    GENERATIONS,
    OFF_BOARD_NODES,
    SCENARIOS,
    SCHEDULERS,
    THESIS_REPETITIONS,
    THESIS_ROUND_TRIPS,
    Fault,
    Scenario,
)
from campaigns.reference.placement import Placement
from campaigns.reference.profiles import infer
from campaigns.reference.real_nodes import describe, run_trial, start_cluster
from campaigns.reference.report import Report, read_report
from campaigns.reference.simulated_nodes import start_rig
from campaigns.reference.turns import ALL, OWN, Turn
from campaigns.scenarios.contenders import Contender
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.real import UnavailableError, prerequisites

WIDTH: Final = 200
ENDLESS: Final = 10**6
SAVED_EVERY_S: Final = 10.0


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    report = read_report(arguments.json)
    if not arguments.analyse:
        report.machine = {
            "python": platform.python_version(),
            "machine": platform.machine(),
            "cores": str(os.cpu_count()),
        }
        report.commands = [*dict.fromkeys([*report.commands, _command(sys.argv[1:] if argv is None else argv)])]
        try:
            (_try_all if arguments.real else _place_all)(arguments, report)
        except (UnavailableError, TestbedError) as problem:
            say(str(problem))
            return 1
        finally:
            save(arguments.json, report.to_json())
    _print(report)
    if arguments.page:
        arguments.page.write_text(reports.write_page(report, arguments.page.read_text()))
    problems = reports.list_broken(report)
    for sentence in problems:
        say(sentence)
    return 1 if problems else 0


def _try_all(arguments: argparse.Namespace, report: Report) -> None:
    """Plays trials on one cluster until the budget is spent."""
    prerequisites.require()
    turns = agenda.put_missing_first(
        agenda.plan_trials(*_choose(arguments), arguments.fault),
        lambda turn: report.has_trial(turn.app, turn.contender.name, turn.fault_text),
    )
    if not turns:
        raise TestbedError(
            f"no README promises anything of these applications for {arguments.fault}: choose another fault"
        )
    scenarios = list({turn.scenario.name: turn.scenario for turn in turns}.values())
    began_s = time.monotonic()
    count = 0
    with start_cluster(scenarios, OFF_BOARD_NODES) as cp:
        start_s = time.monotonic() - began_s
        say(f"the nodes are ready after {start_s:.0f} s; {len(turns)} runs")
        for turn in agenda.within(turns, arguments.budget_minutes - start_s / 60):
            trial = run_trial(cp, turn.scenario, turn.ros, turn.contender, fault=turn.fault)
            count += 1
            say(describe(trial))
            report.note_trial(trial)
            save(arguments.json, report.to_json())
            if arguments.lines:
                reports.append_line(arguments.lines, trial)
    _tell_rest(len(turns) - count)


def _place_all(arguments: argparse.Namespace, report: Report) -> None:
    """Places applications on one control plane until the budget is spent: those of a scenario in turn, scenarios beside each other."""
    turns = agenda.put_missing_first(
        agenda.plan_placements(*_choose(arguments), arguments.repetitions),
        lambda turn: report.has_placement(turn.app, turn.contender.name, turn.repetition),
    )
    for app in dict.fromkeys(turn.app for turn in turns):
        report.profiles[app] = infer(app)
    keep = _save_at_times(arguments.json, report)
    lock = threading.Lock()

    def place_lane(lane: Sequence[Turn]) -> int:
        count = 0
        for turn in agenda.within(lane, arguments.budget_minutes):
            began_s = time.monotonic()
            placement = rig.place(turn.scenario, turn.ros, turn.contender, turn.repetition)
            with lock:
                say(f"{_describe(placement)} [{time.monotonic() - began_s:.1f} s]")
                report.note_placement(placement)
                keep()
            count += 1
        return count

    with start_rig() as rig, ThreadPoolExecutor(len(SCENARIOS)) as pool:
        for turn in turns:
            rig.prepare(turn.scenario, turn.ros)
        lanes = [[turn for turn in turns if turn.scenario.name == name] for name in SCENARIOS]
        counts = [*pool.map(place_lane, lanes)]
    _tell_rest(len(turns) - sum(counts))


def _describe(placement: Placement) -> str:
    """Returns one line of a placement."""
    share = f"{placement.kept}/{len(placement.promises)}"
    nodes = reports.describe_nodes(placement.nodes)
    return f"{placement.repetition} {placement.app} under {placement.scheduler}: {share} kept; {nodes}"


def _choose(arguments: argparse.Namespace) -> tuple[list[Scenario], list[int], Sequence[Contender]]:
    names = SCENARIOS if ALL in (arguments.app or [ALL]) else arguments.app
    scenarios = [scenario for scenario in SCENARIOS.values() if scenario.name in names]
    generations = [arguments.ros] if arguments.ros else list(GENERATIONS)
    return scenarios, generations, agenda.choose_contenders(arguments.scheduler)


def _save_at_times(path: Path | None, report: Report) -> Callable[[], None]:
    """Returns what saves the report unless it did so a moment ago: thousands of placements make a long file."""
    saved_s = time.monotonic()

    def keep() -> None:
        nonlocal saved_s
        if time.monotonic() - saved_s >= SAVED_EVERY_S:
            save(path, report.to_json())
            saved_s = time.monotonic()

    return keep


def _tell_rest(count: int) -> None:
    if count:
        say(f"the budget is spent; {count} runs are for another turn with the same --json")


def _print(report: Report) -> None:
    console = Console(width=WIDTH)
    if report.trials:
        console.print(_table("behaviour on real nodes", reports.TRIAL_HEADS, reports.tabulate_trials(report.trials)))
        for row in THESIS_ROUND_TRIPS.values():
            console.print(
                f"thesis, table 4.2, both nodes in one pod: {row.scheduler}, {row.count} round trips, mean {row.mean_ms} ms, "
                f"p95 {row.p95_ms} ms, p99 {row.p99_ms} ms"
            )
    if report.placements:
        rows = reports.tabulate_placements(report.placements)
        console.print(_table("placement on simulated nodes", reports.PLACEMENT_HEADS, rows))
    if report.profiles:
        rows = reports.tabulate_profiles(report.profiles)
        console.print(_table("profile generator (thesis, table 4.3)", reports.PROFILE_HEADS, rows))


def _table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    table = Table(title=title)
    for head in heads:
        table.add_column(head)
    for row in rows:
        table.add_row(*row)
    return table


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="scripts/bench reference", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--app", action="append", choices=[ALL, *SCENARIOS], help="one scenario instead of all five; may be given again"
    )
    parser.add_argument("--ros", type=int, choices=GENERATIONS, help="one generation instead of both")
    parser.add_argument(
        "--scheduler", choices=[ALL, *(c.name for c in SCHEDULERS)], default=ALL, help="one scheduler instead of both"
    )
    parser.add_argument("--real", action="store_true", help="run them on real nodes, with a fault each; needs root")
    parser.add_argument(
        "--fault",
        choices=[OWN, ALL, *Fault],
        default=OWN,
        help="with --real: each application's own fault, all of which its README promises something, or one of them",
    )
    parser.add_argument(
        "--repetitions",
        type=options.count(1, 1000),
        default=THESIS_REPETITIONS,
        help="placements of each application by each scheduler; the thesis made three",
    )
    parser.add_argument(
        "--budget-minutes", type=options.amount, default=ENDLESS, metavar="M", help="begin no run after this time"
    )
    parser.add_argument(
        "--json", type=options.report, help="write outcomes to this file, beside those it has of earlier runs"
    )
    parser.add_argument(
        "--lines", type=options.report, metavar="FILE", help="with --real: append a line of JSON per run to this file"
    )
    parser.add_argument("--analyse", action="store_true", help="print what --json has, without a run")
    parser.add_argument(
        "--page",
        type=Path,
        help="write the tables between the marks of this page: docs/evaluation/reference.md or docs/evaluation/eo1.md",
    )
    return parser


def _command(given: Sequence[str]) -> str:
    """Returns how to run the same again, without the names of files."""
    files = {"--json", "--lines", "--page"}
    words = [word for before, word in pairwise(["", *given]) if not {before, word} & files]
    return shlex.join(["scripts/bench", "reference", *words])


if __name__ == "__main__":
    sys.exit(main())
