"""Operators of CEL as closures."""

import math
from collections.abc import Callable
from typing import Any, Final

from robotapp_api.values.cel.errors import EvaluationError, make_overload_error
from robotapp_api.values.cel.evaluation import Evaluation, Step, limit_size
from robotapp_api.values.cel.values import ABSENT, INT64, UINT64, DefaultMap, Optional, Unsigned, compare, equal

_MISSING: Final = object()


# --- Access ----------------------------------------------------------------------------------------------------------


def compile_select(operand: Step, field: str, *, optional: bool) -> Step:
    """Compiles operand.field."""
    if optional:
        return lambda evaluation: _look_up_optional(operand(evaluation), field)
    return lambda evaluation: _look_up(operand(evaluation), field)


def compile_index(operand: Step, key: Step, *, optional: bool) -> Step:
    """Compiles operand[key]."""
    look_up = _look_up_optional if optional else _look_up
    return lambda evaluation: look_up(operand(evaluation), key(evaluation))


def compile_has(operand: Step, field: str) -> Step:
    """Compiles has(operand.field)."""

    def run(evaluation: Evaluation) -> bool:
        value = operand(evaluation)
        if isinstance(value, Optional):
            value = value.content if value.present else {}
        if not isinstance(value, dict):
            raise make_overload_error(value)
        return field in value or isinstance(value, DefaultMap)

    return run


