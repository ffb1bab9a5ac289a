"""Outcomes of a campaign as a table in the terminal, as a table of docs/evaluation.md, and as JSON."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from rich.table import Table

from campaigns.common.figures import percentile
from campaigns.scenarios.campaign import Outcome
from campaigns.scenarios.catalogue import SCENARIOS, Scenario
from campaigns.scenarios.contenders import KUBE_SCHEDULER, OURS, Contender

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
