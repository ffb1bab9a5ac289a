"""Label selectors and node selector terms, by the rules of kube-scheduler 1.37.

Everything works on plain values: labels as a mapping, requirements as anything with key, operator and values.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol

NAME_FIELD: Final = "metadata.name"
_INT64: Final = range(-(2**63), 2**63)


class RequirementLike(Protocol):
    """What is read of an expression."""

    @property
    def key(self) -> str: ...
    @property
    def operator(self) -> str: ...
    @property
    def values(self) -> Sequence[str]: ...


class TermLike(Protocol):
    """What is read of a node selector term."""

    @property
    def match_expressions(self) -> Sequence[RequirementLike]: ...
    @property
    def match_fields(self) -> Sequence[RequirementLike]: ...


def integer(text: str) -> int | None:
    """The value of a Gt or Lt operand or label: a base 10 int64 as Go parses it, else None."""
    digits = text[1:] if text[:1] in {"+", "-"} else text
    if not digits or not digits.isascii() or not digits.isdigit() or len(digits) > 20:
        return None
    value = int(text)
    return value if value in _INT64 else None


def valid_requirement(requirement: RequirementLike) -> bool:
    """May the expression be evaluated at all? An invalid one makes a required term match nothing."""
    count = len(requirement.values)
    match requirement.operator:
        case "In" | "NotIn":
            return count > 0
        case "Exists" | "DoesNotExist":
            return count == 0
        case "Gt" | "Lt":
            return count == 1 and integer(requirement.values[0]) is not None
        case _:
            return False


def matches_requirement(requirement: RequirementLike, value: str | None) -> bool:
    """One valid expression against the value of its key; None means the key is absent."""
    match requirement.operator:
        case "In":
            return value is not None and value in requirement.values
        case "NotIn":
            return value is None or value not in requirement.values
        case "Exists":
            return value is not None
        case "DoesNotExist":
            return value is None
    actual = integer(value) if value is not None else None
    limit = integer(requirement.values[0])
    if actual is None or limit is None:
        return False
    return actual > limit if requirement.operator == "Gt" else actual < limit


def valid_term(term: TermLike) -> bool:
    """Can the term be evaluated? Fields know only metadata.name with In or NotIn and one value."""
    if not all(valid_requirement(expression) for expression in term.match_expressions):
        return False
    return all(
        field.key == NAME_FIELD and field.operator in {"In", "NotIn"} and len(field.values) == 1
        for field in term.match_fields
    )


def matches_term(term: TermLike, labels: Mapping[str, str], name: str) -> bool:
    """One node selector term; an empty or invalid term matches nothing."""
    if not (term.match_expressions or term.match_fields) or not valid_term(term):
        return False
    return all(matches_requirement(e, labels.get(e.key)) for e in term.match_expressions) and all(
        matches_requirement(field, name) for field in term.match_fields
    )


def matches_node_terms(terms: Iterable[TermLike], labels: Mapping[str, str], name: str) -> bool:
    """Terms are ORed; no term at all matches nothing."""
    return any(matches_term(term, labels, name) for term in terms)


class Expression(NamedTuple):
    """One expression of a label selector; hashable, so that equal selectors are equal keys."""

    key: str
    operator: str
    values: tuple[str, ...]


def label_requirements(selector: Mapping[str, Any] | None) -> tuple[Expression, ...] | None:
    """The expressions of a metav1.LabelSelector (plain JSON), sorted, each once; () matches everything.

    None for a selector that matches nothing: an absent one, or one that cannot be evaluated.
    """
    if selector is None:
        return None
    found = {Expression(key, "In", (value,)) for key, value in (selector.get("matchLabels") or {}).items()}
    for raw in selector.get("matchExpressions") or ():
        values = tuple(sorted(raw.get("values") or ()))
        expression = Expression(raw.get("key", ""), raw.get("operator", ""), values)
        if expression.operator in {"Gt", "Lt"} or not valid_requirement(expression):
            return None
        found.add(expression)
    return tuple(sorted(found))


def matches_requirements(requirements: Iterable[RequirementLike], labels: Mapping[str, str]) -> bool:
    """Do labels meet all of these valid expressions?"""
    return all(matches_requirement(requirement, labels.get(requirement.key)) for requirement in requirements)


def matches_labels(selector: Mapping[str, Any] | None, labels: Mapping[str, str]) -> bool:
    """metav1.LabelSelector as plain JSON: None matches nothing, {} everything, an invalid one nothing."""
    requirements = label_requirements(selector)
    return requirements is not None and matches_requirements(requirements, labels)
