"""Who stands in the way of an instance's devices, for the condition `Allocated`. The scheduler decides; this only tells."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from robotapp_api.claims.device import assign, busy_text, claimed, fits, is_device
from robotapp_api.claims.identity import claim_name_device, device_label
from robotapp_api.claims.instances import Instance, closed_nodes
from robotapp_api.claims.objects import Claim
from robotapp_api.model.component import Component
from robotapp_api.model.device import Device
from robotapp_operator.plan.render.node_affinity import may_run_on
from robotapp_operator.plan.spec.desired import App, wish_of
from robotapp_operator.plan.spec.desired import Desired as InstanceWish
from robotapp_operator.plan.spec.objects import Node, Telemetry

SHOWN: Final = 3
"""So many devices are named in a message."""


class Place(NamedTuple):
    """A device that is there."""

    node: str
    id: str

    def __str__(self) -> str:
        return f"{self.id} on {self.node}"


class DeviceRequest(NamedTuple):
    """An exclusive device that a component asks for, and those that would do, held or not."""

    component: str
    device: str
    fitting: frozenset[Place]


def device_trouble(
    app: App,
    instance: Instance,
    *,
    claims: Mapping[str, Claim],
    telemetry: Mapping[str, Telemetry],
    nodes: Mapping[str, Node],
) -> str:
    """Why the instance cannot have its devices, as far as that can be told without placing it; "" if nothing is known.

    First what the app can never have, because its own components want it twice; then the first device of which every one
    that would do is held by others.
    """
    closed = closed_nodes([node.metadata for node in nodes.values()], app.namespace)
    nodes = {name: node for name, node in nodes.items() if name not in closed}  # others' robots are not talked about
    wishes = [
        DeviceRequest(component.name, device.name, fitting)
        for component in app.spec.components
        for device in component.devices
        if claimed(device)
        and (fitting := _fitting(component, device, wish_of(app, instance.robot), telemetry=telemetry, nodes=nodes))
    ]
    if group := rivals([wish.fitting for wish in wishes]):
        return _rivals_text([wishes[index] for index in group])
    for wish in wishes:
        found = [_claim_on(place, claims, telemetry[place.node]) for place in sorted(wish.fitting)]
        others = [claim for claim in found if claim is not None and not _belongs(claim, app, instance)]
        if len(others) == len(found):
            return busy_text(others[0], for_namespace=app.namespace)
    return ""


def rivals(fitting: Sequence[frozenset[Place]]) -> list[int]:
    """Which wishes, by index, cannot all be had although every device is free; none of them can be left out."""
    group = list(range(len(fitting)))
    if _can_have(fitting, group):
        return []
    for index in range(len(fitting)):
        rest = [other for other in group if other != index]
        if not _can_have(fitting, rest):
            group = rest
    return group


def _can_have(fitting: Sequence[frozenset[Place]], group: Sequence[int]) -> bool:
    places = sorted(frozenset[Place]().union(*(fitting[index] for index in group)))
    number = {place: index for index, place in enumerate(places)}
    wanted = [{number[place] for place in fitting[index]} for index in group]
    return assign(wanted, preferred=range(len(places))) is not None


def _rivals_text(group: Sequence[DeviceRequest]) -> str:
    components = [wish.component for wish in group]
    names = [
        wish.component if components.count(wish.component) == 1 else f"{wish.component} ({wish.device})"
        for wish in group
    ]
    places = sorted(frozenset[Place]().union(*(wish.fitting for wish in group)))
    shown = _and([str(place) for place in places[:SHOWN]])
    if len(places) == 1:
        return f"{_and(names)} both want {shown}, which only one can have: remove the device from one of them"
    return f"{_and(names)} want {len(group)} devices, but only {shown} would do: remove a device from one of them"


def _and(names: Sequence[str]) -> str:
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def _fitting(
    component: Component,
    asked: Device,
    wish: InstanceWish,
    *,
    telemetry: Mapping[str, Telemetry],
    nodes: Mapping[str, Node],
) -> frozenset[Place]:
    """Devices of the kind on the nodes where the component may run."""
    return frozenset(
        Place(name, device.id)
        for name, report in telemetry.items()
        if name in nodes and may_run_on(component, wish, nodes[name].metadata.labels)
        for device in report.status.devices
        if fits(asked, device)
    )


def _claim_on(place: Place, claims: Mapping[str, Claim], report: Telemetry) -> Claim | None:
    """The claim that holds the device, perhaps under the id it had before the node's agent reported it."""
    if exact := claims.get(claim_name_device(place.node, place.id)):
        return exact
    known = {device_label(device.id) for device in report.status.devices}
    device = next(device for device in report.status.devices if device.id == place.id)
    things = ((claim, claim.spec.device) for claim in claims.values())
    found = (
        claim for claim, thing in things if thing and thing.node == place.node and is_device(thing, device, known=known)
    )
    return next(found, None)


def _belongs(claim: Claim, app: App, instance: Instance) -> bool:
    return claim.holder.uid == app.uid and claim.holder.instance == instance.robot
