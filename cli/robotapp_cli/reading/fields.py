"""Reading plain Kubernetes JSON, and showing ages and durations."""

from datetime import UTC, datetime
from typing import Any

from robotapp_api.values.quantities.duration import parse_us

Json = dict[str, Any]


def meta(obj: Json) -> Json:
    found: Json = obj.get("metadata") or {}
    return found


def status(obj: Json) -> Json:
    found: Json = obj.get("status") or {}
    return found


def label(obj: Json, name: str) -> str:
    return str((meta(obj).get("labels") or {}).get(name, ""))


def condition(obj: Json, kind: str) -> Json:
    """The condition of this type, or an empty one."""
    found = (item for item in status(obj).get("conditions") or [] if item.get("type") == kind)
    return next(found, {})


def plain(obj: Json) -> Json:
    """The object as kubectl shows it: without who wrote which field."""
    return obj | {"metadata": {key: value for key, value in meta(obj).items() if key != "managedFields"}}


def age(timestamp: str | None, now: datetime | None = None) -> str:
    """`5s`, `3m`, `4h`, `12d`, as kubectl shows ages."""
    if not timestamp:
        return ""
    return elapsed(((now or datetime.now(UTC)) - datetime.fromisoformat(timestamp)).total_seconds())


def elapsed(seconds: float) -> str:
    """The same of a number of seconds."""
    seconds = max(0, int(seconds))
    for unit, size, limit in (("s", 1, 120), ("m", 60, 7200), ("h", 3600, 172_800)):
        if seconds < limit:
            return f"{seconds // size}{unit}"
    return f"{seconds // 86_400}d"


def milliseconds(duration: str | None) -> float | None:
    """`1m30s` -> 90000.0; None for what is no duration, such as `unreachable`."""
    try:
        return parse_us(duration or "") / 1000
    except ValueError:
        return None


def short_ms(value: float | None) -> str:
    """`0.05`, `2`, `60`: three significant digits, without an exponent."""
    if value is None:
        return "?"
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
