"""What an edge takes of the links it crosses."""

import pytest

from robotapp_api.values.quantities.bandwidth import bandwidth_bps
from robotapp_api.values.quantities.quantity import INT64_MAX


def test_what_is_written_counts_else_the_rate_times_the_bits_of_a_message() -> None:
    assert bandwidth_bps("40M", rate_hz=20, message_bytes=48) == 40_000_000
    assert bandwidth_bps(None, rate_hz=20, message_bytes=48) == 7680
    assert (
        bandwidth_bps(None, rate_hz="0.5", message_bytes=1000)
        == bandwidth_bps(None, rate_hz="500m", message_bytes=1000)
        == 4000
    )
    assert bandwidth_bps(None, rate_hz="0.0001", message_bytes=1) == 1, "rounded up, as quantities are"


def test_a_rate_or_a_size_alone_states_no_bandwidth() -> None:
    assert (
        bandwidth_bps(None, rate_hz=20, message_bytes=None) == bandwidth_bps(None, rate_hz=None, message_bytes=48) == 0
    )
    assert bandwidth_bps(None, rate_hz=20, message_bytes=0) == 0


def test_what_is_no_quantity_is_an_error() -> None:
    with pytest.raises(ValueError, match="is not a quantity"):
        bandwidth_bps("fast", rate_hz=None, message_bytes=None)


def test_more_than_can_be_is_capped_whichever_way_it_is_written() -> None:
    assert bandwidth_bps("999999999999999E", rate_hz=None, message_bytes=None) == INT64_MAX
    assert bandwidth_bps(None, rate_hz="1E", message_bytes=2_147_483_648) == INT64_MAX
