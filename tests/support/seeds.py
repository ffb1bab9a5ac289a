"""Seeds of campaigns that take another sample every day."""

import datetime as dt
import os
from collections.abc import Iterable
from typing import Final, TypeVar

T = TypeVar("T")
TODAY: Final = "ROBOTAPP_TODAY"
"""Variable in which a run keeps the day on which it began."""
EXAMPLES: Final = "ROBOTAPP_EXAMPLES"
"""Variable: `few` makes property tests try fewer examples, as plain `scripts/test` does."""
_THIRDS: Final = 3
_FEW_SHARE: Final = 4
_FEWEST: Final = 5


def daily_seed() -> int:
    """Another number every day; ROBOTAPP_SEED repeats a given one."""
    given = os.environ.get("ROBOTAPP_SEED") or os.environ.get(TODAY) or "0"
    return int(given) or dt.datetime.now(tz=dt.UTC).toordinal()


def choose_for_today(items: Iterable[T]) -> list[T]:
    """Returns every third item: three days in a row give all of them, and so does ROBOTAPP_SAMPLES=all at once.

    Where few examples are asked for it is every ninth, at least one.
    """
    if os.environ.get("ROBOTAPP_SAMPLES") == "all":
        return list(items)
    candidates = list(items)
    step = min(_THIRDS**2, len(candidates)) if os.environ.get(EXAMPLES) == "few" else _THIRDS
    return candidates[daily_seed() % step :: step] if candidates else []


def count_examples(count: int) -> int:
    """Returns how many examples a property test tries: `count`, or a quarter of it where few are asked for."""
    if os.environ.get(EXAMPLES) == "few":
        return max(min(count, _FEWEST), count // _FEW_SHARE)
    return count
