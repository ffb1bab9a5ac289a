"""Filters in upstream's order. Each answers the reasons for one node, [] when it passes, and whether it is final."""

from collections.abc import Callable
from typing import Any

from tests.support.reference_scheduler.amounts import allocatable, named, occupied

Json = dict[str, Any]
Answer = tuple[list[str], bool]
"""(reasons, unresolvable)"""
PASS: Answer = ([], False)


def tolerated(pod: Json, taint: Json) -> bool:
    for toleration in pod["spec"].get("tolerations") or []:
        if toleration.get("effect") and toleration["effect"] != taint["effect"]:
            continue
        if toleration.get("key") and toleration["key"] != taint["key"]:
            continue
        operator = toleration.get("operator") or "Equal"
        if operator == "Exists":
            return True
        if operator == "Equal" and toleration.get("value", "") == taint.get("value", ""):
            return True
    return False


def node_name(pod: Json, node: Json, _: list[Json]) -> Answer:
    wanted = pod["spec"].get("nodeName")
    if wanted and wanted != node["metadata"]["name"]:
        return ["node(s) didn't match the requested node name"], True
    return PASS


def node_unschedulable(pod: Json, node: Json, _: list[Json]) -> Answer:
    cordon = {"key": "node.kubernetes.io/unschedulable", "effect": "NoSchedule"}
    if node["spec"].get("unschedulable") and not tolerated(pod, cordon):
        return ["node(s) were unschedulable"], True
    return PASS


def taint_toleration(pod: Json, node: Json, _: list[Json]) -> Answer:
    for taint in node["spec"].get("taints") or []:
        if taint["effect"] in {"NoSchedule", "NoExecute"} and not tolerated(pod, taint):
            return ["node(s) had untolerated taint(s)"], True
    return PASS


def parsed(text: str | None) -> int | None:
    try:
        return int(text) if text is not None and text.strip() == text and "_" not in text else None
    except ValueError:
        return None


def requirement_valid(requirement: Json) -> bool:
    values = requirement.get("values") or []
    operator = requirement.get("operator")
    if operator in {"In", "NotIn"}:
        return len(values) > 0
    if operator in {"Exists", "DoesNotExist"}:
        return len(values) == 0
    return operator in {"Gt", "Lt"} and len(values) == 1 and parsed(values[0]) is not None


def requirement_holds(requirement: Json, value: str | None) -> bool:
    operator, values = requirement["operator"], requirement.get("values") or []
    if operator == "In":
        return value in values and value is not None
    if operator == "NotIn":
        return value is None or value not in values
    if operator == "Exists":
        return value is not None
    if operator == "DoesNotExist":
        return value is None
    number = parsed(value)
    if number is None:
        return False
    return number > int(values[0]) if operator == "Gt" else number < int(values[0])


def term_valid(term: Json) -> bool:
    fields = term.get("matchFields") or []
    return all(requirement_valid(r) for r in term.get("matchExpressions") or []) and all(
        f["key"] == "metadata.name" and f["operator"] in {"In", "NotIn"} and len(f.get("values") or []) == 1
        for f in fields
    )


def term_holds(term: Json, node: Json) -> bool:
    expressions, fields = term.get("matchExpressions") or [], term.get("matchFields") or []
    if not expressions and not fields:
        return False
    if not term_valid(term):
        return False
    labels = node["metadata"].get("labels") or {}
    return all(requirement_holds(e, labels.get(e["key"])) for e in expressions) and all(
        requirement_holds(f, node["metadata"]["name"]) for f in fields
    )


def node_affinity_of(pod: Json) -> Json:
    return (pod["spec"].get("affinity") or {}).get("nodeAffinity") or {}


def node_affinity(pod: Json, node: Json, _: list[Json]) -> Answer:
    refused: Answer = (["node(s) didn't match Pod's node affinity/selector"], True)
    labels = node["metadata"].get("labels") or {}
    for key, value in (pod["spec"].get("nodeSelector") or {}).items():
        if labels.get(key) != value:
            return refused
    required = node_affinity_of(pod).get("requiredDuringSchedulingIgnoredDuringExecution")
    if required is not None and not any(term_holds(term, node) for term in required["nodeSelectorTerms"]):
        return refused
    return PASS


def names_allowed(pod: Json) -> set[str] | None:
    """PreFilter of NodeAffinity: node names all terms insist on; None = every node."""
    required = node_affinity_of(pod).get("requiredDuringSchedulingIgnoredDuringExecution")
    if not required or not required["nodeSelectorTerms"]:
        return None
    union: set[str] = set()
    for term in required["nodeSelectorTerms"]:
        own: set[str] | None = None
        for field in term.get("matchFields") or []:
            if field["key"] == "metadata.name" and field["operator"] == "In":
                own = set(field["values"]) if own is None else own & set(field["values"])
        if own is None:
            return None
        union |= own
    return union


def ports_of(pod: Json) -> list[tuple[str, str, int]]:
    holders = list(pod["spec"]["containers"])
    holders += [c for c in pod["spec"].get("initContainers") or [] if c.get("restartPolicy") == "Always"]
    return [
        (port.get("hostIP") or "0.0.0.0", port.get("protocol") or "TCP", port["hostPort"])  # noqa: S104
        for holder in holders
        for port in holder.get("ports") or []
        if port.get("hostPort", 0) > 0
    ]


def node_ports(pod: Json, _: Json, placed: list[Json]) -> Answer:
    for ip, protocol, port in ports_of(pod):
        for other in placed:
            for other_ip, other_protocol, other_port in ports_of(other):
                same = (protocol, port) == (other_protocol, other_port)
                if same and (ip == other_ip or "0.0.0.0" in {ip, other_ip}):  # noqa: S104
                    return ["node(s) didn't have free ports for the requested pod ports"], False
    return PASS


def resources_fit(pod: Json, node: Json, placed: list[Json]) -> Answer:
    reasons = []
    final = False
    if len(placed) + 1 > allocatable(node, "pods"):
        reasons.append("Too many pods")
    for name in named(pod):
        wanted = occupied(pod, name)
        offered = allocatable(node, name)
        if wanted > 0 and wanted > offered - sum(occupied(other, name) for other in placed):
            reasons.append(f"Insufficient {name}")
            final = final or wanted > offered
    return reasons, final


FILTERS: dict[str, Callable[[Json, Json, list[Json]], Answer]] = {
    "NodeName": node_name,
    "NodeUnschedulable": node_unschedulable,
    "TaintToleration": taint_toleration,
    "NodeAffinity": node_affinity,
    "NodePorts": node_ports,
    "NodeResourcesFit": resources_fit,
}
