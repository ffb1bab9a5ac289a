"""What an edge takes of the links it crosses."""

from robotapp_api.values.quantity import INT64_MAX, parse_bytes, parse_milli


def bandwidth_bps(bandwidth: str | int | None, *, rate_hz: str | int | None, message_bytes: int | None) -> int:
    """Bits per second: `bandwidth`, else `rate_hz` messages of `message_bytes`; 0 where neither is stated. Raises ValueError.

    Capped at int64, as quantities are: the planner's worker can be sent no greater number.
    """
    if bandwidth is not None:
        return parse_bytes(bandwidth)
    if rate_hz is None or message_bytes is None:
        return 0
    return min(-(-parse_milli(rate_hz) * 8 * message_bytes // 1000), INT64_MAX)
