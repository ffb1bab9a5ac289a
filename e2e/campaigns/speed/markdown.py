"""The part of docs/performance.md that is made from results."""

import math
from collections.abc import Sequence

from campaigns.speed.console import P50, P99, number
from campaigns.speed.contestants import BARE, BARE_NO_EVENTS, KUBE_SCHEDULER, OURS
from campaigns.speed.result import Figures, Result, Row
from campaigns.speed.verdict import BARE_SHARE, CPU, RATE
from campaigns.speed.workloads import WORKLOADS

API = "API server CPU ms/pod"


def section(rows: Sequence[Row], results: Sequence[Result], *, chart: str) -> str:
    """Commands, chart, a table of rates with verdicts and one of costs."""
    return "\n".join([*_head(results), f"![pods/s of each workload]({chart})", "", *_rates(rows), "", *_costs(rows)])


def _head(results: Sequence[Result]) -> list[str]:
    options, machine = results[-1].options, results[-1].machine
    rounds = " or ".join(sorted({str(result.options["rounds"]) for result in results}))
    where = f"{options['nodes']:,} nodes, {options['prebound']:,} pods bound beforehand, {machine['cores']} cores for everything"
    return [
        f"{where}; rounds: {rounds}, medians. Made by",
        "```",
        *dict.fromkeys(result.command for result in results),
        "```",
        "and `scripts/bench page` with the files they wrote. pods/s count until the last Event is written. The bare client does the same",
        f"writes without deciding; a row is met by its ratio or by {BARE_SHARE:.0%} of the bare client, whichever is lower.",
        "",
    ]


def _rates(rows: Sequence[Row]) -> list[str]:
    lines = ["| workload | pods/s | kube-scheduler | times | target | bare client | our share | its rate without Events | verdict |",
             "|---|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for row in rows:
        ours, theirs, bare, quiet = _medians(row)
        verdict, workload = row.verdict(), WORKLOADS[row.workload]
        told = "met" if verdict.met else "; ".join(verdict.missed)
        cells = [workload.text, _of(ours, RATE), _of(theirs, RATE), number(verdict.rate_ratio)]
        cells += [f"{workload.targets.rate:g}", _of(bare, RATE), _percent(verdict.bare_share), _of(quiet, RATE), told]
        lines.append(_line(cells))
    return lines


def _costs(rows: Sequence[Row]) -> list[str]:
    lines = ["Milliseconds of CPU per pod, memory, and create → bound at 300 pods/s (kube-scheduler where it keeps up):", "",
             "| workload | CPU | kube-scheduler | ratio | target | bare client | API server, ours / theirs | MB, ours / theirs | p50 / p99 ms | kube-scheduler | bare client |",
             "|---|---|---|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for row in rows:
        ours, theirs, bare, _ = _medians(row)
        ratio, target = row.verdict().cpu_ratio, WORKLOADS[row.workload].targets.cpu
        cells = [
            row.workload,
            _of(ours, CPU),
            _of(theirs, CPU),
            f"1/{number(ratio)}",
            f"1/{target:g}" if target else "",
        ]
        cells += [_of(bare, CPU), *(f"{_of(ours, name)} / {_of(theirs, name)}" for name in (API, "RSS MB"))]
        cells += [f"{_of(each, P50)} / {_of(each, P99)}" if P50 in each else "" for each in (ours, theirs, bare)]
        lines.append(_line(cells))
    return lines


def _medians(row: Row) -> tuple[Figures, ...]:
    return tuple(row.median(each.name) for each in (OURS, KUBE_SCHEDULER, BARE, BARE_NO_EVENTS))


def _of(figures: Figures, name: str) -> str:
    return number(figures.get(name, math.nan))


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{share:.0%}"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
