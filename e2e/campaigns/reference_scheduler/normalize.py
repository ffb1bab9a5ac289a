"""From raw scores to 0…100."""

Scores = dict[str, int]


def as_is(raw: Scores) -> Scores:
    return dict(raw)


def by_maximum(raw: Scores) -> Scores:
    """The best gets 100, all get 0 when nobody scores."""
    top = max(raw.values(), default=0)
    return {name: 100 * value // top if top else 0 for name, value in raw.items()}


def by_maximum_reversed(raw: Scores) -> Scores:
    """0 gets 100, all get 100 when nobody scores."""
    top = max(raw.values(), default=0)
    return {name: 100 - 100 * value // top if top else 100 for name, value in raw.items()}


def by_span(raw: Scores) -> Scores:
    """Float64 in upstream's order: divide first, then times 100 (29 of 100 becomes 28)."""
    low, high = min(raw.values(), default=0), max(raw.values(), default=0)
    if high == low:
        return dict.fromkeys(raw, 0)
    return {name: int(100.0 * ((value - low) / (high - low))) for name, value in raw.items()}


def half_away_from_zero(value: float) -> int:
    """Go's math.Round."""
    whole = int(value)
    if abs(value - whole) >= 0.5:
        return whole + (1 if value > 0 else -1)
    return whole
