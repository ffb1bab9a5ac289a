"""Operators of CEL as closures."""

from collections.abc import Callable
from typing import Any, Final

from robotapp_api.values.cel.errors import EvaluationError, no_overload
from robotapp_api.values.cel.evaluation import Evaluation, Step, limit_size
from robotapp_api.values.cel.values import ABSENT, INT64, UINT64, DefaultMap, Optional, Unsigned, compare, equal

_MISSING: Final = object()


# --- Access ----------------------------------------------------------------------------------------------------------


def select(operand: Step, field: str, *, optional: bool) -> Step:
    """operand.field."""
    if optional:
        return lambda evaluation: _look_up_optional(operand(evaluation), field)
    return lambda evaluation: _look_up(operand(evaluation), field)


def index(operand: Step, key: Step, *, optional: bool) -> Step:
    """operand[key]."""
    look_up = _look_up_optional if optional else _look_up
    return lambda evaluation: look_up(operand(evaluation), key(evaluation))


def has_field(operand: Step, field: str) -> Step:
    """has(operand.field)."""

    def step(evaluation: Evaluation) -> bool:
        value = operand(evaluation)
        if isinstance(value, Optional):
            value = value.content if value.present else {}
        if not isinstance(value, dict):
            raise no_overload(value)
        return field in value or isinstance(value, DefaultMap)

    return step


def map_key(value: Any) -> Any:
    """A value as key of a map; 2.0 and uint 2 find the entry of 2."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int | float) and value == int(value):
        return int(value)
    raise EvaluationError("unsupported key type")


def _look_up(operand: Any, key: Any) -> Any:
    if isinstance(operand, Optional):
        return _look_up_optional(operand, key)
    value = _find(operand, key)
    if value is not _MISSING:
        return value
    if isinstance(operand, dict):
        raise EvaluationError(f"no such key: {shown_key(key)}")
    raise EvaluationError(f"index out of bounds: {key}")


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
            key = map_key(key)
        if isinstance(operand, DefaultMap):
            return operand[key]
        return operand.get(key, _MISSING)
    if isinstance(operand, list) and isinstance(key, int | float) and not isinstance(key, bool):
        if key != int(key):
            raise EvaluationError(f"unsupported index value: {key}")
        return operand[int(key)] if 0 <= key < len(operand) else _MISSING
    raise no_overload(operand, key)


def shown_key(key: Any) -> str:
    """A key in a message."""
    return str(key).lower() if isinstance(key, bool) else str(key)


def contains(container: Any, item: Any) -> bool:
    """Item in container."""
    if isinstance(container, dict):
        try:
            return map_key(item) in container
        except EvaluationError:
            return False
    if isinstance(container, list):
        return any(equal(item, entry) for entry in container)
    raise no_overload(item, container)


# --- Logic -----------------------------------------------------------------------------------------------------------


def logical(steps: list[Step], *, decisive: bool) -> Step:
    """|| (decisive: true) or && (false): the decisive value of one operand outweighs errors of others."""

    def step(evaluation: Evaluation) -> bool:
        error: EvaluationError | None = None
        for operand in steps:
            try:
                value: object = operand(evaluation)
                if value is decisive:
                    return decisive
                if not isinstance(value, bool):
                    raise no_overload(value)
            except EvaluationError as trouble:
                error = error or trouble
        if error is not None:
            raise error
        return not decisive

    return step


def conditional(condition: Step, yes: Step, no: Step) -> Step:
    """Condition ? yes : no."""

    def step(evaluation: Evaluation) -> Any:
        value = condition(evaluation)
        if value is True:
            return yes(evaluation)
        if value is False:
            return no(evaluation)
        raise no_overload(value)

    return step


# --- Arithmetic and comparison ---------------------------------------------------------------------------------------


def unary(operator: str, operand: Step) -> Step:
    """!operand or -operand."""
    if operator == "!":

        def negate(evaluation: Evaluation) -> bool:
            value = operand(evaluation)
            if not isinstance(value, bool):
                raise no_overload(value)
            return not value

        return negate
    return lambda evaluation: _negative(operand(evaluation))


def binary_chain(first: Step, rest: list[tuple[str, Step]]) -> Step:
    """First operator second operator third …, from left to right."""
    if len(rest) == 1:
        operator, second = rest[0]
        function = BINARY[operator]
        return lambda evaluation: function(first(evaluation), second(evaluation))
    functions = [(BINARY[operator], operand) for operator, operand in rest]

    def step(evaluation: Evaluation) -> Any:
        value = first(evaluation)
        for function, operand in functions:
            value = function(value, operand(evaluation))
        return value

    return step


def _negative(value: Any) -> Any:
    if isinstance(value, float):
        return -value
    if type(value) is int:
        return checked(-value)
    raise no_overload(value)


def checked(value: int, *, unsigned: bool = False) -> int:
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
            return checked(first + second, unsigned=isinstance(first, Unsigned))
        if isinstance(first, float):
            return first + second
    raise no_overload(first, second)


def _arithmetic(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """An operator on two numbers of one type."""

    def apply(first: Any, second: Any) -> Any:
        if type(first) is not type(second) or isinstance(first, bool):
            raise no_overload(first, second)
        if isinstance(first, float):
            if function is _divide:
                return _divide_floats(first, second)
            if function is _modulo:
                raise no_overload(first, second)
            return function(first, second)
        if isinstance(first, int):
            return checked(int(function(int(first), int(second))), unsigned=isinstance(first, Unsigned))
        raise no_overload(first, second)

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
    "in": lambda first, second: contains(second, first),
    "+": add,
    "-": _arithmetic(lambda first, second: first - second),
    "*": _arithmetic(lambda first, second: first * second),
    "/": _arithmetic(_divide),
    "%": _arithmetic(_modulo),
}
