"""Bootstrap intervals over strata, and what an interval of a difference means. Pure; random numbers come from a fixed seed."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

RESAMPLES: Final = 10_000
SEED: Final = 41
DESCRIPTIVE: Final = 0.95
PRIMARY: Final = 1 - 0.05 / 4
"""Level of each of the four primary comparisons (Bonferroni)."""
EQUIVALENT: Final = 0.02
"""Differences of miss shares within this are called equivalent."""

Floats = NDArray[np.float64]
Statistic = Callable[..., Floats]
"""`np.mean` or `np.median`: applied along an axis."""


@dataclass(frozen=True, slots=True)
class Interval:
    value: float
    low: float
    high: float


class Verdict(StrEnum):
    """Meaning of a difference for which less is better."""

    BETTER = "better"
    BETTER_SMALL = "better, and small"
    WORSE = "worse"
    WORSE_SMALL = "worse, and small"
    EQUIVALENT = "equivalent"
    OPEN = "no difference shown"


def compute_interval(
    strata: Mapping[Hashable, Sequence[float]], statistic: Statistic, *, level: float = DESCRIPTIVE
) -> Interval:
    """Returns a statistic of all values together with its percentile interval; values are resampled within each stratum."""
    samples = [np.asarray(strata[key], dtype=float) for key in sorted(strata, key=repr) if len(strata[key])]
    if not samples:
        raise ValueError("a bootstrap needs at least one value")
    generator = np.random.default_rng(SEED)
    resamples = [np.sort(sample)[generator.integers(sample.size, size=(RESAMPLES, sample.size))] for sample in samples]
    statistics = statistic(np.concatenate(resamples, axis=1), axis=1)
    low, high = np.quantile(statistics, [(1 - level) / 2, (1 + level) / 2])
    return Interval(float(statistic(np.concatenate(samples), axis=0)), float(low), float(high))


def judge(difference: Interval, *, margin: float = EQUIVALENT) -> Verdict:
    """Names an interval of a difference of which negative values are good."""
    is_small = -margin <= difference.low and difference.high <= margin
    if difference.high < 0:
        return Verdict.BETTER_SMALL if is_small else Verdict.BETTER
    if difference.low > 0:
        return Verdict.WORSE_SMALL if is_small else Verdict.WORSE
    return Verdict.EQUIVALENT if is_small else Verdict.OPEN
