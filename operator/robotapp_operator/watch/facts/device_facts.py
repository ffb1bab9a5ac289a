"""Collects what the caches show of devices: those an instance has, lacks or has lost, and those that pods use. No I/O."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from robotapp_api.model.app.component import Component
from robotapp_api.model.names import GPU, Annotation
from robotapp_api.values.placement.tiers import ROBOT
from robotapp_claims.rules.device import claimed, claims_wanted
from robotapp_claims.rules.identity import granted_devices, shared_devices
from robotapp_claims.rules.instances import Instance
from robotapp_claims.rules.objects import Claim
from robotapp_operator.plan.moves.mass_loss import Losses, losses_of
from robotapp_operator.plan.render.child import DEPLOYMENT
from robotapp_operator.plan.render.devices.ledger import describe_ledger
from robotapp_operator.plan.spec.desired import App, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Node, Pod, Telemetry
from robotapp_operator.plan.status.components import ComponentView
from robotapp_operator.plan.status.device_conflicts import PodDevices, device_trouble, missing_device
from robotapp_operator.plan.status.device_loss import LostDevice, is_there, lost_devices, parse_record
from robotapp_operator.watch.cache import Cache


def count_devices(
    app: App,
    instance: Instance,
    held: Collection[Claim],
    cache: Cache,
    views: Iterable[ComponentView],
    *,
    idle: Collection[str],
) -> dict[str, Any]:
    """Returns how many devices the instance wants now, how many it has, and who has the others.

    idle: components that are not started yet, or have ended.
    """
    started_components = [part for part in app.spec.components if part.replicas and part.name not in idle]
    wanted_count = sum(claims_wanted(component.devices) for component in started_components)
    present_count = min(_count_present(held, cache), wanted_count)
    is_short = present_count < wanted_count or _waits_to_share(started_components, views)
    busy = _describe_conflict(app, instance, cache) if is_short else ""
    return {"devices_wanted": wanted_count, "devices_held": present_count, "busy": busy}


def _count_present(claims: Iterable[Claim], cache: Cache) -> int:
    """Counts the claimed devices that the instance has. A claim that waits for the next pod does not count once its device has gone."""
    return sum(claim.standing or is_there(claim, cache.telemetry) is not False for claim in claims)


def find_lost_devices(
    claims: Iterable[Claim], pods: Mapping[str, list[Pod]], deployments: Iterable[Deployment], cache: Cache
) -> tuple[LostDevice, ...]:
    """Returns the lost devices. On nodes that are not Ready only those that were lost before: their last report may be old, and
    the status shows the node's state.
    """
    pods_by_device: dict[str, str] = {}
    for item in deployments:
        pods_by_device |= parse_record(item.metadata.annotations.get(Annotation.LOST_DEVICES, ""))
    recorded_pods = set(pods_by_device.values())
    users = [
        pod.metadata.uid
        for deployment_pods in pods.values()
        for pod in deployment_pods
        if not pod.terminal
        and pod.metadata.deletion_timestamp is None
        and (pod.metadata.uid in recorded_pods or not cache.nodes.lost(pod.spec.node_name))
    ]
    return lost_devices(claims, cache.telemetry, users=users, recorded=pods_by_device)


def devices_of_pods(cache: Cache) -> PodDevices:
    """Returns by node the devices that pods share, and those that bare pods hold alone: an app's pods hold theirs by claims."""
    alone: defaultdict[str, set[str]] = defaultdict(set)
    shared: defaultdict[str, set[str]] = defaultdict(set)
    bare = [pod for pods in cache.bare_pods.values() for pod in pods.values() if not pod.terminal]
    for pod in bare:
        alone[pod.spec.node_name] |= granted_devices(pod.metadata.annotations)
    for pod in (*bare, *(pod for pods in cache.pods.values() for pod in pods.values() if not pod.terminal)):
        shared[pod.spec.node_name] |= shared_devices(pod.metadata.annotations)
    return PodDevices(alone=alone, shared=shared)


def device_losses(cache: Cache) -> Losses:
    """Returns the lost devices of the whole cluster, by both ledgers. A device that is missing in the agent's report is lost when its
    loss was recorded.
    """

    def is_lost(claim: Claim) -> bool:
        is_present = is_there(claim, cache.telemetry)
        return is_present is False or (is_present is None and _is_recorded(claim, cache))

    return losses_of((claim, is_lost(claim)) for claim in cache.claims_by_name.values() if claim.spec.device)


