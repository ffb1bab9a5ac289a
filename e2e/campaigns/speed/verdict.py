"""Did the row meet its target? Pure: medians in, texts out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from campaigns.speed.workloads import Targets

BARE_SHARE = 0.85
"""Whoever reaches this share of what the bare client does leaves nothing to gain: the API server is the limit."""
RATE, CPU, P99 = "pods/s", "scheduler CPU ms/pod", "create→bound p99 ms"
Figures = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Verdict:
    """`missed` says what fell short; ratios are NaN where nobody was measured to compare with."""

    rate_ratio: float
    cpu_ratio: float
    bare_share: float
    p99_above_ms: float
    missed: tuple[str, ...]

    @property
    def met(self) -> bool:
        return not self.missed


def judge(targets: Targets, ours: Figures, theirs: Figures, bare: Figures) -> Verdict:
    """Rate: the target's multiple of theirs, or the share of the bare client's, whichever is lower. CPU, p99: as stated."""
    rate_ratio, bare_share = _over(ours, theirs, RATE), _over(ours, bare, RATE)
    cpu_ratio = _over(theirs, ours, CPU)
    above_ms = ours.get(P99, math.nan) - bare.get(P99, math.nan)
    missed = [f"{int(count)} pods never bound"] if (count := ours.get("never bound")) else []
    if rate_ratio < targets.rate and not bare_share >= BARE_SHARE:
        missed.append(f"{rate_ratio:.1f} times instead of {targets.rate:g} or {BARE_SHARE:.0%} of the bare client")
    if targets.cpu and cpu_ratio < targets.cpu:
        missed.append(f"CPU 1/{cpu_ratio:.1f} instead of 1/{targets.cpu:g}")
    if targets.p99_above_ms and above_ms > targets.p99_above_ms:
        missed.append(f"p99 {above_ms:.0f} ms above the bare client's instead of {targets.p99_above_ms:g} ms")
    return Verdict(rate_ratio, cpu_ratio, bare_share, above_ms, tuple(missed))


def _over(one: Figures, other: Figures, name: str) -> float:
    if name not in one or not other.get(name):
        return math.nan
    return one[name] / other[name]
