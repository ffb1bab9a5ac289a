from hypothesis import given
from hypothesis import strategies as st

from robotapp_testbed.real.pings import Rtt, figures

BUSYBOX = """PING 10.244.2.1 (10.244.2.1): 56 data bytes
64 bytes from 10.244.2.1: seq=0 ttl=64 time=30.500 ms
64 bytes from 10.244.2.1: seq=1 ttl=64 time=30.100 ms
64 bytes from 10.244.2.1: seq=3 ttl=64 time=44.000 ms

--- 10.244.2.1 ping statistics ---
4 packets transmitted, 3 packets received, 25% packet loss
round-trip min/avg/max = 30.100/34.866/44.000 ms
"""


def test_what_busybox_says_becomes_figures() -> None:
    assert figures(BUSYBOX) == Rtt(30_500, 44_000, 250_000)


def test_a_node_that_does_not_answer_has_no_round_trip() -> None:
    silent = "PING 10.244.2.1\n\n--- 10.244.2.1 ping statistics ---\n4 packets transmitted, 0 packets received\n"
    assert figures(silent) == figures("") == Rtt(None, None, 1_000_000)


@given(st.lists(st.floats(0.01, 5000), min_size=1, max_size=50), st.integers(0, 10))
def test_figures_are_values_that_were_measured_in_order(times_ms: list[float], lost: int) -> None:
    lines = [f"64 bytes from x: seq=0 ttl=64 time={value:.3f} ms" for value in times_ms]
    rtt = figures("\n".join([*lines, f"{len(times_ms) + lost} packets transmitted, …"]))
    measured = {round(float(f"{value:.3f}") * 1000) for value in times_ms}
    assert rtt.p50_us in measured
    assert rtt.p95_us in measured
    assert rtt.p50_us <= rtt.p95_us
    assert rtt.loss_ppm == round(1_000_000 * lost / (len(times_ms) + lost))
