"""Our scheduler process against an API server that costs nothing, over TLS: pods/s, CPU per pod, latency, cold start.

The stub (e2e/campaigns/free_api) is a process of its own, so the figures are the scheduler's alone. Every row is a fresh
stub and a fresh scheduler, which reads the nodes and running pods first. CPU of a burst is counted until every Event is
written and the last status has been seen. Latency runs from the watch event leaving the stub to the Binding arriving
there. Use an idle machine with two cores: one is the stub's.
"""

import argparse
import asyncio
import platform
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from campaigns.common.figures import percentile
from campaigns.common.output import save, say
from campaigns.free_api.rig import Report, Rig

BURST_S = 120.0
GROWTH = 3
"""Times as many nodes in the row that shows how the cost grows."""


@dataclass(frozen=True, slots=True)
class Target:
    """What a figure must not exceed (`most`) or must reach."""

    figure: str
    bound: float
    most: bool = True

    def missed(self, value: float) -> bool:
        return value > self.bound if self.most else value < self.bound

    def __str__(self) -> str:
        return f"{'≤' if self.most else '≥'} {self.bound:g}"


@dataclass(frozen=True, slots=True)
class Row:
    """One burst: the pods are of so many classes, in turn."""

    name: str
    classes: int
    targets: tuple[Target, ...]
    events: bool = True
    nodes: int = 1


REUSED = (Target("pods/s", 4000, most=False), Target("CPU µs/pod", 200))
OWN = (Target("CPU µs/pod", 500),)
COLD = (Target("cold start CPU s", 3.0), Target("cold start peak MB", 200))
PACED = (Target("p99 ms", 10),)
GROWN = (Target("growth", 2.0),)


def rows(pods: int) -> tuple[Row, ...]:
    return (
        Row("1 class", 1, REUSED),
        Row("20 classes", 20, REUSED),
        Row("each its own", pods, OWN),
        Row("1 class, no Events", 1, REUSED, events=False),
        Row("20 classes, no Events", 20, REUSED, events=False),
        Row("each its own, no Events", pods, OWN, events=False),
        Row(f"20 classes, {GROWTH} times the nodes", 20, GROWN, nodes=GROWTH),
    )


def main(argv: Sequence[str] | None = None) -> int:
    options = _parser().parse_args(argv)
    result = asyncio.run(run(options))
    print(report(result))
    save(options.json, result)
    return 1 if options.check and any(row["missed"] for row in result["rows"]) else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench stub", description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", type=int, default=5000)
    parser.add_argument("--placed", type=int, default=50_000, help="running pods")
    parser.add_argument("--pods", type=int, default=10_000, help="pods of a burst")
    parser.add_argument("--rate", type=float, default=300.0, help="pods per second of the latency row")
    parser.add_argument("--paced", type=int, default=6000, help="pods of the latency row; 0 leaves it out")
    parser.add_argument("--only", action="append", help="rows whose name begins so (may be repeated)")
    parser.add_argument("--json", type=Path, help="write every figure to this file")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a target is missed")
    return parser


async def run(options: argparse.Namespace) -> dict[str, Any]:
    found: list[dict[str, Any]] = []
    wanted = tuple(options.only or [""])
    for row in rows(options.pods):
        if row.name.startswith(wanted):
            figures = await _fresh(options, row)
            found.append(
                _judged(row.name, figures | _growth(row, figures, found), (*row.targets, *_cold(options, row)))
            )
    if options.paced and "latency".startswith(wanted):
        found.append(_judged("latency", await _latency(options), PACED))
    sizes = {name: getattr(options, name) for name in ("nodes", "placed", "pods", "rate", "paced")}
    return {"options": sizes, "machine": platform.machine(), "python": platform.python_version(), "rows": found}


def _cold(options: argparse.Namespace, row: Row) -> tuple[Target, ...]:
    """The targets of a cold start are for its own size."""
    return COLD if row.nodes == 1 and options.nodes <= 5000 and options.placed <= 50_000 else ()