def get_map_key(value: Any) -> Any:
    """A value as key of a map; 2.0 and uint 2 find the entry of 2."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float) and is_whole(value):
        return int(value)
    raise EvaluationError("unsupported key type")


def is_whole(value: float) -> bool:
    """Returns whether a number has no fraction; infinity and NaN are no whole numbers."""
    return math.isfinite(value) and value == int(value)


def _look_up(operand: Any, key: Any) -> Any:
    if isinstance(operand, Optional):
        return _look_up_optional(operand, key)
    value = _find(operand, key)
    if value is not _MISSING:
        return value
    if isinstance(operand, list):
        raise EvaluationError(f"index out of bounds: {write_key(key)}")
    raise EvaluationError(f"no such key: {write_key(key)}")


def _look_up_optional(operand: Any, key: Any) -> Optional:
    if isinstance(operand, Optional):
        if not operand.present:
            return ABSENT
        operand = operand.content
    value = _find(operand, key)
    return ABSENT if value is _MISSING else Optional(present=True, content=value)


def _find(operand: Any, key: Any) -> Any:
    if isinstance(operand, dict):
        if not isinstance(key, str):
            key = get_map_key(key)
        if isinstance(operand, DefaultMap):
            return operand[key]
        return operand.get(key, _MISSING)
    if isinstance(operand, list) and isinstance(key, int | float) and not isinstance(key, bool):
        if not is_whole(key):
            raise EvaluationError(f"unsupported index value: {key}")
        return operand[int(key)] if 0 <= key < len(operand) else _MISSING
    return _MISSING


def write_key(key: Any) -> str:
    """A key in a message."""
    return str(key).lower() if isinstance(key, bool) else str(key)


def has_item(container: Any, item: Any) -> bool:
    """Item in container."""
    if isinstance(container, dict):
        try:
            return get_map_key(item) in container
        except EvaluationError:
            return False
    if isinstance(container, list):
        return any(equal(item, entry) for entry in container)
    raise make_overload_error(item, container)


# --- Logic -----------------------------------------------------------------------------------------------------------


def compile_logical(steps: list[Step], *, decisive: bool) -> Step:
    """Compiles || (decisive: true) or && (false): the decisive value of one operand outweighs errors of others."""

    def run(evaluation: Evaluation) -> bool:
        error: EvaluationError | None = None
        for operand in steps:
            try:
                value: object = operand(evaluation)
                if value is decisive:
                    return decisive
                if not isinstance(value, bool):
                    raise make_overload_error(value)
            except EvaluationError as trouble:
                error = error or trouble
        if error is not None:
            raise error
        return not decisive

    return run


def compile_conditional(condition: Step, yes: Step, no: Step) -> Step:
    """Condition ? yes : no."""

    def run(evaluation: Evaluation) -> Any:
        value = condition(evaluation)
        if value is True:
            return yes(evaluation)
        if value is False:
            return no(evaluation)
        raise make_overload_error(value)

    return run


# --- Arithmetic and comparison ---------------------------------------------------------------------------------------


def compile_unary(operator: str, operand: Step) -> Step:
    """Compiles `!` or `-` before an operand."""
    if operator == "!":

        def negate(evaluation: Evaluation) -> bool:
            value = operand(evaluation)
            if not isinstance(value, bool):
                raise make_overload_error(value)
            return not value

        return negate
    return lambda evaluation: _negate(operand(evaluation))


def compile_chain(first: Step, rest: list[tuple[str, Step]]) -> Step:
    """First operator second operator third …, from left to right."""
    if len(rest) == 1:
        operator, second = rest[0]
        function = BINARY[operator]
        return lambda evaluation: function(first(evaluation), second(evaluation))
    functions = [(BINARY[operator], operand) for operator, operand in rest]

    def run(evaluation: Evaluation) -> Any:
        value = first(evaluation)
        for function, operand in functions:
            value = function(value, operand(evaluation))
        return value

    return run


def _negate(value: Any) -> Any:
    if isinstance(value, float):
        return -value
    if type(value) is int:
        return check_range(-value)
    raise make_overload_error(value)


def check_range(value: int, *, unsigned: bool = False) -> int:
    """The value as an int or uint. Raises EvaluationError when it is too large for 64 bits."""
    if unsigned:
        if value not in UINT64:
            raise EvaluationError("unsigned integer overflow")
        return Unsigned(value)
    if value not in INT64:
        raise EvaluationError("integer overflow")
    return value


def add(first: Any, second: Any) -> Any:
    """Sum of numbers of one type; strings, bytes and lists are joined."""
    if type(first) is type(second):
        if isinstance(first, str | bytes | list):
            limit_size(len(first) + len(second))
            return first + second
        if isinstance(first, int) and not isinstance(first, bool):
            return check_range(first + second, unsigned=isinstance(first, Unsigned))
        if isinstance(first, float):
            return first + second
    raise make_overload_error(first, second)


def _make_arithmetic(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """An operator on two numbers of one type."""

    def apply(first: Any, second: Any) -> Any:
        if type(first) is not type(second) or isinstance(first, bool):
            raise make_overload_error(first, second)
        if isinstance(first, float):
            if function is _divide:
                return _divide_floats(first, second)
            if function is _modulo:
                raise make_overload_error(first, second)
            return function(first, second)
        if isinstance(first, int):
            return check_range(int(function(int(first), int(second))), unsigned=isinstance(first, Unsigned))
        raise make_overload_error(first, second)

    return apply


def _divide(first: int, second: int) -> int:
    if not second:
        raise EvaluationError("division by zero")
    quotient = abs(first) // abs(second)
    return quotient if (first < 0) == (second < 0) else -quotient


def _modulo(first: int, second: int) -> int:
    if not second:
        raise EvaluationError("modulus by zero")
    remainder = abs(first) % abs(second)
    return -remainder if first < 0 else remainder


def _divide_floats(first: float, second: float) -> float:
    if second:
        return first / second
    return float("nan") if not first or first != first else float("inf") * first  # noqa: PLR0124 - NaN


BINARY: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "==": equal,
    "!=": lambda first, second: not equal(first, second),
    "<": lambda first, second: compare(first, second) < 0,
    "<=": lambda first, second: compare(first, second) <= 0,
    ">": lambda first, second: compare(first, second) > 0,
    ">=": lambda first, second: compare(first, second) >= 0,
    "in": lambda first, second: has_item(second, first),
    "+": add,
    "-": _make_arithmetic(lambda first, second: first - second),
    "*": _make_arithmetic(lambda first, second: first * second),
    "/": _make_arithmetic(_divide),
    "%": _make_arithmetic(_modulo),
}
