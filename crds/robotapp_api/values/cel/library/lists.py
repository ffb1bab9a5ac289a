"""Functions on lists: those of CEL's extensions and those that Kubernetes adds."""

import functools
import itertools
from typing import Any

from robotapp_api.values.cel.errors import EvaluationError, make_overload_error
from robotapp_api.values.cel.evaluation import limit_size
from robotapp_api.values.cel.operators import add
from robotapp_api.values.cel.values import ABSENT, Optional, compare, equal


def _check_list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise make_overload_error(value)
    return value


def _check_integer(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise make_overload_error(value)
    return value


def _has_item(items: list[Any], item: Any) -> bool:
    return any(equal(item, entry) for entry in items)


def sets_contains(items: Any, part: Any) -> bool:
    """Returns whether every item of the second list is in the first."""
    return all(_has_item(_check_list(items), item) for item in _check_list(part))


def sets_equivalent(first: Any, second: Any) -> bool:
    """Returns whether both lists have the same items."""
    return sets_contains(first, second) and sets_contains(second, first)


def sets_intersects(first: Any, second: Any) -> bool:
    """Returns whether any item is in both lists."""
    return any(_has_item(_check_list(second), item) for item in _check_list(first))


def includes(value: Any, item: Any) -> bool:
    """Returns whether a list has the item, or a single value equals it."""
    return _has_item(value, item) if isinstance(value, list) else equal(value, item)


def is_sorted(items: Any) -> bool:
    """Returns whether no item comes before a smaller one."""
    values = _check_list(items)
    return all(compare(first, second) <= 0 for first, second in itertools.pairwise(values))


def add_up(items: Any) -> Any:
    """Sum of the items, 0 of none."""
    values = _check_list(items)
    if any(isinstance(value, str | bytes | list) for value in values):
        raise make_overload_error(items)
    return functools.reduce(add, values) if values else 0


def find_least(items: Any) -> Any:
    """Smallest item."""
    return _find_extreme(items, "min", -1)


def find_greatest(items: Any) -> Any:
    """Largest item."""
    return _find_extreme(items, "max", 1)


def _find_extreme(items: Any, name: str, order: int) -> Any:
    if not _check_list(items):
        raise EvaluationError(f"{name} called on empty list")
    return functools.reduce(lambda best, item: item if compare(item, best) == order else best, items)


def find_first(items: Any, item: Any) -> int:
    """First position of the item, -1 without."""
    return next((index for index, entry in enumerate(_check_list(items)) if equal(entry, item)), -1)


def find_last(items: Any, item: Any) -> int:
    """Last position of the item, -1 without."""
    position = find_first(_check_list(items)[::-1], item)
    return position if position < 0 else len(items) - 1 - position


def cut(items: Any, start: Any, end: Any) -> list[Any]:
    """Items from `start` up to `end`."""
    values, first_index, end_index = _check_list(items), _check_integer(start), _check_integer(end)
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
    if _check_integer(depth) < 0:
        raise EvaluationError("level must be non-negative")
    result: list[Any] = []
    for item in _check_list(items):
        items_of_item = flatten(item, depth - 1) if isinstance(item, list) and depth > 0 else [item]
        limit_size(len(result) + len(items_of_item))
        result += items_of_item
    return result


def drop_duplicates(items: Any) -> list[Any]:
    """Each item once."""
    result: list[Any] = []
    for item in _check_list(items):
        if not _has_item(result, item):
            result.append(item)
    return result


def reverse(items: Any) -> list[Any]:
    """The items from last to first."""
    return _check_list(items)[::-1]


def sort(items: Any) -> list[Any]:
    """The items sorted."""
    return sorted(_check_list(items), key=functools.cmp_to_key(compare))


def get_first(items: Any) -> Optional:
    """The first item, if any."""
    return Optional(present=True, content=items[0]) if _check_list(items) else ABSENT


def get_last(items: Any) -> Optional:
    """The last item, if any."""
    return Optional(present=True, content=items[-1]) if _check_list(items) else ABSENT


def count_up(end: Any) -> list[int]:
    """lists.range(): 0, 1, 2 … below `end`."""
    limit_size(_check_integer(end))
    return list(range(end))
