"""Functions on lists: those of CEL's extensions and those that Kubernetes adds."""

import functools
import itertools
from typing import Any

from robotapp_api.values.cel.errors import EvaluationError, no_overload
from robotapp_api.values.cel.evaluation import limit_size
from robotapp_api.values.cel.operators import add
from robotapp_api.values.cel.values import ABSENT, Optional, compare, equal


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise no_overload(value)
    return value


def _integer(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise no_overload(value)
    return value


def _holds(items: list[Any], item: Any) -> bool:
    return any(equal(item, entry) for entry in items)


def sets_contains(items: Any, part: Any) -> bool:
    """Is every item of the second list in the first?"""
    return all(_holds(_list(items), item) for item in _list(part))


def sets_equivalent(first: Any, second: Any) -> bool:
    """Do both lists have the same items?"""
    return sets_contains(first, second) and sets_contains(second, first)


def sets_intersects(first: Any, second: Any) -> bool:
    """Is any item in both lists?"""
    return any(_holds(_list(second), item) for item in _list(first))


def includes(value: Any, item: Any) -> bool:
    """Does a list have the item, or is a single value equal to it?"""
    return _holds(value, item) if isinstance(value, list) else equal(value, item)


def is_sorted(items: Any) -> bool:
    """Does no item come before a smaller one?"""
    values = _list(items)
    return all(compare(first, second) <= 0 for first, second in itertools.pairwise(values))


def total(items: Any) -> Any:
    """Sum of the items, 0 of none."""
    values = _list(items)
    if any(isinstance(value, str | bytes | list) for value in values):
        raise no_overload(items)
    return functools.reduce(add, values) if values else 0


def least(items: Any) -> Any:
    """Smallest item."""
    return _extreme(items, "min", -1)


def greatest(items: Any) -> Any:
    """Largest item."""
    return _extreme(items, "max", 1)


def _extreme(items: Any, name: str, order: int) -> Any:
    if not _list(items):
        raise EvaluationError(f"{name} called on empty list")
    return functools.reduce(lambda best, item: item if compare(item, best) == order else best, items)


def index_of(items: Any, item: Any) -> int:
    """First position of the item, -1 without."""
    return next((index for index, entry in enumerate(_list(items)) if equal(entry, item)), -1)


def last_index_of(items: Any, item: Any) -> int:
    """Last position of the item, -1 without."""
    position = index_of(_list(items)[::-1], item)
    return position if position < 0 else len(items) - 1 - position


def part(items: Any, start: Any, end: Any) -> list[Any]:
    """Items from `start` up to `end`."""
    values, first_index, end_index = _list(items), _integer(start), _integer(end)
    if first_index < 0 or end_index < 0:
        raise EvaluationError(f"cannot slice({first_index}, {end_index}), negative indexes not supported")
    if first_index > end_index:
        raise EvaluationError(
            f"cannot slice({first_index}, {end_index}), start index must be less than or equal to end index"
        )
    if end_index > len(values):
        raise EvaluationError(f"cannot slice({first_index}, {end_index}), list is length {len(values)}")
    return values[first_index:end_index]


def flatten(items: Any, depth: Any = 1) -> list[Any]:
    """Lists within the list are replaced by their items."""
    if _integer(depth) < 0:
        raise EvaluationError("level must be non-negative")
    result: list[Any] = []
    for item in _list(items):
        nested = flatten(item, depth - 1) if isinstance(item, list) and depth > 0 else [item]
        limit_size(len(result) + len(nested))
        result += nested
    return result


def distinct(items: Any) -> list[Any]:
    """Each item once."""
    result: list[Any] = []
    for item in _list(items):
        if not _holds(result, item):
            result.append(item)
    return result


def in_reverse(items: Any) -> list[Any]:
    """The items from last to first."""
    return _list(items)[::-1]


def in_order(items: Any) -> list[Any]:
    """The items sorted."""
    return sorted(_list(items), key=functools.cmp_to_key(compare))


def first(items: Any) -> Optional:
    """The first item, if any."""
    return Optional(present=True, content=items[0]) if _list(items) else ABSENT


def last(items: Any) -> Optional:
    """The last item, if any."""
    return Optional(present=True, content=items[-1]) if _list(items) else ABSENT


def numbers_below(end: Any) -> list[int]:
    """lists.range(): 0, 1, 2 … below `end`."""
    limit_size(_integer(end))
    return list(range(end))
