"""The instances of a sweep: combinations of the values of `matrix.parameters`, their names, and the variables that hold the values.

Operator, the sweep of the claims, scheduler and command line read a matrix through these functions, so all of them have the same
instances.
"""

import itertools
import json
import re
from collections.abc import Mapping, Sequence
from math import prod
from typing import Any, Final, NamedTuple

from robotapp_api.values.naming import HASH_LENGTH, short_hash

MOST_INSTANCES: Final = 256
"""Combinations of one matrix."""
DEFAULT_PARALLELISM: Final = 10
"""Instances that run at once where a matrix writes no number: a sweep does not take every domain of its pool."""
VARIABLE_PREFIX: Final = "MATRIX_"
"""Begins the name of the variable with the value of a parameter."""
_READABLE: Final = 40
"""Characters of an instance's name that are made of its values."""

Json = Mapping[str, Any]


class MatrixInstance(NamedTuple):
    """One combination of a matrix, and its name as an instance of the app."""

    name: str
    values: Mapping[str, str]
    """By the names of the parameters, in the order in which they are written."""


def count_instances(matrix: Json) -> int:
    """Returns how many combinations there are."""
    return prod(len(parameter.get("values") or ()) for parameter in _parameters(matrix))


def expand_matrix(matrix: Json | None) -> tuple[MatrixInstance, ...]:
    """Returns the combinations in the order of the parameters, the last one changing fastest; () without a matrix.

    More than an app may have are refused by the checks, and expand to none.
    """
    if not matrix or count_instances(matrix) > MOST_INSTANCES:
        return ()
    names = [parameter["name"] for parameter in _parameters(matrix)]
    combinations = itertools.product(*(parameter["values"] for parameter in _parameters(matrix)))
    instances = (dict(zip(names, values, strict=True)) for values in combinations)
    return tuple(MatrixInstance(name_instance(values), values) for values in instances)


def name_instance(values: Mapping[str, str]) -> str:
    """Returns the name of a combination: its values to read, and a hash of names and values, so that no two are equal.

    It depends on nothing else, so an instance keeps its name when values are added or parameters written in another order.
    """
    values_by_name = dict(sorted(values.items()))
    readable = re.sub(r"[^a-z0-9]+", "-", "-".join(values_by_name.values()).lower()).strip("-")[:_READABLE].rstrip("-")
    digest = short_hash(json.dumps(values_by_name, separators=(",", ":")), HASH_LENGTH)
    return f"{readable}-{digest}" if readable else f"run-{digest}"


def name_variable(parameter: str) -> str:
    """Returns the name of the variable with the value of a parameter: MATRIX_SPEED for speed."""
    return f"{VARIABLE_PREFIX}{parameter.upper()}"


def list_variables(values: Mapping[str, str]) -> dict[str, str]:
    """Returns the values of one instance by the names of their variables."""
    return {name_variable(parameter): value for parameter, value in values.items()}


def parallelism_of(matrix: Json) -> int:
    """Returns how many instances run at once."""
    parallelism = matrix.get("parallelism", DEFAULT_PARALLELISM)
    return parallelism if isinstance(parallelism, int) else DEFAULT_PARALLELISM


def limit_domains(parallelism: int, available: int) -> int:
    """Returns how many domains a sweep holds at most, those that rest after a run included: half of what is available to its namespace,
    or all that run at once where these are more. A domain rests for a minute after its use, so a sweep of short runs would take the
    whole pool otherwise.
    """
    return max(1, min(max(parallelism, available // 2), available))


def choose_admitted(
    names: Sequence[str],
    *,
    parallelism: int,
    begun: frozenset[str],
    finished: frozenset[str],
    resting: int = 0,
    available: int | None = None,
) -> frozenset[str]:
    """Returns the unfinished instances that may run: those that have begun, then the first others, up to `parallelism` and as long as
    the sweep holds no more domains than `limit_domains`.

    One that has begun is never stopped by a smaller number, it only keeps later ones waiting. names: all instances in their order.
    resting: domains that ended instances hold still. available: domains that the namespace may have, None where instances need none.
    """
    begun_names = [name for name in names if name in begun and name not in finished]
    later_names = [name for name in names if name not in begun and name not in finished]
    room = parallelism - len(begun_names)
    if available is not None:
        room = min(room, limit_domains(parallelism, available) - len(begun_names) - resting)
    return frozenset([*begun_names, *later_names[: max(0, room)]])


def _parameters(matrix: Json) -> Sequence[Json]:
    parameters: Sequence[Json] = matrix.get("parameters") or ()
    return parameters
