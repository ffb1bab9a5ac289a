"""The thesis' scenarios on random clusters, under our scheduler and kube-scheduler in one control plane.

Each repetition draws a cluster of 3 to --most-nodes nodes with zones, hardware and load, and plays all scenarios in random
order, each under both schedulers with the same draw. Nodes and kubelets are simulated; the control plane, both schedulers and
our operator are real. `--first N --repetitions 1` with the same seed gives repetition N again.
"""

import argparse
import json
import os
import platform
import re
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from campaigns.common import options
from campaigns.common.figures import percentile
from campaigns.scenarios.campaign import Campaign, Outcome
from campaigns.scenarios.catalogue import SCENARIOS, Scenario
from campaigns.scenarios.contenders import KUBE_SCHEDULER, OURS, Contender
from campaigns.speed.page import replaced
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product

HEADS: Final = (
    "scenario", "thesis", "what is counted", "robotapp: runs", "robotapp: counted", "kube-scheduler: runs",
    "kube-scheduler: counted",
)  # fmt: skip
TEXTS: Final = frozenset(HEADS[:3])
HANDOVER: Final = "handover_ms"
NOTHING: Final = "-"


@dataclass(slots=True)
class Report:
    """What was run, and what came of it."""

    command: str
    options: Mapping[str, Any]
    machine: Mapping[str, str]
    outcomes: list[Outcome] = field(default_factory=list)

    @property
    def missed(self) -> list[Outcome]:
        """Runs under our scheduler that did not keep every promise."""
        return [each for each in self.outcomes if each.contender == OURS.name and not each.verdict.met]

    def write(self, path: Path) -> None:
        found = [asdict(each) for each in self.outcomes]
        head = {"command": self.command, "options": dict(self.options), "machine": dict(self.machine)}
        path.write_text(json.dumps({**head, "outcomes": found}, indent=2) + "\n")

    def of(self, scenario: Scenario, contender: Contender) -> list[Outcome]:
        return [each for each in self.outcomes if (each.scenario, each.contender) == (scenario.name, contender.name)]

    def played(self) -> list[Scenario]:
        """Scenarios with an outcome, in the order of the catalogue."""
        return [each for each in SCENARIOS.values() if self.of(each, OURS)]


def line(outcome: Outcome) -> str:
    """One run, as it is told while the campaign goes on."""
    verdict = outcome.verdict
    word = "kept  " if verdict.met else "MISSED" if outcome.contender == OURS.name else "other "
    kept = f"{verdict.kept}/{verdict.of}"
    where = f"{outcome.repetition:4} {outcome.nodes:4} nodes  {outcome.contender:15}{outcome.scenario:14}"
    return f"{word} {where}{kept:>8}{outcome.seconds:7.1f} s  {verdict.reason}".rstrip()


def table(report: Report) -> Table:
    made = Table(title="the thesis' scenarios, runs in which every promise was kept")
    for head in HEADS:
        made.add_column(head, justify="left" if head in TEXTS else "right")
    for scenario in report.played():
        made.add_row(*_cells(report, scenario))
    return made


def section(report: Report) -> str:
    """The part of docs/evaluation.md between its marks."""
    sizes = sorted(each.nodes for each in report.outcomes)
    options = report.options
    where = f"{sizes[0]} to {sizes[-1]} nodes (median {percentile(sizes, 50):.0f}), {report.machine['cores']} cores for everything"
    lines = [
        f"{options['repetitions']} repetitions, seed {options['seed']}, {where}. Made by",
        "```",
        report.command,
        "```",
        "",
    ]
    lines += [_row(HEADS), _row(["---"] * len(HEADS))]
    lines += [_row(_cells(report, scenario)) for scenario in report.played()]
    return "\n".join([*lines, "", *_handovers(report), *_misses(report)]).rstrip()


def _cells(report: Report, scenario: Scenario) -> list[str]:
    cells = [scenario.text, scenario.section, scenario.counted]
    for contender in (OURS, KUBE_SCHEDULER):
        found = report.of(scenario, contender)
        met = sum(each.verdict.met for each in found)
        kept, of = sum(each.verdict.kept for each in found), sum(each.verdict.of for each in found)
        cells += [f"{met}/{len(found)}", f"{kept}/{of}"] if found else [NOTHING, NOTHING]
    return cells


def _handovers(report: Report) -> Iterable[str]:
    """How long it took until the next holder of a device ran."""
    for scenario in report.played():
        taken_ms = [
            each.verdict.figures[HANDOVER] for each in report.of(scenario, OURS) if HANDOVER in each.verdict.figures
        ]
        if taken_ms:
            p50, most = percentile(taken_ms, 50), max(taken_ms)
            yield f"- {scenario.name}: the second runs {p50:.0f} ms after the first was deleted (median), {most:.0f} ms at most"


def _misses(report: Report) -> Iterable[str]:
    for each in report.missed:
        yield f"- missed: {each.scenario}, repetition {each.repetition}, {each.nodes} nodes: {each.verdict.reason}"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


BEGIN, END = "<!-- scenarios: made by scripts/bench scenarios --page -->", "<!-- scenarios: end -->"
WIDTH = 180


def main(argv: Sequence[str] | None = None) -> int:
    parser = _parser()
    arguments = parser.parse_args(argv)
    chosen = [each for each in SCENARIOS.values() if re.search(arguments.only, each.name)]
    if not chosen:
        parser.error(f"no scenario is called so; there are: {', '.join(SCENARIOS)}")
    given = {"repetitions": arguments.repetitions, "first": arguments.first, "seed": arguments.seed,
             "most_nodes": arguments.most_nodes, "only": arguments.only}  # fmt: skip
    machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": str(os.cpu_count())}
    report = Report(_command(sys.argv[1:] if argv is None else argv), given, machine)

    def note(outcome: Outcome) -> None:
        report.outcomes.append(outcome)
        print(line(outcome), file=sys.stderr, flush=True)

    with ControlPlane() as cp:
        product.install(cp)
        try:
            campaign = Campaign(cp, chosen, seed=arguments.seed, most_nodes=arguments.most_nodes)
            campaign.run(range(arguments.first, arguments.first + arguments.repetitions), note)
        finally:
            if arguments.json:
                report.write(arguments.json)
    Console(width=WIDTH).print(table(report))
    if arguments.page:
        arguments.page.write_text(replaced(arguments.page.read_text(), section(report), begin=BEGIN, end=END))
    return 1 if report.missed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="scripts/bench scenarios", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.epilog = "scenarios:\n" + "\n".join(f"  {each.name:16}{each.text}" for each in SCENARIOS.values())
    parser.add_argument("--repetitions", type=options.count(1), default=5)
    parser.add_argument("--first", type=options.count(0), default=0, metavar="N", help="number of the first repetition")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-nodes", type=options.count(3, 1000), default=200)
    parser.add_argument("--only", default="", help="scenarios whose name this regular expression finds")
    parser.add_argument("--json", type=options.report, help="write every outcome to this file")
    parser.add_argument("--page", type=Path, help="write the table between the marks of this page: docs/evaluation.md")
    return parser


def _command(given: Sequence[str]) -> str:
    """How to run the same again; where the files went is left out."""
    files = {"--json", "--page"}
    kept = [word for before, word in pairwise(["", *given]) if not {before, word} & files]
    return shlex.join(["scripts/bench", "scenarios", *kept])


if __name__ == "__main__":
    sys.exit(main())
