"""Selectors of pods, terms of nodes, tolerations of taints."""

from collections.abc import Mapping

from campaigns.reference_scheduler.model import Json

Labels = Mapping[str, str]


def labels_of(item: Json) -> dict[str, str]:
    return item["metadata"].get("labels") or {}


def selector_matches(selector: Json | None, labels: Labels) -> bool:
    """A LabelSelector; None matches nothing, {} everything."""
    if selector is None:
        return False
    plain = all(labels.get(key) == value for key, value in (selector.get("matchLabels") or {}).items())
    return plain and all(holds(each, labels) for each in selector.get("matchExpressions") or [])


def selector_empty(selector: Json | None) -> bool:
    """{}: no requirement at all. None is not empty, it matches nothing."""
    return selector is not None and not selector.get("matchLabels") and not selector.get("matchExpressions")


def holds(requirement: Json, labels: Labels) -> bool:
    """One requirement of a pod selector or of a node term. An absent key satisfies NotIn and DoesNotExist only."""
    value = labels.get(requirement["key"])
    operator, values = requirement["operator"], requirement.get("values") or []
    if operator == "In":
        return value is not None and value in values
    if operator == "NotIn":
        return value is None or value not in values
    if operator == "Exists":
        return value is not None
    if operator == "DoesNotExist":
        return value is None
    found, wanted = integer(value), integer(values[0])
    if found is None or wanted is None:
        return False
    return found > wanted if operator == "Gt" else found < wanted


def integer(text: str | None) -> int | None:
    """A decimal int64 with an optional sign, else None."""
    digits = (text or "").removeprefix("-") if (text or "").startswith("-") else (text or "").removeprefix("+")
    if not (digits.isascii() and digits.isdigit()):
        return None
    value = int(text or "")
    return value if -(2**63) <= value < 2**63 else None


def valid(requirement: Json) -> bool:
    """Whether the requirement can be evaluated at all."""
    operator, values = requirement["operator"], requirement.get("values") or []
    if operator in {"In", "NotIn"}:
        return len(values) > 0
    if operator in {"Exists", "DoesNotExist"}:
        return not values
    return operator in {"Gt", "Lt"} and len(values) == 1 and integer(values[0]) is not None


def term_valid(term: Json) -> bool:
    fields = term.get("matchFields") or []
    return all(valid(each) for each in term.get("matchExpressions") or []) and all(
        each["key"] == "metadata.name" and each["operator"] in {"In", "NotIn"} and len(each.get("values") or []) == 1
        for each in fields
    )


def term_empty(term: Json) -> bool:
    return not term.get("matchExpressions") and not term.get("matchFields")


def term_matches(term: Json, labels: Labels, name: str) -> bool:
    """One NodeSelectorTerm against a node's labels and name. Empty and unreadable terms match nothing."""
    if term_empty(term) or not term_valid(term):
        return False
    return all(holds(each, labels) for each in term.get("matchExpressions") or []) and all(
        holds(each, {"metadata.name": name}) for each in term.get("matchFields") or []
    )


def tolerates(pod: Json, taint: Json) -> bool:
    return any(_tolerates(each, taint) for each in pod["spec"].get("tolerations") or [])


def _tolerates(toleration: Json, taint: Json) -> bool:
    if toleration.get("effect") and toleration["effect"] != taint["effect"]:
        return False
    if toleration.get("key") and toleration["key"] != taint["key"]:
        return False
    operator = toleration.get("operator") or "Equal"
    if operator == "Exists":
        return True
    return operator == "Equal" and (toleration.get("value") or "") == (taint.get("value") or "")


def untolerated(pod: Json, node: Json) -> bool:
    """Whether a NoSchedule or NoExecute taint of the node keeps the pod away."""
    taints = (node.get("spec") or {}).get("taints") or []
    return any(taint["effect"] in {"NoSchedule", "NoExecute"} and not tolerates(pod, taint) for taint in taints)
