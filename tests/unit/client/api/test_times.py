"""Times as the API writes them."""

from datetime import UTC, datetime, timedelta, timezone

from hypothesis import example, given
from hypothesis import strategies as st

from robotapp_client.api.bodies import encode
from robotapp_client.api.times import as_micro_time, micro_time

ZONES = st.one_of(
    st.just(UTC), st.integers(-14 * 60, 14 * 60).map(lambda minutes: timezone(timedelta(minutes=minutes)))
)
MOMENTS = st.datetimes(datetime(1970, 1, 2), datetime(2900, 1, 1), timezones=ZONES)  # noqa: DTZ001 - hypothesis adds the zone


@example(datetime(2026, 1, 2, 3, 4, 5, 0, tzinfo=UTC))
@example(datetime(2026, 1, 2, 3, 4, 5, 7, tzinfo=UTC))
@given(MOMENTS)
def test_a_micro_time_has_six_digits_in_utc_whatever_the_zone(moment: datetime) -> None:
    there = moment.astimezone(UTC)
    assert micro_time(moment) == f"{there:%Y-%m-%dT%H:%M:%S}.{there.microsecond:06}Z"
    assert encode(as_micro_time(moment)) == f'"{micro_time(moment)}"'.encode()
