"""What the API server makes of a pod before anyone sees it, as far as decisions depend on it."""

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

Json = dict[str, Any]

_REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
_PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"


def admitted(pod: Json) -> Json:
    """Label keys become requirements of the selectors; with host networking container ports are host ports.

    Pod-level requests get what the containers ask for where they say nothing themselves.
    """
    made = deepcopy(pod)
    labels = made["metadata"].get("labels") or {}
    for term in _terms(made):
        _merge(term, labels)
    if made["spec"].get("hostNetwork"):
        for container in made["spec"]["containers"]:
            for port in container.get("ports") or []:
                port.setdefault("hostPort", port["containerPort"])
    _complete_pod_level(made)
    return made


def _terms(pod: Json) -> Iterator[Json]:
    """Everything with label keys: spread constraints and terms of pod affinity."""
    yield from pod["spec"].get("topologySpreadConstraints") or []
    affinity = pod["spec"].get("affinity") or {}
    for kind in ("podAffinity", "podAntiAffinity"):
        part = affinity.get(kind) or {}
        yield from part.get(_REQUIRED) or []
        for weighted in part.get(_PREFERRED) or []:
            yield weighted["podAffinityTerm"]


def _merge(term: Json, labels: Json) -> None:
    for field, operator in (("matchLabelKeys", "In"), ("mismatchLabelKeys", "NotIn")):
        for key in term.get(field) or []:
            if key in labels and term.get("labelSelector") is not None:
                requirement = {"key": key, "operator": operator, "values": [labels[key]]}
                term["labelSelector"].setdefault("matchExpressions", []).append(requirement)


def _complete_pod_level(pod: Json) -> None:
    level = (pod["spec"].get("resources") or {}).get("requests")
    containers = pod["spec"]["containers"]
    if not level or len(containers) != 1:
        return
    for name, amount in ((containers[0].get("resources") or {}).get("requests") or {}).items():
        if name in {"cpu", "memory"} or name.startswith("hugepages-"):
            level.setdefault(name, amount)