def _growth(row: Row, figures: dict[str, float], found: list[dict[str, Any]]) -> dict[str, float]:
    """CPU per pod as a multiple of that of the same classes on fewer nodes."""
    smaller = [each for each in found if row.nodes > 1 and each["name"] == f"{row.classes} classes"]
    return {"growth": figures["CPU µs/pod"] / smaller[0]["figures"]["CPU µs/pod"]} if smaller else {}


def _judged(name: str, figures: dict[str, float], targets: Sequence[Target]) -> dict[str, Any]:
    missed = [
        f"{each.figure} {figures[each.figure]:.3g}, wanted {each}"
        for each in targets
        if each.figure in figures and each.missed(figures[each.figure])
    ]
    say(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in figures.items()))
    return {"name": name, "figures": figures, "missed": missed}


async def _fresh(options: argparse.Namespace, row: Row) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        async with Rig(Path(folder), nodes=options.nodes * row.nodes, placed=options.placed, events=row.events) as rig:
            return await burst(rig, options.pods, classes=row.classes, events=row.events) | _started(rig)


def _started(rig: Rig) -> dict[str, float]:
    found = rig.started
    return {
        "cold start CPU s": found["cpu_s"],
        "cold start wall s": found["wall_s"],
        "cold start peak MB": found["peak_rss_bytes"] / 1e6,
    }


async def burst(rig: Rig, pods: int, *, classes: int, events: bool = True) -> dict[str, float]:
    """Show so many pods at once and wait until everything about them is said."""
    before_s, stub_s = rig.cpu_s(), (await rig.report())["cpu_s"]
    await rig.order(f"burst?pods={pods}&classes={classes}")
    ended = await rig.until(lambda report: _over(report, pods, events=events), within_s=BURST_S)
    if ended["rebound"]:
        raise RuntimeError(f"{ended['rebound']} pods were bound twice")
    return {
        "pods/s": pods / ended["seconds"],
        "CPU µs/pod": 1e6 * (rig.cpu_s() - before_s) / pods,
        "stub CPU µs/pod": 1e6 * (ended["cpu_s"] - stub_s) / pods,
    }


def _over(report: Report, pods: int, *, events: bool) -> bool:
    """Every pod is bound, its Event written, its last status sent."""
    written = not events or report["events"] >= pods
    return report["bound"] == pods and report["running"] == pods and written


async def _latency(options: argparse.Namespace) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        async with Rig(Path(folder), nodes=options.nodes, placed=options.placed) as rig:
            await burst(rig, 500, classes=1)  # the first pods of a process find nothing cached
            before_s = rig.cpu_s()
            await rig.order(f"pace?pods={options.paced}&rate={options.rate}&classes=20")
            within_s = BURST_S + options.paced / options.rate
            ended = await rig.until(lambda report: _over(report, options.paced, events=True), within_s=within_s)
            waited = sorted(ended["waited_ms"])
            shares = {f"p{share:g} ms": percentile(waited, share) for share in (50, 99, 99.9)}
            return {**shares, "most ms": waited[-1], "CPU µs/pod": 1e6 * (rig.cpu_s() - before_s) / options.paced}


def report(result: dict[str, Any]) -> str:
    """A table of what matters, and what was missed."""
    heads = ("pods/s", "CPU µs/pod", "stub CPU µs/pod", "growth", "cold start CPU s", "cold start peak MB")
    lines = [f"{'':26}" + "".join(f"{head:>20}" for head in heads)]
    for row in result["rows"]:
        cells = "".join(f"{_cell(row['figures'].get(head)):>20}" for head in heads)
        lines.append(f"{row['name']:26}{cells}")
    for row in result["rows"]:
        shares = [f"{name} {value:.2f}" for name, value in row["figures"].items() if name.endswith(" ms")]
        if shares:
            lines.append(f"{result['options']['rate']:g} pods/s, event → binding: {', '.join(shares)}")
        lines += [f"missed by {row['name']}: {each}" for each in row["missed"]]
    return "\n".join(lines)


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}" if value < 100 else f"{value:.0f}"


if __name__ == "__main__":
    sys.exit(main())
