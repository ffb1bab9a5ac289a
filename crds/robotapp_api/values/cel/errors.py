"""What can be wrong with an expression, and with a value it meets."""

from typing import Any, Final

NO_OVERLOAD: Final = "no such overload"


class ExpressionError(ValueError):
    """The text is no expression that can be evaluated."""


class EvaluationError(ValueError):
    """The expression has no value for this input; the text is that of cel-go."""


def no_overload(*_: Any) -> EvaluationError:
    """An operator or function was given values of the wrong type."""
    return EvaluationError(NO_OVERLOAD)
