"""Macros over the items of a list or map."""

from collections.abc import Callable, Iterator
from functools import cmp_to_key
from typing import Any, Final, NamedTuple

from robotapp_api.values.cel.errors import EvaluationError, make_overload_error
from robotapp_api.values.cel.evaluation import Evaluation, Step
from robotapp_api.values.cel.operators import get_map_key
from robotapp_api.values.cel.values import compare

Round = Callable[[Evaluation], Iterator[tuple[Any, Any]]]


class Shape(NamedTuple):
    """Number of variables of a macro, and its evaluation."""

    variables: int
    fold: Callable[["Rounds", list[Step]], Any]


class Rounds:
    """The items of a list or map, one after the other; the variables of the macro stand for the item of the round."""

    __slots__ = ("_evaluation", "_names", "_values")

    def __init__(self, evaluation: Evaluation, names: list[str], values: Any) -> None:
        if not isinstance(values, list | dict):
            raise make_overload_error(values)
        self._evaluation = evaluation
        self._names = names
        self._values = values

    def __repr__(self) -> str:
        return f"Rounds({self._names}, {len(self._values)} items)"

    def get_items(self) -> Iterator[tuple[Any, Any]]:
        """The values of the variables in each round: (item, None), or (index or key, value)."""
        for position, item in enumerate(self._values):
            self._evaluation.count_round()
            if len(self._names) == 1:
                yield item, None
            elif isinstance(self._values, dict):
                yield item, self._values[item]
            else:
                yield position, item

    def evaluate(self, step: Step, round_values: tuple[Any, Any]) -> Any:
        """The value of an argument of the macro in this round."""
        first, second = round_values
        if len(self._names) == 1:
            return self._evaluation.with_variable(self._names[0], first, step)
        return self._evaluation.with_variable(
            self._names[0],
            first,
            lambda evaluation: evaluation.with_variable(self._names[1], second, step),
        )

    def check(self, step: Step, round_values: tuple[Any, Any]) -> bool:
        """The same for a condition."""
        value = self.evaluate(step, round_values)
        if not isinstance(value, bool):
            raise make_overload_error(value)
        return value


def _decide(rounds: Rounds, steps: list[Step], *, decisive: bool) -> bool:
    """all() or exists(): the decisive verdict on one item outweighs errors on others."""
    error: EvaluationError | None = None
    for round_values in rounds.get_items():
        try:
            if rounds.check(steps[0], round_values) is decisive:
                return decisive
        except EvaluationError as trouble:
            error = error or trouble
    if error is not None:
        raise error
    return not decisive


def _check_all(rounds: Rounds, steps: list[Step]) -> bool:
    return _decide(rounds, steps, decisive=False)


def _check_any(rounds: Rounds, steps: list[Step]) -> bool:
    return _decide(rounds, steps, decisive=True)


def _check_one(rounds: Rounds, steps: list[Step]) -> bool:
    return sum([rounds.check(steps[0], round_values) for round_values in rounds.get_items()]) == 1


def _filter(rounds: Rounds, steps: list[Step]) -> list[Any]:
    return [round_values[0] for round_values in rounds.get_items() if rounds.check(steps[0], round_values)]


def _get_values(rounds: Rounds, steps: list[Step]) -> Iterator[tuple[tuple[Any, Any], Any]]:
    """Rounds that pass the filter, if there is one, and the value of the last argument in them."""
    *conditions, transform = steps
    for round_values in rounds.get_items():
        if all(rounds.check(condition, round_values) for condition in conditions):
            yield round_values, rounds.evaluate(transform, round_values)


def _map(rounds: Rounds, steps: list[Step]) -> list[Any]:
    return [value for _, value in _get_values(rounds, steps)]


def _transform_map(rounds: Rounds, steps: list[Step]) -> dict[Any, Any]:
    return {key: value for (key, _), value in _get_values(rounds, steps)}


def _transform_map_entry(rounds: Rounds, steps: list[Step]) -> dict[Any, Any]:
    result: dict[Any, Any] = {}
    for _, entries in _get_values(rounds, steps):
        if not isinstance(entries, dict):
            raise make_overload_error(entries)
        for key, value in entries.items():
            if get_map_key(key) in result:
                raise EvaluationError(f"insert failed: key {key} already exists")
            result[key] = value
    return result


def _sort_by(rounds: Rounds, steps: list[Step]) -> list[Any]:
    keys_and_items = [(rounds.evaluate(steps[0], round_values), round_values[0]) for round_values in rounds.get_items()]
    return [item for _, item in sorted(keys_and_items, key=cmp_to_key(_compare_keys))]


def _compare_keys(first: tuple[Any, Any], second: tuple[Any, Any]) -> int:
    return compare(first[0], second[0])


COMPREHENSIONS: Final[dict[tuple[str, int], Shape]] = {
    ("all", 2): Shape(1, _check_all),
    ("exists", 2): Shape(1, _check_any),
    ("exists_one", 2): Shape(1, _check_one),
    ("existsOne", 2): Shape(1, _check_one),
    ("filter", 2): Shape(1, _filter),
    ("sortBy", 2): Shape(1, _sort_by),
    ("map", 2): Shape(1, _map),
    ("map", 3): Shape(1, _map),
    ("all", 3): Shape(2, _check_all),
    ("exists", 3): Shape(2, _check_any),
    ("existsOne", 3): Shape(2, _check_one),
    ("exists_one", 3): Shape(2, _check_one),
    ("transformList", 3): Shape(2, _map),
    ("transformList", 4): Shape(2, _map),
    ("transformMap", 3): Shape(2, _transform_map),
    ("transformMap", 4): Shape(2, _transform_map),
    ("transformMapEntry", 3): Shape(2, _transform_map_entry),
    ("transformMapEntry", 4): Shape(2, _transform_map_entry),
}
"""By name and number of arguments."""
MACRO_NAMES: Final = frozenset(name for name, _ in COMPREHENSIONS)


def compile_macro(shape: Shape, names: list[str], source: Step, steps: list[Step]) -> Step:
    """The closure of a macro over the items of `source`."""
    return lambda evaluation: shape.fold(Rounds(evaluation, names, source(evaluation)), steps)
