"""Topology spread constraints of a pod, its own or the default ones, ready to be counted."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from robotapp_api.model.names import Label
from robotapp_api.values.selector import Expression, label_requirements, matches_requirements
from robotapp_api.values.toleration import HARD_EFFECTS
from robotapp_scheduler.core.api.core_v1 import ZONE, Pod, TopologySpreadConstraint
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.selectors.pod_counts import Census, Counter, Wanted
from robotapp_scheduler.core.selectors.pod_matcher import PodMatcher, Requirements
from robotapp_scheduler.core.selectors.topology_domains import Scope
from robotapp_scheduler.plugins.kubernetes.common.node_selector import own_terms_mask
from robotapp_scheduler.plugins.kubernetes.node.taint_toleration import untolerated

PLUGIN: Final = "PodTopologySpread"
HARD: Final = "DoNotSchedule"
SOFT: Final = "ScheduleAnyway"
HOSTNAME: Final = str(Label.HOSTNAME)


class DefaultConstraint(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """A constraint of the configuration; it has no selector, that is deduced for each pod."""

    topology_key: str = ""
    when_unsatisfiable: str = ""
    max_skew: int = 0
    min_domains: int | None = None
    label_selector: dict[str, Any] | None = None
    match_label_keys: tuple[str, ...] = ()
    node_affinity_policy: str = "Honor"
    node_taints_policy: str = "Ignore"


SYSTEM_DEFAULTS: Final = (
    DefaultConstraint(HOSTNAME, SOFT, 3),
    DefaultConstraint(ZONE, SOFT, 5),
)


class Constraint(NamedTuple):
    """One constraint of one pod."""

    key: str
    max_skew: int
    wanted: Wanted
    self_match: int
    """1 when the pod itself counts."""
    min_domains: int
    honor_affinity: bool
    honor_taints: bool

    def counter(self, nodes: Snapshot) -> Counter:
        """The pods it counts."""
        return nodes.cluster.topology.counter(self.wanted)

    def matches(self, pod: Pod) -> bool:
        """Does its selector mean this pod?"""
        return self.wanted.matchers[0].matches(pod.metadata.namespace, pod.metadata.labels or {})


def own_constraints(pod: PodInfo, when: str) -> tuple[Constraint, ...]:
    """The constraints in the pod's spec with this whenUnsatisfiable. Raises PluginError for an unreadable selector."""
    found = []
    for i, raw in enumerate(pod.pod.spec.topology_spread_constraints):
        if raw.when_unsatisfiable == when:
            found.append(_constraint(raw, pod, _requirements(raw, pod, i)))
    return tuple(found)


def default_constraints(
    pod: PodInfo, when: str, defaults: Sequence[DefaultConstraint], requirements: Requirements
) -> tuple[Constraint, ...]:
    """The default constraints for a pod whose Services and owner have these selectors; none without a selector."""
    if not requirements:
        return ()
    return tuple(_constraint(raw, pod, requirements) for raw in defaults if raw.when_unsatisfiable == when)


def scope_of(pod: PodInfo, nodes: Snapshot, constraint: Constraint, required_keys: tuple[str, ...]) -> Scope:
    """The rows whose pods count: all required keys present, node affinity and taints as the policies say."""
    table = nodes.cluster.nodes
    key = (
        required_keys,
        pod.features(("node_affinity", "node_selector")) if constraint.honor_affinity else None,
        pod.tolerations if constraint.honor_taints else None,
    )
    version_key = (table.generation, table.taint_generation if constraint.honor_taints else 0)

    def mask() -> BoolArray:  # an expression here would be evaluated for every pod
        every = Snapshot(nodes.cluster)
        found = every.valid.copy()
        for name in required_keys:
            found &= every.label(name).exists
        if constraint.honor_affinity:
            found &= own_terms_mask(pod, every)
        if constraint.honor_taints:
            codes, sets = every.taint_sets
            found &= np.array([not untolerated(taints, pod.tolerations, HARD_EFFECTS) for taints in sets])[codes]
        return found

    return nodes.cluster.topology.scopes.get(key, version_key, mask)


def _constraint(
    raw: TopologySpreadConstraint | DefaultConstraint, pod: PodInfo, requirements: Requirements | None
) -> Constraint:
    matcher = PodMatcher(frozenset((pod.namespace,)), requirements)
    return Constraint(
        key=raw.topology_key,
        max_skew=raw.max_skew,
        wanted=Wanted((matcher,), Census.SPREAD),
        self_match=int(requirements is not None and matches_requirements(requirements, pod.labels)),
        min_domains=1 if raw.min_domains is None else raw.min_domains,
        honor_affinity=raw.node_affinity_policy == "Honor",
        honor_taints=raw.node_taints_policy == "Honor",
    )


def _requirements(raw: TopologySpreadConstraint, pod: PodInfo, index: int) -> Requirements | None:
    found = label_requirements(raw.label_selector)
    if found is None:
        if raw.label_selector is None:
            return None
        raise PluginError(PLUGIN, f"topologySpreadConstraints[{index}].labelSelector cannot be evaluated")
    same = {Expression(key, "In", (pod.labels[key],)) for key in raw.match_label_keys if key in pod.labels}
    return tuple(sorted({*found, *same})) if same else found
