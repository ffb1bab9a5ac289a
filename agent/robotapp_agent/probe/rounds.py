"""What one round of probes measured, per peer: round-trip times, jitter and loss. Pure."""

from typing import NamedTuple


class RoundResult(NamedTuple):
    """One peer in one round. Without times nothing was answered: the peer is unreachable and `loss_ppm` is 1,000,000."""

    peer: str
    p50_us: int | None
    p95_us: int | None
    jitter_us: int | None
    """Mean difference between consecutive round trips; None with fewer than two answers."""
    loss_ppm: int
    """Probes without an answer, per million, over the last rounds in which this peer answered."""
    sent: int
    """Of this round, as is `answered`."""
    answered: int


class Round(NamedTuple):
    """All peers of one round. `discarded`: why nothing in it counts (the machine slept, the process stood still), else ""."""

    results: tuple[RoundResult, ...] = ()
    discarded: str = ""
