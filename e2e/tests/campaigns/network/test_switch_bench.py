"""Verdicts of `scripts/bench switch` from figures made by hand."""

from campaigns.network import switch
from campaigns.network.switch_figures import Capacity, Delay, Loss


def capacity(*, lost: int = 0) -> Capacity:
    return Capacity(payload_bytes=1408, sent=30_000, received=30_000 - lost, seconds=3, cpu_share=0.2)


GOOD = {name: capacity() for name, _, _ in switch.LOADS}


def test_what_falls_short_is_said_in_a_sentence() -> None:
    loads = {**GOOD, "20 kpps": capacity(lost=7), "200 Mbit/s": capacity(lost=9)}
    assert switch.verdict([Delay(60, -0.4, 0)], [Loss(0.05, 0.07)], loads) == [
        "60 ms: the median is -0.400 ms off, more than 0.3",
        "loss 5%: 7.00% seen, more than 20% off",
        "20 kpps: 7 frames lost",
    ]
