"""What `scripts/bench teleop` found, as data and as text."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ros_nodes.trips import TRIP, Row, percentile, summarise

REAL = (
    "real: kubelets, containers and network namespaces; Cyclone DDS in every pod; round trips as the operator's program measures them;"
    " our operator, scheduler and node agents as pods of the chart; kube-scheduler as it is"
)
SIMULATED = (
    "simulated: distances (a switch in user space holds each frame back, one way, as set per pair of nodes); the robot and its operator"
    " (programs that answer at once). All nodes and both schedulers share the CPUs of this machine: absolute times are its own, the"
    " comparison is what counts"
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of all apps of one scheduler together, in one run."""

    scheduler: str
    nodes: dict[str, str]
    """Where each app's operator side went."""
    sent: int
    missed: int
    p50_us: int | None
    p95_us: int | None
    p99_us: int | None

    @property
    def missed_share(self) -> float:
        return self.missed / self.sent if self.sent else 1.0


@dataclass(frozen=True, slots=True)
class Spread:
    """Over the runs that have the figure; None when none has."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, values: Sequence[float | None]) -> "Spread | None":
        known = [each for each in values if each is not None]
        return cls(statistics.median(known), min(known), max(known)) if known else None


def order(schedulers: tuple[str, str], rounds: int) -> list[str]:
    """A B, B A, A B …: what changes on the machine meanwhile meets both alike."""
    one, other = schedulers
    return [name for turn in range(rounds) for name in ((one, other), (other, one))[turn % 2]]


def outcome(
    scheduler: str, told: Mapping[str, tuple[str, Sequence[Row]]], *, deadline_us: int, settle_us: int
) -> Outcome:
    """`told` has the node of its operator side and the rows of every app."""
    summaries = [summarise(rows, deadline_us=deadline_us, settle_us=settle_us) for _, rows in told.values()]
    rtts = sorted(
        row.rtt_us
        for _, rows in told.values()
        for row in rows
        if row.kind == TRIP and row.rtt_us is not None and row.at_us >= settle_us
    )
    return Outcome(
        scheduler=scheduler,
        nodes={name: node for name, (node, _) in told.items()},
        sent=sum(each.sent for each in summaries),
        missed=sum(each.missed for each in summaries),
        p50_us=percentile(rtts, 50),
        p95_us=percentile(rtts, 95),
        p99_us=percentile(rtts, 99),
    )


def spreads(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Spread | None]]:
    """By scheduler and figure, times in µs, `missed` a share."""
    found = {}
    for scheduler in dict.fromkeys(each.scheduler for each in outcomes):
        runs = [each for each in outcomes if each.scheduler == scheduler]
        found[scheduler] = {
            "p50_us": Spread.of([each.p50_us for each in runs]),
            "p95_us": Spread.of([each.p95_us for each in runs]),
            "p99_us": Spread.of([each.p99_us for each in runs]),
            "missed": Spread.of([each.missed_share for each in runs]),
        }
    return found


def line(each: Outcome) -> str:
    """One run."""
    times = ", ".join(
        f"{name} {value / 1000:.1f} ms" if value is not None else f"{name} none"
        for name, value in (("p50", each.p50_us), ("p95", each.p95_us), ("p99", each.p99_us))
    )
    return (
        f"{each.scheduler}: {times}, missed {each.missed_share:.1%}; operator sides on {', '.join(each.nodes.values())}"
    )


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Medians over the runs, least and most in brackets."""
    lines = [f"{'medians (least to most)':25}{'runs':>5}{'p50 ms':>20}{'p95 ms':>20}{'p99 ms':>20}{'missed':>26}"]
    for scheduler, figures in spreads(outcomes).items():
        runs = sum(each.scheduler == scheduler for each in outcomes)
        times = "".join(f"{_ms(figures[name]):>20}" for name in ("p50_us", "p95_us", "p99_us"))
        lines.append(f"{scheduler:25}{runs:>5}{times}{_share(figures['missed']):>26}")
    return lines


def as_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    figures = {
        scheduler: {
            name: (spread.median, spread.least, spread.most) if spread else None for name, spread in each.items()
        }
        for scheduler, each in spreads(outcomes).items()
    }
    return {"real": REAL, "simulated": SIMULATED, "median_least_most": figures}


def _ms(spread: Spread | None) -> str:
    if spread is None:
        return "-"
    return f"{spread.median / 1000:.1f} ({spread.least / 1000:.1f}-{spread.most / 1000:.1f})"


def _share(spread: Spread | None) -> str:
    return f"{spread.median:.1%} ({spread.least:.1%}-{spread.most:.1%})" if spread else "-"
