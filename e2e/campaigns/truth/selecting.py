"""Node selectors as Kubernetes documents them, written once more: the judge uses none of our code for them."""

from collections.abc import Mapping
from typing import Any


def admits(pod: Mapping[str, Any], node: Mapping[str, Any]) -> bool:
    """Does the node match the pod's nodeSelector and its required node affinity?"""
    spec, labels = pod["spec"], node["metadata"].get("labels", {})
    if any(labels.get(key) != value for key, value in (spec.get("nodeSelector") or {}).items()):
        return False
    affinity = ((spec.get("affinity") or {}).get("nodeAffinity") or {}).get(
        "requiredDuringSchedulingIgnoredDuringExecution"
    )
    if not affinity:
        return True
    fields = {"metadata.name": node["metadata"]["name"]}
    return any(
        all(_holds(each, labels) for each in term.get("matchExpressions", ()))
        and all(_holds(each, fields) for each in term.get("matchFields", ()))
        for term in affinity["nodeSelectorTerms"]
    )


def _holds(expression: Mapping[str, Any], values: Mapping[str, str]) -> bool:
    have, wanted = values.get(expression["key"]), expression.get("values", [])
    match expression["operator"]:
        case "In":
            return have in wanted
        case "NotIn":
            return have not in wanted
        case "Exists":
            return have is not None
        case "DoesNotExist":
            return have is None
        case "Gt":
            return have is not None and int(have) > int(wanted[0])
    return have is not None and int(have) < int(wanted[0])
