"""Which spread constraints hold for a pod: its own, or the profile's defaults with a selector derived for the pod."""

from dataclasses import dataclass

from campaigns.reference_scheduler.labels import (
    labels_of,
    selector_empty,
    selector_matches,
    untolerated,
)
from campaigns.reference_scheduler.model import Json
from campaigns.reference_scheduler.node_affinity import matches_pod
from campaigns.reference_scheduler.state import State, name_of, namespace_of, terminating

HOSTNAME = "kubernetes.io/hostname"
ZONE = "topology.kubernetes.io/zone"
_SYSTEM_DEFAULTS = ({"maxSkew": 3, "topologyKey": HOSTNAME}, {"maxSkew": 5, "topologyKey": ZONE})


@dataclass(frozen=True)
class Constraint:
    """One constraint; `selector` has the values of matchLabelKeys in it."""

    key: str
    max_skew: int
    selector: Json | None
    min_domains: int = 1
    honor_affinity: bool = True
    honor_taints: bool = False

    def includes(self, pod: Json, node: Json) -> bool:
        """Whether the node's pods count at all."""
        if self.honor_affinity and not matches_pod(pod, node):
            return False
        return not (self.honor_taints and untolerated(pod, node))

    def counts(self, pod: Json, other: Json) -> bool:
        """Whether a placed pod counts. An empty selector, which does match the pod itself, counts nobody."""
        return (
            not terminating(other)
            and not selector_empty(self.selector)
            and namespace_of(other) == namespace_of(pod)
            and selector_matches(self.selector, labels_of(other))
        )

    def counts_in_trial(self, pod: Json, other: Json) -> bool:
        """The same for pods taken away or added after PreFilter, where upstream asks the selector alone."""
        return namespace_of(other) == namespace_of(pod) and selector_matches(self.selector, labels_of(other))


def hard(state: State) -> list[Constraint]:
    return _constraints(state, "DoNotSchedule")


def soft(state: State) -> list[Constraint]:
    return _constraints(state, "ScheduleAnyway")


def is_system_default(state: State) -> bool:
    """Nodes without a default constraint's key are scored all the same."""
    return not state.pod["spec"].get("topologySpreadConstraints") and state.config.spread_defaults is None


def _constraints(state: State, action: str) -> list[Constraint]:
    own = state.pod["spec"].get("topologySpreadConstraints") or []
    if own:
        return [_read(state.pod, each) for each in own if each["whenUnsatisfiable"] == action]
    defaults = state.config.spread_defaults
    if defaults is None:
        defaults = tuple({**each, "whenUnsatisfiable": "ScheduleAnyway"} for each in _SYSTEM_DEFAULTS)
    selector = derived_selector(state)
    if selector_empty(selector):
        return []
    return [
        _read(state.pod, {**each, "labelSelector": selector})
        for each in defaults
        if each["whenUnsatisfiable"] == action
    ]


def _read(pod: Json, raw: Json) -> Constraint:
    return Constraint(
        key=raw["topologyKey"],
        max_skew=int(raw["maxSkew"]),
        selector=_with_label_keys(pod, raw),
        min_domains=int(raw.get("minDomains") or 1),
        honor_affinity=(raw.get("nodeAffinityPolicy") or "Honor") == "Honor",
        honor_taints=(raw.get("nodeTaintsPolicy") or "Ignore") == "Honor",
    )


def _with_label_keys(pod: Json, raw: Json) -> Json | None:
    selector: Json | None = raw.get("labelSelector")
    labels = labels_of(pod)
    extra = [
        {"key": key, "operator": "In", "values": [labels[key]]}
        for key in raw.get("matchLabelKeys") or []
        if key in labels
    ]
    if selector is None or not extra:
        return selector
    return {**selector, "matchExpressions": [*(selector.get("matchExpressions") or []), *extra]}


def derived_selector(state: State) -> Json:
    """Selectors of the pod's Services merged, and that of the controller that owns it; {} when there is none."""
    pod = state.pod
    merged: dict[str, str] = {}
    for service in state.cluster.services:
        wanted = service["spec"].get("selector")
        if not wanted or namespace_of(service) != namespace_of(pod):
            continue
        if all(labels_of(pod).get(key) == value for key, value in wanted.items()):
            merged.update(wanted)
    expressions: list[Json] = []
    kind, controller = _controller(state)
    if controller is not None and kind == "ReplicationController":
        merged.update(controller["spec"].get("selector") or {})
    elif controller is not None:
        selector = controller["spec"].get("selector") or {}
        expressions = [
            {"key": key, "operator": "In", "values": [value]}
            for key, value in (selector.get("matchLabels") or {}).items()
        ]
        expressions += selector.get("matchExpressions") or []
    return {"matchLabels": merged, "matchExpressions": expressions}


def _controller(state: State) -> tuple[str, Json | None]:
    kinds = {
        ("v1", "ReplicationController"): state.cluster.replication_controllers,
        ("apps/v1", "ReplicaSet"): state.cluster.replica_sets,
        ("apps/v1", "StatefulSet"): state.cluster.stateful_sets,
    }
    for owner in state.pod["metadata"].get("ownerReferences") or []:
        if owner.get("controller"):
            for each in kinds.get((owner.get("apiVersion", ""), owner["kind"]), []):
                if (namespace_of(each), name_of(each)) == (namespace_of(state.pod), owner["name"]):
                    return owner["kind"], each
    return "", None
