"""What may be written as `addedAffinity`: the node affinity of pods, read strictly.

In a pod an unknown field is skipped, because a newer API server may send it; in a configuration it is a typing error that
would leave nodes open which the profile was to keep away from.
"""

import re
from collections.abc import Iterator
from typing import Final

import msgspec

from robotapp_api.values.selector import NAME_FIELD, integer
from robotapp_scheduler.core.api.core_v1 import NodeAffinity, NodeSelector, NodeSelectorTerm, PreferredTerm, Requirement
from robotapp_scheduler.plugins.kubernetes.common.arguments import QUALIFIED

REQUIRED: Final = "requiredDuringSchedulingIgnoredDuringExecution"
PREFERRED: Final = "preferredDuringSchedulingIgnoredDuringExecution"
OPERATORS: Final = ("In", "NotIn", "Exists", "DoesNotExist", "Gt", "Lt")
FIELD_OPERATORS: Final = ("In", "NotIn")
MOST_WEIGHT: Final = 100
LABEL_VALUE: Final = re.compile(r"([A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?)?")


class _Requirement(Requirement, frozen=True, forbid_unknown_fields=True):
    pass


class _Term(NodeSelectorTerm, frozen=True, forbid_unknown_fields=True):
    match_expressions: tuple[_Requirement, ...] = ()
    match_fields: tuple[_Requirement, ...] = ()


class _Selector(NodeSelector, frozen=True, forbid_unknown_fields=True):
    node_selector_terms: tuple[_Term, ...] = ()


class _Preferred(PreferredTerm, frozen=True, forbid_unknown_fields=True):
    preference: _Term = msgspec.field(default_factory=_Term)


class AddedAffinity(NodeAffinity, frozen=True, forbid_unknown_fields=True):
    """The argument `addedAffinity` of NodeAffinity."""

    required: _Selector | None = msgspec.field(name=REQUIRED, default=None)
    preferred: tuple[_Preferred, ...] = msgspec.field(name=PREFERRED, default=())


def problems(added: AddedAffinity | None) -> Iterator[str]:
    """What the API server would reject in the affinity of a pod, in its words."""
    if added is None:
        return
    if added.required is not None:
        path = f"addedAffinity.{REQUIRED}.nodeSelectorTerms"
        if not added.required.node_selector_terms:
            yield f"{path}: Required value: must have at least one node selector term"
        for i, term in enumerate(added.required.node_selector_terms):
            yield from _term(term, f"{path}[{i}]")
    for i, preferred in enumerate(added.preferred):
        path = f"addedAffinity.{PREFERRED}[{i}]"
        if not 1 <= preferred.weight <= MOST_WEIGHT:
            yield f"{path}.weight: Invalid value: {preferred.weight}: must be in the range 1-100"
        yield from _term(preferred.preference, f"{path}.preference")


def _term(term: NodeSelectorTerm, path: str) -> Iterator[str]:
    for i, expression in enumerate(term.match_expressions):
        yield from _expression(expression, f"{path}.matchExpressions[{i}]")
    for i, field in enumerate(term.match_fields):
        at = f"{path}.matchFields[{i}]"
        if field.key != NAME_FIELD:
            yield f'{at}.key: Invalid value: "{field.key}": not a valid field selector key'
        yield from _one_of(FIELD_OPERATORS, field, at)
        if field.operator in FIELD_OPERATORS and len(field.values) != 1:
            yield f"{at}.values: Required value: must be only one value when `operator` is 'In' or 'NotIn' for node field selector"


def _expression(expression: Requirement, path: str) -> Iterator[str]:
    if QUALIFIED.fullmatch(expression.key) is None:
        yield f'{path}.key: Invalid value: "{expression.key}": must be a label name such as example.com/pool'
    count = len(expression.values)
    match expression.operator:
        case "In" | "NotIn" if not count:
            yield f"{path}.values: Required value: must be specified when `operator` is 'In' or 'NotIn'"
        case "Exists" | "DoesNotExist" if count:
            yield f"{path}.values: Forbidden: may not be specified when `operator` is 'Exists' or 'DoesNotExist'"
        case "Gt" | "Lt" if count != 1:
            yield f"{path}.values: Required value: must be specified single value when `operator` is 'Lt' or 'Gt'"
        case "Gt" | "Lt" if integer(expression.values[0]) is None:
            yield f'{path}.values[0]: Invalid value: "{expression.values[0]}": must be an integer'
    yield from _one_of(OPERATORS, expression, path)
    for i, value in enumerate(expression.values):
        if LABEL_VALUE.fullmatch(value) is None:
            yield f'{path}.values[{i}]: Invalid value: "{value}": must be a label value'


def _one_of(known: tuple[str, ...], expression: Requirement, path: str) -> Iterator[str]:
    if expression.operator not in known:
        names = ", ".join(f'"{name}"' for name in known)
        yield f'{path}.operator: Unsupported value: "{expression.operator}": supported values: {names}'
