"""Writes the speed tables of docs/performance.md and its chart: scripts/bench page out.json [more.json …]

The files are those of `scripts/bench scheduler --json`; where several have the same row, the last one counts. Everything
between the two marks in the page is replaced, the rest stays.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import escape

from campaigns.speed.console import P50, P99, number
from campaigns.speed.contestants import BARE, BARE_NO_EVENTS, KUBE_SCHEDULER, OURS
from campaigns.speed.result import Figures, Result, Row, merged, read
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


COLORS = {OURS.name: "#2b7bba", KUBE_SCHEDULER.name: "#c9832b", BARE.name: "#9aa3ab"}
LEFT, WIDTH, BAR, GAP, TOP = 190, 560, 12, 14, 40


def chart(rows: Sequence[Row]) -> str:
    """One group of bars per row, longest bar = highest rate of all."""
    rates = [{name: row.median(name).get(RATE, 0.0) for name in COLORS} for row in rows]
    most = max((value for each in rates for value in each.values()), default=0.0) or 1.0
    height = TOP + len(rows) * (len(COLORS) * BAR + GAP)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {LEFT + WIDTH + 70} {height}" font-family="sans-serif" font-size="11">',
        f'<rect width="100%" height="{height}" fill="#ffffff"/>',
        *_legend(),
    ]
    for index, (row, values) in enumerate(zip(rows, rates, strict=True)):
        top = TOP + index * (len(COLORS) * BAR + GAP)
        parts.append(f'<text x="{LEFT - 8}" y="{top + 22}" text-anchor="end">{escape(row.workload)}</text>')
        for place, (name, value) in enumerate(values.items()):
            parts += _bar(top + place * BAR, value, value / most * WIDTH, COLORS[name])
    return "\n".join([*parts, "</svg>", ""])


def _legend() -> list[str]:
    parts = [f'<text x="{LEFT}" y="24">pods/s</text>']
    for place, (name, color) in enumerate(COLORS.items()):
        x = LEFT + 60 + place * 130
        parts.append(
            f'<rect x="{x}" y="15" width="10" height="10" fill="{color}"/><text x="{x + 15}" y="24">{name}</text>'
        )
    return parts


def _bar(y: int, value: float, length: float, color: str) -> list[str]:
    return [
        f'<rect x="{LEFT}" y="{y}" width="{max(length, 0.5):.1f}" height="{BAR - 1}" fill="{color}"/>',
        f'<text x="{LEFT + length + 4:.1f}" y="{y + 10}" font-size="10">{number(value)}</text>',
    ]


BEGIN, END = "<!-- speed: made by scripts/bench page -->", "<!-- speed: end -->"
DOCS = Path(__file__).parents[3] / "docs"


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench page", description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, nargs="+", metavar="FILE")
    parser.add_argument("--page", type=Path, default=DOCS / "performance.md")
    parser.add_argument("--chart", type=Path, default=DOCS / "performance.svg")
    arguments = parser.parse_args(argv)
    results = [read(path) for path in arguments.results]
    rows = merged(results)
    arguments.chart.write_text(chart(rows))
    text = section(rows, results, chart=arguments.chart.name)
    arguments.page.write_text(replaced(arguments.page.read_text(), text))
    return 0


def replaced(page: str, text: str, *, begin: str = BEGIN, end: str = END) -> str:
    """The page with `text` between the marks. Raises ValueError when it has none."""
    before, found_begin, rest = page.partition(begin)
    _, found_end, after = rest.partition(end)
    if not found_begin or not found_end:
        raise ValueError(f"the page has no lines {begin!r} and {end!r}")
    return f"{before}{begin}\n{text}\n{end}{after}"


if __name__ == "__main__":
    sys.exit(main())
