"""What ping says, as figures. Pure."""

import re
from dataclasses import dataclass

_TIME = re.compile(r"\btime=([0-9.]+) ms")
_SENT = re.compile(r"(\d+) packets transmitted")
_MILLION = 1_000_000


@dataclass(frozen=True, slots=True)
class Rtt:
    """Round trips to one node; `p50_us` and `p95_us` are None when nothing came back.

    loss_ppm: pings without an answer, per million.
    """

    p50_us: int | None
    p95_us: int | None
    loss_ppm: int


def figures(text: str) -> Rtt:
    """From the output of busybox or iputils; an output without a summary counts as nothing heard."""
    times_us = sorted(round(float(value) * 1000) for value in _TIME.findall(text))
    summary = _SENT.search(text)
    sent = int(summary[1]) if summary else 0
    if not times_us or not sent:
        return Rtt(None, None, _MILLION)
    lost = max(sent - len(times_us), 0)
    return Rtt(_quantile(times_us, 0.5), _quantile(times_us, 0.95), round(_MILLION * lost / sent))


def _quantile(ordered: list[int], share: float) -> int:
    """The nearest rank: a value that was measured."""
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)]
