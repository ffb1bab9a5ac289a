"""Sets of domain ids as people write them: `1-101,215-232`."""

import re
from collections.abc import Iterable
from functools import lru_cache
from typing import Final

from robotapp_api.model.names import SAFE_IDS

MAX_ID: Final = 232
_RANGE: Final = re.compile(r"([0-9]{1,3})(?:-([0-9]{1,3}))?")


@lru_cache(maxsize=256)
def parse_ids(text: str) -> tuple[int, ...]:
    """Ids in ascending order; an empty text is no id. Raises ValueError unless the ranges ascend, do not overlap and end at 232."""
    ids: list[int] = []
    for part in text.split(",") if text else ():
        match = _RANGE.fullmatch(part)
        if match is None:
            raise ValueError(f"{part!r} in {text!r} is not a range of ids; write for example 1-101,215-232")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first or last > MAX_ID or (ids and first <= ids[-1]):
            raise ValueError(f"{part!r} in {text!r}: ranges must ascend without overlap, up to {MAX_ID}")
        ids.extend(range(first, last + 1))
    return tuple(ids)


def format_ids(ids: Iterable[int]) -> str:
    """The ids as ascending ranges, the way `parse_ids` reads them."""
    ranges: list[list[int]] = []
    for number in sorted(set(ids)):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in ranges)


def is_safe_id(number: int) -> bool:
    """Whether any app may ask for this domain id; another one needs `allowUnsafeDomain`, or a pool that hands it out."""
    return number in parse_ids(SAFE_IDS)