def _is_recorded(claim: Claim, cache: Cache) -> bool:
    deployments = cache.deployments.of_instance(claim.holder.uid, claim.holder.instance).values()
    texts = [item.metadata.annotations.get(Annotation.LOST_DEVICES, "") for item in deployments]
    return any(parse_record(text).get(claim.name) == claim.status.pod for text in texts if text)


def _waits_to_share(components: Iterable[Component], views: Iterable[ComponentView]) -> bool:
    """Returns whether a component without a node wants a device that it would share: no claim shows that it lacks one."""
    component_names = {view.name for view in views if not view.bound}
    return any(
        not claimed(device) and device.type != GPU
        for component in components
        if component.name in component_names
        for device in component.devices
    )


def _describe_conflict(app: App, instance: Instance, cache: Cache) -> str:
    return device_trouble(
        app,
        instance,
        claims=cache.claims_by_name,
        telemetry=_telemetry_in_reach(app, instance, cache),
        nodes=cache.nodes,
    )


def ledger_facts(
    app: App, instance: Instance, views: Iterable[ComponentView], owned: Iterable[Deployment], cache: Cache
) -> dict[str, Any]:
    """Returns how the instance's devices reach its containers, and which of them no node has."""
    placed = {view.name: view.node for view in views if view.node}
    return {
        "devices_handed_over": len(cache.devices_handed_over(app.uid, instance.robot)),
        "any_scheduler": all(_has_claim(component, app, instance, cache) for component in app.spec.components),
        "ledger_note": _describe_ledger(app, instance, owned, placed, cache),
        "missing_device": _describe_missing(app, instance, [view.name for view in views if not view.bound], cache),
    }


def _has_claim(component: Component, app: App, instance: Instance, cache: Cache) -> bool:
    """Returns whether the component's devices are in a ResourceClaim, or it wants none."""
    claims = cache.allocations.claims.of_instance(app.uid, instance.robot).values()
    name = desired_of(app, instance.robot).name_of(component.name)
    return not claims_wanted(component.devices) or name in {claim.metadata.name for claim in claims}


def _describe_ledger(
    app: App, instance: Instance, owned: Iterable[Deployment], placed: Mapping[str, str], cache: Cache
) -> str:
    drivers = cache.allocations.driver_nodes(cache.nodes)
    if not drivers.names and not cache.allocations.claims.of_instance(app.uid, instance.robot):
        return ""
    labels = {name: node.metadata.labels for name, node in _nodes_in_reach(app, instance, cache).items()}
    observed = {ChildRef(DEPLOYMENT, item.metadata.name): item for item in owned}
    return describe_ledger(desired_of(app, instance.robot), observed, drivers, labels, places=placed)


def _describe_missing(app: App, instance: Instance, components: Collection[str], cache: Cache) -> str:
    if not components or not app.our_scheduler:
        return ""
    return missing_device(
        app,
        instance,
        components,
        telemetry=_telemetry_in_reach(app, instance, cache),
        nodes=_nodes_in_reach(app, instance, cache),
    )


def _nodes_in_reach(app: App, instance: Instance, cache: Cache) -> Mapping[str, Node]:
    """Returns the nodes where components with devices may run: of a fleet's robots only the instance's own."""
    if not _is_on_board(app, instance):
        return cache.nodes
    computers = cache.nodes.of_robot(instance.robot)
    return {name: node for name in computers if (node := cache.nodes.get(name)) is not None}


def _is_on_board(app: App, instance: Instance) -> bool:
    """Returns whether all components with devices stay on the instance's robot."""
    with_devices = [component for component in app.spec.components if component.devices]
    return bool(instance.robot) and all(component.runs_on == (ROBOT,) for component in with_devices)


def _telemetry_in_reach(app: App, instance: Instance, cache: Cache) -> Mapping[str, Telemetry]:
    """Returns the reports of the nodes where components with devices may run: of a fleet's robots only the instance's own."""
    if not _is_on_board(app, instance):
        return cache.telemetry
    computers = cache.nodes.of_robot(instance.robot)
    return {name: cache.telemetry[name] for name in computers if name in cache.telemetry}
