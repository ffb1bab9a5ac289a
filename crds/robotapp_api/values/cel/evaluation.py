"""The state of one evaluation: variables, and how much work it was."""

from collections.abc import Callable
from typing import Any, Final

from robotapp_api.values.cel.errors import EvaluationError

MOST_ROUNDS: Final = 100_000
"""Rounds of all macros in one evaluation. The API server estimates the cost of an expression before it accepts it."""
MOST_ITEMS: Final = 1_000_000
"""Longest string or list that an expression may build."""
TOO_COSTLY: Final = "operation cancelled: actual cost limit exceeded"


class Evaluation:
    """Variables in scope and the rounds made so far."""

    __slots__ = ("most_rounds", "rounds", "variables")

    def __init__(self, variables: dict[str, Any], most_rounds: int = MOST_ROUNDS) -> None:
        self.variables = variables
        self.most_rounds = most_rounds
        self.rounds = 0

    def __repr__(self) -> str:
        return f"Evaluation({sorted(self.variables)}, {self.rounds} rounds)"

    def count_round(self) -> None:
        """Raises EvaluationError when there were too many rounds."""
        self.rounds += 1
        if self.rounds > self.most_rounds:
            raise EvaluationError(TOO_COSTLY)

    def with_variable(self, name: str, value: Any, body: "Step") -> Any:
        """The value of `body` while the variable has this value; one of the same name outside is hides_variable."""
        variables = self.variables
        hides_variable = name in variables
        outer = variables.get(name)
        variables[name] = value
        try:
            return body(self)
        finally:
            if hides_variable:
                variables[name] = outer
            else:
                del variables[name]


Step = Callable[[Evaluation], Any]
"""A compiled node."""


def limit_size(size: int) -> None:
    """Raises EvaluationError before a string or list of this size is built."""
    if size > MOST_ITEMS:
        raise EvaluationError(TOO_COSTLY)
