"""Estimates how long a plan of steps still takes. Pure.

Every step has an expected duration: what it took before on this machine, else its share of a shipped table. The steps that
have finished show how fast this run is, and scale the rest.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

_PRIOR_S: Final = 5.0
"""The expectations weigh as much as a finished step of this length: a first step of one second proves little about the rest."""
_GRACE_SHARE: Final = 0.1
_GRACE_S: Final = 2.0
_MINUTES_FROM_S: Final = 90.0


@dataclass(frozen=True, slots=True)
class Standing:
    """Progress of a plan in seconds."""

    finished_expected_s: float
    finished_took_s: float
    running_expected_s: float
    running_s: float
    """Since the running step began."""
    ahead_expected_s: float
    """Of all steps after the running one."""


def expect_durations(
    names: Iterable[str], table: Mapping[str, float], measured: Mapping[str, float], *, unmeasured_pace: float
) -> dict[str, float]:
    """Returns the seconds each name should take: as measured, else as in `table` at the pace of what was measured.

    `unmeasured_pace` is the pace of a machine on which nothing of the table was measured.
    """
    compared = [name for name in measured if name in table]
    compared_s = sum(table[name] for name in compared)
    pace = sum(measured[name] for name in compared) / compared_s if compared_s else unmeasured_pace
    return {name: measured[name] if name in measured else table[name] * pace for name in names}


def measure_pace(standing: Standing) -> float:
    """Returns the seconds that one expected second takes, by the finished steps and by a running one that is late."""
    late_s = standing.finished_took_s + standing.running_s + _PRIOR_S
    late_pace = late_s / (standing.finished_expected_s + standing.running_expected_s + _PRIOR_S)
    return max(_measure_finished_pace(standing), late_pace)


def predict_running_s(standing: Standing) -> float:
    """Returns how long the running step should take as a whole, by the pace of the finished ones."""
    return standing.running_expected_s * _measure_finished_pace(standing)


def predict_remaining_s(standing: Standing) -> float:
    """Returns the seconds until the last step ends. A step that is late counts as ending now, and makes those after it longer."""
    return max(predict_running_s(standing) - standing.running_s, 0.0) + _predict_ahead_s(standing)


def is_late(standing: Standing) -> bool:
    """Returns whether the running step has outrun its estimate, so that nobody can say when it ends."""
    return standing.running_s > predict_running_s(standing) * (1 + _GRACE_SHARE) + _GRACE_S


def describe_remaining(standing: Standing) -> str:
    """Returns the time left in words; of a late step how long it has run, because its end is unknown."""
    if is_late(standing):
        ahead_s = _predict_ahead_s(standing)
        rest = f", then {_round_duration(ahead_s)}" if ahead_s >= 1 else ""
        return f"longer than expected, {standing.running_s:.0f} s so far{rest}"
    remaining_s = predict_remaining_s(standing)
    return f"{_round_duration(remaining_s)} left" if remaining_s >= 1 else "nearly done"


def _measure_finished_pace(standing: Standing) -> float:
    return (standing.finished_took_s + _PRIOR_S) / (standing.finished_expected_s + _PRIOR_S)


def _predict_ahead_s(standing: Standing) -> float:
    return standing.ahead_expected_s * measure_pace(standing)


def _round_duration(seconds: float) -> str:
    return f"about {seconds / 60:.0f} min" if seconds >= _MINUTES_FROM_S else f"about {seconds:.0f} s"
