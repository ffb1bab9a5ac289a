"""The functions that expressions can call, by name: (function, numbers of arguments); a member's target is its first argument."""

from collections.abc import Callable
from typing import Any, Final

from robotapp_api.values.cel.errors import make_overload_error
from robotapp_api.values.cel.library import kubernetes, lists, standard, strings
from robotapp_api.values.cel.values import get_type

Function = tuple[Callable[..., Any], tuple[int, ...]]


def _select_by_target(*candidates: tuple[type | tuple[type, ...], Callable[..., Any]]) -> Callable[..., Any]:
    """A function of the same name for several types of targets."""

    def call(target: Any, *arguments: Any) -> Any:
        for kinds, function in candidates:
            if isinstance(target, kinds):
                return function(target, *arguments)
        raise make_overload_error(target)

    return call


GLOBAL_FUNCTIONS: Final[dict[str, Function]] = {
    "size": (standard.get_size, (1,)),
    "type": (get_type, (1,)),
    "dyn": (standard.keep, (1,)),
    "int": (standard.to_int, (1,)),
    "uint": (standard.to_uint, (1,)),
    "double": (standard.to_double, (1,)),
    "string": (standard.to_string, (1,)),
    "bytes": (standard.to_bytes, (1,)),
    "bool": (standard.to_bool, (1,)),
    "duration": (standard.to_duration, (1,)),
    "matches": (strings.matches, (2,)),
    "optional.of": (standard.make_present, (1,)),
    "optional.none": (standard.make_absent, (0,)),
    "optional.ofNonZeroValue": (standard.make_present_unless_empty, (1,)),
    "sets.contains": (lists.sets_contains, (2,)),
    "sets.equivalent": (lists.sets_equivalent, (2,)),
    "sets.intersects": (lists.sets_intersects, (2,)),
    "strings.quote": (strings.quote, (1,)),
    "lists.range": (lists.count_up, (1,)),
    "quantity": (kubernetes.to_quantity, (1,)),
    "sign": (kubernetes.get_sign, (1,)),
    "isQuantity": (kubernetes.is_quantity, (1,)),
    "semver": (kubernetes.to_semver, (1, 2)),
    "isSemver": (kubernetes.is_semver, (1, 2)),
}

MEMBER_FUNCTIONS: Final[dict[str, Function]] = {
    "size": (standard.get_size, (1,)),
    "hasValue": (standard.has_value, (1,)),
    "value": (standard.get_content, (1,)),
    "or": (standard.choose_present, (2,)),
    "orValue": (standard.get_content_or, (2,)),
    # strings
    "contains": (strings.has_part, (2,)),
    "startsWith": (strings.starts_with, (2,)),
    "endsWith": (strings.ends_with, (2,)),
    "matches": (strings.matches, (2,)),
    "find": (strings.find, (2,)),
    "findAll": (strings.find_all, (2, 3)),
    "charAt": (strings.get_character, (2,)),
    "lowerAscii": (strings.lower, (1,)),
    "upperAscii": (strings.raise_case, (1,)),
    "replace": (strings.replace, (3, 4)),
    "split": (strings.split, (2, 3)),
    "substring": (strings.cut, (2, 3)),
    "trim": (strings.trim, (1,)),
    "format": (strings.format_text, (2,)),
    # strings and lists
    "indexOf": (_select_by_target((str, strings.find_first), (list, lists.find_first)), (2, 3)),
    "lastIndexOf": (_select_by_target((str, strings.find_last), (list, lists.find_last)), (2, 3)),
    # lists
    "join": (strings.join, (1, 2)),
    "isSorted": (lists.is_sorted, (1,)),
    "sum": (lists.add_up, (1,)),
    "min": (lists.find_least, (1,)),
    "max": (lists.find_greatest, (1,)),
    "includes": (lists.includes, (2,)),
    "slice": (lists.cut, (3,)),
    "flatten": (lists.flatten, (1, 2)),
    "distinct": (lists.drop_duplicates, (1,)),
    "reverse": (lists.reverse, (1,)),
    "sort": (lists.sort, (1,)),
    "first": (lists.get_first, (1,)),
    "last": (lists.get_last, (1,)),
    # quantities and versions
    "isInteger": (kubernetes.is_integer, (1,)),
    "asInteger": (kubernetes.as_integer, (1,)),
    "asApproximateFloat": (kubernetes.as_float, (1,)),
    "add": (kubernetes.add, (2,)),
    "sub": (kubernetes.subtract, (2,)),
    "isGreaterThan": (kubernetes.is_greater, (2,)),
    "isLessThan": (kubernetes.is_less, (2,)),
    "compareTo": (kubernetes.compare, (2,)),
    "major": (kubernetes.get_major, (1,)),
    "minor": (kubernetes.get_minor, (1,)),
    "patch": (kubernetes.get_patch, (1,)),
}
