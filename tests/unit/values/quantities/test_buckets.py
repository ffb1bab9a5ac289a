"""Buckets that fill with time."""

from robotapp_api.values.quantities.buckets import MOST_KEYS, Buckets


def test_a_bucket_gives_its_burst_and_then_its_rate() -> None:
    now = [0.0]
    buckets = Buckets(per_s=2, burst=3, clock=lambda: now[0])
    assert [buckets.wait_s("a") for _ in range(4)] == [0, 0, 0, 0.5]
    assert buckets.wait_s("b") == 0
    now[0] = 0.5
    assert [buckets.wait_s("a") for _ in range(2)] == [0, 0.5]
    for number in range(MOST_KEYS + 10):
        buckets.wait_s(number)
    assert repr(buckets) == f"<Buckets 2/s, {MOST_KEYS} keys>"
