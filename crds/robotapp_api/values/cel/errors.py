"""Errors of an expression, and of its evaluation."""

from typing import Any, Final

NO_OVERLOAD: Final = "no such overload"


class ExpressionError(ValueError):
    """The text is no expression that can be evaluated."""


class EvaluationError(ValueError):
    """The expression has no value for this input; the text is that of cel-go."""


def make_overload_error(*_: Any) -> EvaluationError:
    """An operator or function was given values of the wrong type."""
    return EvaluationError(NO_OVERLOAD)
