"""What an edge takes of the links it crosses, and what a link carries."""

from robotapp_api.values.quantities.quantity import INT64_MAX, MAX_LENGTH, parse_bytes, parse_milli


def bandwidth_bps(bandwidth: str | int | None, *, rate_hz: str | int | None, message_bytes: int | None) -> int:
    """Bits per second: `bandwidth`, else `rate_hz` messages of `message_bytes`; 0 where neither is stated. Raises ValueError.

    Capped at int64, as quantities are: the planner's worker can be sent no greater number.
    """
    if bandwidth is not None:
        return parse_bytes(bandwidth)
    if rate_hz is None or message_bytes is None:
        return 0
    return min(-(-parse_milli(rate_hz) * 8 * message_bytes // 1000), INT64_MAX)


def parse_link_bandwidth(text: str) -> int:
    """Bit/s of the node annotation robotics.io/link-bandwidth. Raises ValueError on anything but an amount of 0 or more."""
    found = parse_bytes(text)
    if found < 0:
        raise ValueError(f"{text[:MAX_LENGTH]!r} is negative; write for example 40M")
    return found
