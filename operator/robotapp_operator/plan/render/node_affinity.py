"""Where a component may run: node requirements, tolerations, and affinity for schedulers that cannot read a RobotApp."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from robotapp_api.checks.spec import neighbours_of
from robotapp_api.model.app.component import Component
from robotapp_api.model.names import HARDWARE_PREFIX, SCHEDULING_GATE, Label
from robotapp_api.values.placement.component_nodes import (
    is_in,
    may_be_on_robot,
    required_nodes,
    robot_tolerations,
    tier_terms,
)
from robotapp_api.values.placement.neighbours import NO_NEIGHBOURS
from robotapp_api.values.placement.tiers import KEEP, ROBOT, on_disconnect
from robotapp_api.values.selector import matches_labels
from robotapp_api.values.toleration import HARD_EFFECTS, tolerates
from robotapp_claims.rules.device import claimed
from robotapp_operator.plan.render.child import component_labels, selector
from robotapp_operator.plan.spec.desired import Desired
from robotapp_operator.plan.spec.objects import Taint, Toleration

DISCONNECTED: Final = ("node.kubernetes.io/not-ready", "node.kubernetes.io/unreachable")


def _keeps_pods(component: Component, desired: Desired) -> bool:
    """Whether pods of the component stay on a lost node: `on_disconnect`, and one more rule for other schedulers.

    Our scheduler holds a successor back while its predecessor may still drive; others do not, so with them a pod that may be
    on a robot is kept as well.
    """
    if (
        not component.on_disconnect
        and not desired.app.our_scheduler
        and may_be_on_robot(component.runs_on, desired.robot_name)
    ):
        return True
    return on_disconnect(component.runs_on, component.on_disconnect) == KEEP


def tolerations(component: Component, desired: Desired) -> list[dict[str, Any]]:
    """The component's own, then robots' taints where it may run there, then how long it stays on a lost node."""
    result = [*component.template.spec.tolerations]
    if may_be_on_robot(component.runs_on, desired.robot_name):
        result += robot_tolerations(desired.robot_name)
    return result + disconnect_tolerations(None if _keeps_pods(component, desired) else int(desired.app.grace_s))


def shared_tolerations(desired: Desired) -> list[dict[str, Any]]:
    """What every component tolerates. Servers and routers go where all components may: a tainted pool is then no trap."""
    first, *others = (component.template.spec.tolerations.unpack() for component in desired.app.ros_components)
    return [one for one in first if all(one in other for other in others)]


def shared_node_selector(desired: Desired) -> dict[str, str]:
    """Labels that every component requires of its node."""
    first, *others = desired.app.ros_components
    return {
        key: value
        for key, value in first.template.spec.node_selector.items()
        if all(other.template.spec.node_selector.get(key) == value for other in others)
    }


def disconnect_tolerations(seconds: int | None) -> list[dict[str, Any]]:
    """`seconds` None: for ever. A robot out of reach still drives; its pods must not be replaced elsewhere."""
    limit = {} if seconds is None else {"tolerationSeconds": seconds}
    return [{"key": key, "operator": "Exists", "effect": "NoExecute", **limit} for key in DISCONNECTED]


def scheduling_gates(desired: Desired) -> dict[str, Any]:
    """The gate of every pod for another scheduler, {} for ours. The operator takes it off when the claim of the pod's domain
    stands, and writes the nodes that admit the pod's namespace into it (`admitted_nodes`): other schedulers read neither.
    """
    return {} if desired.app.our_scheduler else {"schedulingGates": [{"name": SCHEDULING_GATE}]}


def affinity(component: Component, desired: Desired, *, by_claim: bool = False) -> dict[str, Any]:
    """Affinity of the component's pods, {} when nothing is required. by_claim: a ResourceClaim chooses its devices, so no label does.

    Our scheduler reads devices, requirements, colocateWith, sharedData.with and separateFrom from the RobotApp and explains refusals in
    their words; only other schedulers get them as labels and pod affinity.
    """
    result: dict[str, Any] = {}
    terms = _node_terms(component, desired, by_claim=by_claim)
    if terms:
        result["nodeAffinity"] = required_nodes(terms)
    if desired.app.our_scheduler:
        return result
    together, apart = _neighbours(component, desired)
    if together:
        result["podAffinity"] = {"requiredDuringSchedulingIgnoredDuringExecution": together}
    if apart:
        result["podAntiAffinity"] = {"requiredDuringSchedulingIgnoredDuringExecution": apart}
    return result


def nodes_for(
    component: Component, desired: Desired, nodes: Mapping[str, Mapping[str, str]], *, by_claim: bool = False
) -> frozenset[str]:
    """Returns the nodes that the pods' own requirements admit. nodes: labels by name; by_claim: as for `affinity`."""
    terms = [{"matchExpressions": term} for term in _node_terms(component, desired, by_claim=by_claim) or [[]]]
    chosen = component.template.spec.node_selector.items()
    return frozenset(
        name
        for name, labels in nodes.items()
        if chosen <= labels.items() and any(matches_labels(term, labels) for term in terms)
    )


