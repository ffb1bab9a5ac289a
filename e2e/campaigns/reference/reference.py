"""The ten reference applications under our scheduler and kube-scheduler: placement on simulated nodes, or with --real what they do.

Without --real each application is placed on eight simulated nodes: where its components go, which of the promises of its RobotApp
hold there, and which plugins decided, beside the thesis' tables 4.1 and 4.3. With --real it runs on real nodes with everything of
the chart as pods: its own figures, and whether it keeps what its README promises through one fault. A file given by --json keeps
the outcomes of other applications from earlier runs, so that a long comparison can be made in short turns.
"""

import argparse
import os
import platform
import shlex
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

from rich.console import Console
from rich.table import Table

from campaigns.common import options
from campaigns.common.output import save, say
from campaigns.reference import report as reports
from campaigns.reference.catalogue import (
    GENERATIONS,
    SCENARIOS,
    SCHEDULERS,
    THESIS_REPETITIONS,
    THESIS_ROUND_TRIPS,
    Scenario,
)
from campaigns.reference.placement import Placement
from campaigns.reference.profiles import infer
from campaigns.reference.real_nodes import describe, run_trial, start_cluster
from campaigns.reference.report import Report, read_report
from campaigns.reference.simulated_nodes import place_all, start_rig
from robotapp_testbed.real import UnavailableError, prerequisites

ALL = "all"
OUTAGE_S = 60.0
"""For how long the navigation's robot is offline in the bench; the other faults have their own times."""
WIDTH = 200


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    scenarios = list(SCENARIOS.values()) if arguments.app == ALL else [SCENARIOS[arguments.app]]
    generations = [arguments.ros] if arguments.ros else list(GENERATIONS)
    report = read_report(arguments.json)
    report.commands = [*dict.fromkeys([*report.commands, _command(sys.argv[1:] if argv is None else argv)])]
    report.machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": str(os.cpu_count())}

    def keep() -> None:
        save(arguments.json, report.to_json())

    if arguments.real:
        try:
            prerequisites.require()
        except UnavailableError as problem:
            say(str(problem))
            return 1
        for scenario in scenarios:
            _try_all(scenario, generations, report, keep)
    else:
        _place_all(scenarios, generations, arguments.repetitions, report, keep)
    _print(report, real=arguments.real)
    if arguments.page:
        arguments.page.write_text(reports.write_page(report, arguments.page.read_text()))
    problems = reports.list_broken(report)
    for sentence in problems:
        say(sentence)
    return 1 if problems else 0


def _try_all(scenario: Scenario, generations: Sequence[int], report: Report, keep: Callable[[], None]) -> None:
    """Plays the applications of one scenario under both schedulers, on one cluster."""
    with start_cluster(scenario, generations) as cp:
        for ros in generations:
            for contender in SCHEDULERS:
                trial = run_trial(
                    cp, scenario, ros, contender, outage_s=OUTAGE_S if scenario.name == "navigation" else None
                )
                say(describe(trial))
                report.note_trial(trial)
                keep()


def _place_all(
    scenarios: Sequence[Scenario],
    generations: Sequence[int],
    repetitions: int,
    report: Report,
    keep: Callable[[], None],
) -> None:
    def note(placement: Placement) -> None:
        kept = f"{placement.kept}/{len(placement.promises)}"
        say(f"{placement.app} under {placement.scheduler}: {kept} kept; {reports.describe_nodes(placement.nodes)}")
        report.note_placement(placement)
        keep()

    for scenario in scenarios:
        for ros in generations:
            report.profiles[scenario.app(ros)] = infer(scenario.app(ros))
    with start_rig() as rig:
        place_all(rig, scenarios, generations, repetitions, note)


def _print(report: Report, *, real: bool) -> None:
    console = Console(width=WIDTH)
    if real:
        console.print(_table("behaviour on real nodes", reports.TRIAL_HEADS, reports.tabulate_trials(report.trials)))
        for row in THESIS_ROUND_TRIPS:
            console.print(
                f"thesis, table 4.2, both nodes in one pod: {row.scheduler}, {row.count} round trips, mean {row.mean_ms} ms, "
                f"p95 {row.p95_ms} ms, p99 {row.p99_ms} ms"
            )
        return
    rows = reports.tabulate_placements(report.placements)
    console.print(_table("placement on simulated nodes", reports.PLACEMENT_HEADS, rows))
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
    parser.add_argument("--app", choices=[ALL, *SCENARIOS], default=ALL, help="one scenario instead of all five")
    parser.add_argument("--ros", type=int, choices=GENERATIONS, help="one generation instead of both")
    parser.add_argument("--real", action="store_true", help="run them on real nodes, with one fault each; needs root")
    parser.add_argument(
        "--repetitions",
        type=options.count(1, 100),
        default=THESIS_REPETITIONS,
        help="placements of each application by each scheduler; the thesis made three",
    )
    parser.add_argument(
        "--json", type=options.report, help="write outcomes to this file, beside those it has of other applications"
    )
    parser.add_argument(
        "--page", type=Path, help="write the tables between the marks of this page: docs/evaluation/reference.md"
    )
    return parser


def _command(given: Sequence[str]) -> str:
    """Returns how to run the same again, without the names of files."""
    files = {"--json", "--page"}
    words = [word for before, word in pairwise(["", *given]) if not {before, word} & files]
    return shlex.join(["scripts/bench", "reference", *words])


if __name__ == "__main__":
    sys.exit(main())
