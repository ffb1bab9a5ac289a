"""Figures of one deployment from the round trips that its operator program wrote down. Pure."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from campaigns.common.figures import percentile
from campaigns.teleop.design import DEADLINE_MS

RATE_HZ: Final = 20
SETTLE_S: Final = 1.0
"""Time between the first command with an answer and the window."""
WINDOW_S: Final = 8.0
CYCLES: Final = round(RATE_HZ * WINDOW_S)
LOST_MS: Final = 1000.0
"""What the round trip of a lost command counts as: the program gives up after this time."""
NO_TRIP_S: Final = 45.0
"""Time after which a deployment without a round trip is given up."""


@dataclass(frozen=True, slots=True)
class Command:
    """A command by the wall clock of its sender; without a round trip it was lost."""

    sent_s: float
    rtt_ms: float | None

    @property
    def answered_s(self) -> float:
        return self.sent_s + (math.inf if self.rtt_ms is None else self.rtt_ms / 1000)


@dataclass(frozen=True, slots=True)
class Figures:
    """Result of one deployment. `sent` and `answered` count the commands of the window."""

    first_trip_s: float
    p50_ms: float
    p95_ms: float
    p99_ms: float
    missed_share: float
    sent: int
    answered: int


NO_TRIP: Final = Figures(NO_TRIP_S, LOST_MS, LOST_MS, LOST_MS, missed_share=1.0, sent=0, answered=0)
"""Result of a deployment that was given up."""


def read_commands(text: str) -> list[Command]:
    """Returns the rows of the program's CSV in the order of sending; a row that is still being written is left out."""
    complete, _, _ = text.rpartition("\n")
    rows = (line.split(",") for line in complete.splitlines()[1:])
    commands = [Command(float(row[0]), float(row[1]) if row[1] else None) for row in rows if len(row) == 2]
    return sorted(commands, key=lambda command: command.sent_s)


def find_window(commands: Iterable[Command]) -> tuple[float, float] | None:
    """Returns begin and end of the window by the wall clock; None before the first answer."""
    first = next((command for command in commands if command.rtt_ms is not None), None)
    return (first.sent_s + SETTLE_S, first.sent_s + SETTLE_S + WINDOW_S) if first else None


def measure(commands: Sequence[Command], *, applied_s: float) -> Figures:
    """Computes the figures of a deployment that was applied at a time of the wall clock."""
    window = find_window(commands)
    if window is None:
        return NO_TRIP
    begin_s, end_s = window
    in_window = [command for command in commands if begin_s <= command.sent_s < end_s]
    trips_ms = [LOST_MS if command.rtt_ms is None else min(command.rtt_ms, LOST_MS) for command in in_window]
    return Figures(
        first_trip_s=min(command.answered_s for command in commands) - applied_s,
        p50_ms=_find_percentile(trips_ms, 50),
        p95_ms=_find_percentile(trips_ms, 95),
        p99_ms=_find_percentile(trips_ms, 99),
        missed_share=compute_missed_share(trips_ms),
        sent=len(in_window),
        answered=sum(command.rtt_ms is not None for command in in_window),
    )


def compute_missed_share(trips_ms: Sequence[float]) -> float:
    """Returns the share of the window's cycles without an answer in time; a timer's phase may hide one cycle."""
    in_time = sum(trip_ms <= DEADLINE_MS for trip_ms in trips_ms)
    allowance = 1 if len(trips_ms) < CYCLES else 0
    return max(CYCLES - allowance - in_time, 0) / CYCLES


def _find_percentile(trips_ms: Sequence[float], percent: float) -> float:
    return percentile(trips_ms, percent) if trips_ms else LOST_MS
