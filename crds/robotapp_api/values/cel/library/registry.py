"""The functions that expressions can call, by name: (function, numbers of arguments); a member's target is its first argument."""

from collections.abc import Callable
from typing import Any, Final

from robotapp_api.values.cel.errors import no_overload
from robotapp_api.values.cel.library import kubernetes, lists, standard, strings

Function = tuple[Callable[..., Any], tuple[int, ...]]


def _by_target(*candidates: tuple[type | tuple[type, ...], Callable[..., Any]]) -> Callable[..., Any]:
    """A function of the same name for several types of targets."""

    def call(target: Any, *arguments: Any) -> Any:
        for kinds, function in candidates:
            if isinstance(target, kinds):
                return function(target, *arguments)
        raise no_overload(target)

    return call


GLOBAL_FUNCTIONS: Final[dict[str, Function]] = {
    "size": (standard.size, (1,)),
    "type": (standard.type_of, (1,)),
    "dyn": (standard.same, (1,)),
    "int": (standard.to_int, (1,)),
    "uint": (standard.to_uint, (1,)),
    "double": (standard.to_double, (1,)),
    "string": (standard.to_string, (1,)),
    "bytes": (standard.to_bytes, (1,)),
    "bool": (standard.to_bool, (1,)),
    "matches": (strings.matches, (2,)),
    "optional.of": (standard.optional_of, (1,)),
    "optional.none": (standard.optional_none, (0,)),
    "optional.ofNonZeroValue": (standard.optional_of_non_zero, (1,)),
    "sets.contains": (lists.sets_contains, (2,)),
    "sets.equivalent": (lists.sets_equivalent, (2,)),
    "sets.intersects": (lists.sets_intersects, (2,)),
    "strings.quote": (strings.quote, (1,)),
    "lists.range": (lists.numbers_below, (1,)),
    "quantity": (kubernetes.quantity, (1,)),
    "isQuantity": (kubernetes.is_quantity, (1,)),
    "semver": (kubernetes.semver, (1, 2)),
    "isSemver": (kubernetes.is_semver, (1, 2)),
}

MEMBER_FUNCTIONS: Final[dict[str, Function]] = {
    "size": (standard.size, (1,)),
    "hasValue": (standard.has_value, (1,)),
    "value": (standard.content, (1,)),
    "or": (standard.either, (2,)),
    "orValue": (standard.content_or, (2,)),
    # strings
    "contains": (strings.contains, (2,)),
    "startsWith": (strings.starts_with, (2,)),
    "endsWith": (strings.ends_with, (2,)),
    "matches": (strings.matches, (2,)),
    "find": (strings.find, (2,)),
    "findAll": (strings.find_all, (2, 3)),
    "charAt": (strings.char_at, (2,)),
    "lowerAscii": (strings.lower_ascii, (1,)),
    "upperAscii": (strings.upper_ascii, (1,)),
    "replace": (strings.replace, (3, 4)),
    "split": (strings.split, (2, 3)),
    "substring": (strings.substring, (2, 3)),
    "trim": (strings.trim, (1,)),
    "format": (strings.format_text, (2,)),
    # strings and lists
    "indexOf": (_by_target((str, strings.index_of), (list, lists.index_of)), (2, 3)),
    "lastIndexOf": (_by_target((str, strings.last_index_of), (list, lists.last_index_of)), (2, 3)),
    # lists
    "join": (strings.join, (1, 2)),
    "isSorted": (lists.is_sorted, (1,)),
    "sum": (lists.total, (1,)),
    "min": (lists.least, (1,)),
    "max": (lists.greatest, (1,)),
    "includes": (lists.includes, (2,)),
    "slice": (lists.part, (3,)),
    "flatten": (lists.flatten, (1, 2)),
    "distinct": (lists.distinct, (1,)),
    "reverse": (lists.in_reverse, (1,)),
    "sort": (lists.in_order, (1,)),
    "first": (lists.first, (1,)),
    "last": (lists.last, (1,)),
    # quantities and versions
    "sign": (kubernetes.sign, (1,)),
    "isInteger": (kubernetes.is_integer, (1,)),
    "asInteger": (kubernetes.as_integer, (1,)),
    "asApproximateFloat": (kubernetes.as_float, (1,)),
    "add": (kubernetes.add, (2,)),
    "sub": (kubernetes.subtract, (2,)),
    "isGreaterThan": (kubernetes.is_greater, (2,)),
    "isLessThan": (kubernetes.is_less, (2,)),
    "compareTo": (kubernetes.compare_to, (2,)),
    "major": (kubernetes.major, (1,)),
    "minor": (kubernetes.minor, (1,)),
    "patch": (kubernetes.patch, (1,)),
}
