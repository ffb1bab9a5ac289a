"""What the bench says while it runs, and the table at the end."""

import math
import sys
import time
from collections.abc import Callable, Sequence

from rich.console import Console
from rich.table import Table

from campaigns.speed.contestants import BARE, BARE_NO_EVENTS, KUBE_SCHEDULER, OURS
from campaigns.speed.result import Figures, Row
from campaigns.speed.verdict import CPU, RATE

P50, P99 = (f"create→bound p{percent} ms" for percent in (50, 99))
STEP_S = 0.5
WIDTH = 180


def show(what: str, total: int) -> Callable[[int], None]:
    """A counter that rewrites its line; nothing where nobody watches."""
    if not sys.stderr.isatty():
        return lambda _: None
    shown_s = 0.0

    def update(count: int) -> None:
        nonlocal shown_s
        if count == total or time.monotonic() - shown_s > STEP_S:
            shown_s = time.monotonic()
            print(f"\r  {count}/{total} {what}", end="\n" if count == total else "", file=sys.stderr, flush=True)

    return update


def line(figures: Figures) -> str:
    return ", ".join(f"{name} {number(value)}" for name, value in figures.items())


def table(rows: Sequence[Row]) -> Table:
    """One line per row; `ratio` and `1/` are against kube-scheduler, ms above are against the bare client."""
    made = Table(title="robotapp / kube-scheduler, medians")
    heads = ("workload", "pods/s", "ratio", "bare", "no Events", "CPU ms", "1/", "API ms", "RSS MB", "p50 ms", "p99 ms",
             "bare p99", "verdict")  # fmt: skip
    for head in heads:
        made.add_column(head, justify="left" if head in {"workload", "verdict"} else "right", no_wrap=True)
    for row in rows:
        made.add_row(*_cells(row))
    return made


def _cells(row: Row) -> list[str]:
    ours, theirs, bare, quiet = (row.median(each.name) for each in (OURS, KUBE_SCHEDULER, BARE, BARE_NO_EVENTS))
    verdict = row.verdict()
    pairs = [_pair(ours, theirs, name) for name in (RATE, CPU, "API server CPU ms/pod", "RSS MB", P50, P99)]
    rate, cpu, api, rss, p50, p99 = pairs
    ratios = number(verdict.rate_ratio), number(verdict.cpu_ratio)
    rates = number(bare.get(RATE, math.nan)), number(quiet.get(RATE, math.nan))
    told = "[green]met" if verdict.met else "[red]missed"
    return [
        row.workload,
        rate,
        ratios[0],
        *rates,
        cpu,
        ratios[1],
        api,
        rss,
        p50,
        p99,
        number(bare.get(P99, math.nan)),
        told,
    ]


def _pair(ours: Figures, theirs: Figures, name: str) -> str:
    return f"{number(ours.get(name, math.nan))} / {number(theirs.get(name, math.nan))}"


def number(value: float) -> str:
    """Three figures are all a measurement has.

    >>> number(1234.5), number(0.1234), number(math.nan)
    ('1,234', '0.123', '-')
    """
    if math.isnan(value):
        return "-"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def print_table(rows: Sequence[Row]) -> None:
    """The table at whatever width it needs, then what fell short."""
    console = Console(soft_wrap=True, width=WIDTH if not sys.stdout.isatty() else None)
    console.print(table(rows))
    for row in rows:
        for text in row.verdict().missed:
            console.print(f"{row.workload}: {text}", highlight=False)