def tolerates_all(component: Component, desired: Desired, taints: Iterable[Taint]) -> bool:
    """Whether the pods are let onto a node with these taints."""
    own = [_toleration(each) for each in tolerations(component, desired)]
    return all(any(tolerates(each, taint) for each in own) for taint in taints if taint.effect in HARD_EFFECTS)


def _toleration(written: Mapping[str, Any]) -> Toleration:
    """Core's fields, of which the schema of a RobotApp checks nothing."""
    return Toleration(*(str(written.get(name) or "") for name in ("key", "operator", "value", "effect")))


def _node_terms(component: Component, desired: Desired, *, by_claim: bool) -> list[list[dict[str, Any]]]:
    """Returns terms for the allowed tiers, and for other schedulers for the hardware."""
    common: list[dict[str, Any]] = []
    if not desired.app.our_scheduler:
        common = [*_hardware(component, by_claim=by_claim), *_keep_to_the_robot(component, desired)]
    terms = tier_terms(component.runs_on, desired.robot_name)
    if not terms:
        return [common] if common else []
    return [[*term, *common] for term in terms]


def _hardware(component: Component, *, by_claim: bool) -> Iterable[dict[str, Any]]:
    for device in component.devices:
        if not (by_claim and claimed(device)):
            yield _labelled(device.type, device.interface, device.model)
    for requirement in component.requires:
        yield _labelled(requirement.type, requirement.interface, requirement.model)


def _keep_to_the_robot(component: Component, desired: Desired) -> Iterable[dict[str, Any]]:
    """Yields where partners that run on the robot alone let the component run, whichever of them is placed first."""
    robot_components = {other.name for other in desired.app.spec.components if tuple(other.runs_on) == (ROBOT,)}
    if not desired.robot_name or not robot_components or component.name in robot_components:
        return
    partners = neighbours_of(desired.app.spec).get(component.name, NO_NEIGHBOURS)
    if robot_components & {*partners.together}:
        yield is_in(Label.ROBOT, desired.robot_name)
    if robot_components & {*partners.apart}:
        yield {"key": Label.ROBOT.value, "operator": "NotIn", "values": [desired.robot_name]}


def _labelled(kind: str, interface: str, model: str) -> dict[str, Any]:
    key = HARDWARE_PREFIX + (f"{kind}-{interface}" if interface else kind)
    return is_in(key, model) if model else {"key": key, "operator": "Exists"}


def _neighbours(component: Component, desired: Desired) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Pod affinity towards components earlier in the list: two pods that each wait for the other would never start."""
    together: list[dict[str, Any]] = []
    apart: list[dict[str, Any]] = []
    own = neighbours_of(desired.app.spec).get(component.name, NO_NEIGHBOURS)
    for other in desired.app.spec.components:
        if other.name == component.name:
            break
        term = {
            "topologyKey": Label.HOSTNAME.value,
            "labelSelector": {"matchLabels": selector(component_labels(desired, other.name))},
        }
        if other.name in own.together:
            together.append(term)
        if other.name in own.apart:
            apart.append(term)
    return together, apart
