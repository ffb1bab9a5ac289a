"""Back-off delays."""

from hypothesis import given
from hypothesis import strategies as st

from robotapp_client.api.backoff import Backoff


def test_delays_double_up_to_the_cap() -> None:
    backoff = Backoff(base_s=1, cap_s=5, jitter=0)
    assert [backoff.next_s() for _ in range(5)] == [1, 2, 4, 5, 5]


def test_reset_starts_over() -> None:
    backoff = Backoff(base_s=1, cap_s=5, jitter=0)
    backoff.next_s()
    backoff.next_s()
    backoff.reset()
    assert backoff.next_s() == 1
    assert backoff.attempt == 1


def test_the_server_may_ask_for_more_but_not_for_less() -> None:
    backoff = Backoff(base_s=1, cap_s=5, jitter=0)
    assert backoff.next_s(at_least_s=7) == 7
    assert backoff.next_s(at_least_s=0.1) == 2


@given(chance=st.floats(0, 1), attempts=st.integers(1, 3000))
def test_jitter_only_shortens_and_no_number_of_attempts_overflows(chance: float, attempts: int) -> None:
    backoff = Backoff(base_s=0.5, cap_s=30, jitter=0.5, uniform=lambda: chance)
    for _ in range(attempts):
        assert 0.25 <= backoff.next_s() <= 30
