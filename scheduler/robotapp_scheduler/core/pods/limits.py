"""Limits on what one pod may request. A pod with ten thousand requirements, each compared on every node, would delay all
other pods for seconds, so it is rejected before anything is compared.
"""

from collections.abc import Callable, Iterator
from typing import Any, Final

from robotapp_scheduler.core.api.core_v1 import Container, NodeSelectorTerm, PodAffinity, PodAffinityTerm, PodSpec


def exceeded_limit(spec: PodSpec) -> str:
    """Why a pod with this spec is rejected; empty for every pod within the limits."""
    for what, most, count in _LIMITS:
        if (found := count(spec)) > most:
            return f"pod asks for {found} {what}, more than {most} are not looked up"
    return ""


def _terms(spec: PodSpec) -> Iterator[PodAffinityTerm]:
    affinity = spec.affinity
    if affinity is None:
        return
    sides: tuple[PodAffinity | None, ...] = (affinity.pod_affinity, affinity.pod_anti_affinity)
    for side in sides:
        if side is not None:
            yield from side.required
            yield from (weighted.pod_affinity_term for weighted in side.preferred)


def _node_terms(spec: PodSpec) -> Iterator[NodeSelectorTerm]:
    affinity = spec.affinity.node_affinity if spec.affinity is not None else None
    if affinity is None:
        return
    if affinity.required is not None:
        yield from affinity.required.node_selector_terms
    yield from (preferred.preference for preferred in affinity.preferred)


def _selectors(spec: PodSpec) -> int:
    """Requirements of all label selectors; what is no selector is the plugins' to refuse."""
    found = 0
    for term in _terms(spec):
        found += _requirements(term.label_selector) + _requirements(term.namespace_selector)
    for constraint in spec.topology_spread_constraints:
        found += _requirements(constraint.label_selector) + len(constraint.match_label_keys)
    return found


def _requirements(selector: dict[str, Any] | None) -> int:
    parts = (selector or {}).values()
    return sum(len(part) for part in parts if isinstance(part, dict | list))


def _containers(spec: PodSpec) -> Iterator[Container]:
    yield from spec.containers
    yield from spec.init_containers or ()


def _resources(spec: PodSpec) -> int:
    names = {name for container in _containers(spec) for name in container.resources.requests or ()}
    return len(names.union(spec.overhead or (), spec.resources.requests or () if spec.resources else ()))


def _host_ports(spec: PodSpec) -> int:
    return sum(port.host_port > 0 for container in _containers(spec) for port in container.ports or ())


def _count(items: Iterator[Any]) -> int:
    return sum(1 for _ in items)


_LIMITS: Final[tuple[tuple[str, int, Callable[[PodSpec], int]], ...]] = (
    ("topologySpreadConstraints", 64, lambda spec: len(spec.topology_spread_constraints)),
    ("pod affinity terms", 128, lambda spec: _count(_terms(spec))),
    ("label selector requirements", 1024, _selectors),
    ("node affinity terms", 512, lambda spec: _count(_node_terms(spec))),
    (
        "node affinity expressions",
        2048,
        lambda spec: sum(len(term.match_expressions) + len(term.match_fields) for term in _node_terms(spec)),
    ),
    ("nodeSelector labels", 512, lambda spec: len(spec.node_selector or ())),
    ("tolerations", 512, lambda spec: len(spec.tolerations)),
    ("resources", 128, _resources),
    ("host ports", 1024, _host_ports),
    ("volumes", 1024, lambda spec: len(spec.volumes or ())),
)
