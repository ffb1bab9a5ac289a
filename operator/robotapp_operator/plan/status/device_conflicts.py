"""Why an instance cannot get its devices, for the condition `Allocated`. The scheduler decides; this only explains."""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from robotapp_api.model.app.component import Component
from robotapp_api.model.app.device import Device
from robotapp_api.model.names import GPU
from robotapp_claims.rules.device import busy_text, claimed, fits, is_device
from robotapp_claims.rules.identity import UNKNOWN_DEVICE_TYPE, claim_name_device, device_label
from robotapp_claims.rules.instances import Instance, closed_nodes
from robotapp_claims.rules.node_devices import describe_missing
from robotapp_claims.rules.objects import Claim, DeviceThing
from robotapp_operator.plan.render.node_affinity import nodes_for
from robotapp_operator.plan.spec.desired import App, Desired, desired_of
from robotapp_operator.plan.spec.objects import Node, Telemetry

SHOWN: Final = 3
"""So many devices are named in a message."""
MOST_REQUESTS: Final = 256
"""Beyond these, devices of one app are not compared with each other."""


class Place(NamedTuple):
    """A device that is there."""

    node: str
    id: str

    def __str__(self) -> str:
        return f"{self.id} on {self.node}"


class PodDevices(NamedTuple):
    """By node, the ids of devices that pods there hold alone or share, as their grants name them."""

    alone: Mapping[str, Collection[str]]
    shared: Mapping[str, Collection[str]]


class DeviceRequest(NamedTuple):
    """An exclusive device that a component requests, and the devices that fit, held or not."""

    component: str
    device: str
    fitting: frozenset[Place]


class Places:
    """Devices that are there, by node and by what is asked for: of one app many components may ask for the same."""

    def __init__(self, telemetry: Mapping[str, Telemetry]) -> None:
        self._telemetry = telemetry
        self._found: dict[tuple[str, str, str, str, frozenset[str]], frozenset[Place]] = {}

    def of(self, wanted: Device, nodes: frozenset[str]) -> frozenset[Place]:
        """Those of the kind on these nodes."""
        key = (wanted.type, wanted.model, wanted.interface, wanted.usb_id or "", nodes)
        if key not in self._found:
            self._found[key] = frozenset(
                Place(name, device.id)
                for name, report in self._telemetry.items()
                if name in nodes
                for device in report.status.devices
                if fits(wanted, device)
            )
        return self._found[key]


def device_trouble(
    app: App,
    instance: Instance,
    *,
    claims: Mapping[str, Claim],
    telemetry: Mapping[str, Telemetry],
    nodes: Mapping[str, Node],
) -> str:
    """Why the instance cannot have its devices, as far as that is known before it is placed; "" if nothing is.

    First what the app can never have, because its own components want it twice; then the first device of which every one
    that would do is held by others, whether the app wants it for itself or would share it.
    """
    closed = closed_nodes([node.metadata for node in nodes.values()], app.namespace)
    nodes = {name: node for name, node in nodes.items() if name not in closed}  # messages do not name robots of others
    desired, requests, shared = desired_of(app, instance.robot), list[DeviceRequest](), list[frozenset[Place]]()
    places, labels = Places(telemetry), {name: node.metadata.labels for name, node in nodes.items()}
    for component in app.spec.components:
        devices = [device for device in component.devices if device.type != GPU]
        admitted = nodes_for(component, desired, labels, by_claim=True) if devices else frozenset[str]()
        for device in devices:
            fitting = places.of(device, admitted)
            if not claimed(device):
                shared.append(fitting)
                continue
            requests += [DeviceRequest(component.name, device.name, fitting)] * (device.count if fitting else 0)
    if group := rivals([request.fitting for request in requests[:MOST_REQUESTS]]):
        return _rivals_text([requests[index] for index in group])
    held = _by_node(claims)
    for fitting in dict.fromkeys((*(request.fitting for request in requests), *shared)):
        if other := _held_by_others(fitting, app, instance, held=held, telemetry=telemetry):
            return busy_text(other, for_namespace=app.namespace)
    return ""


def missing_device(
    app: App,
    instance: Instance,
    components: Collection[str],
    *,
    telemetry: Mapping[str, Telemetry],
    nodes: Mapping[str, Node],
) -> str:
    """Which device of these components no node has that may run them, and what these nodes have instead; "" if nothing is missing.

    Nodes without an agent are left out: their labels name devices by words of their own.
    """
    closed = closed_nodes([node.metadata for node in nodes.values()], app.namespace)
    labels = {name: node.metadata.labels for name, node in nodes.items() if name not in closed and name in telemetry}
    unreported = {
        name: node.metadata.labels for name, node in nodes.items() if name not in closed and name not in telemetry
    }
    desired, places = desired_of(app, instance.robot), Places(telemetry)
    for component in app.spec.components:
        wishes = [device for device in component.devices if device.type != GPU]
        if component.name not in components or not wishes or nodes_for(component, desired, unreported):
            continue
        admitted = nodes_for(component, desired, labels, by_claim=True)
        for device in wishes:
            if not places.of(device, admitted):
                reports = {name: telemetry[name].status.devices for name in admitted}
                if text := describe_missing(device, reports):
                    return f"{component.name} ({device.name}): {text}"
    return ""


def _held_by_others(
    fitting: frozenset[Place],
    app: App,
    instance: Instance,
    *,
    held: Mapping[str, Mapping[str, Claim]],
    telemetry: Mapping[str, Telemetry],
) -> Claim | None:
    """The first of the claims when others hold every one of these devices."""
    first: Claim | None = None
    for place in sorted(fitting):
        claim = _claim_on(place, held, telemetry[place.node])
        if claim is None or _belongs(claim, app, instance):
            return None
        first = first or claim
    return first


def free_elsewhere(
    component: Component,
    desired: Desired,
    *,
    but: str,
    claims: Mapping[str, Claim],
    used: PodDevices,
    telemetry: Mapping[str, Telemetry],
    nodes: Mapping[str, Node],
) -> str:
    """The first of `nodes`, other than `but`, with every device that the component asks for, used by nobody; "" without one.

    A device that is shared must be there, too, and may be shared already. used: what pods have of which there is no claim: what they
    share, and what a bare pod holds while its claim is repaired. GPUs are left out: device plugins count them, and no agent reports which
    are free.
    """
    alone: list[Mapping[str, frozenset[Place]]] = []
    shared: list[frozenset[str]] = []
    held = _by_node(claims)
    admitted = nodes_for(component, desired, {name: node.metadata.labels for name, node in nodes.items()})
    places = Places(telemetry)
    for device in component.devices:
        free = frozenset(
            place
            for place in places.of(device, admitted)
            if _claim_on(place, held, telemetry[place.node]) is None and not _is_among(place, used.alone, telemetry)
        )
        if claimed(device):
            unshared = (place for place in free if not _is_among(place, used.shared, telemetry))
            alone += [_places_by_node(unshared)] * device.count
        elif device.type != GPU:
            shared.append(frozenset(place.node for place in free))
    for node in sorted(frozenset[str]().union(*alone) - {but}):
        here = [places.get(node, frozenset()) for places in alone]
        if all(node in having for having in shared) and not rivals(here):
            return node
    return ""


def rivals(fitting: Sequence[frozenset[Place]]) -> list[int]:
    """Which requests, by index, cannot all be had although every device is free; none of them can be left out.

    They are the first request for which no path of rearrangements ends at a device that is left, and all requests on these paths
    (Hall's theorem): each of them could give way to it. Which places a set has first makes no difference.
    """
    user: dict[Place, int] = {}
    for request in range(len(fitting)):
        tried = set[Place]()
        if not _is_placed(request, fitting, user, tried):
            return sorted({request, *(user[place] for place in tried)})
    return []


def _is_placed(request: int, fitting: Sequence[frozenset[Place]], user: dict[Place, int], tried: set[Place]) -> bool:
    """Give the request a device, one that is left or one whose user can have another. user: the request that has a place."""
    for place in fitting[request]:
        if place not in user:
            user[place] = request
            return True
    for place in fitting[request]:
        if place not in tried:
            tried.add(place)
            if _is_placed(user[place], fitting, user, tried):
                user[place] = request
                return True
    return False


def _places_by_node(places: Iterable[Place]) -> dict[str, frozenset[Place]]:
    found: defaultdict[str, set[Place]] = defaultdict(set)
    for place in places:
        found[place.node].add(place)
    return {node: frozenset(here) for node, here in found.items()}


def _by_node(claims: Mapping[str, Claim]) -> Mapping[str, Mapping[str, Claim]]:
    """Claims of devices by node and name."""
    found: defaultdict[str, dict[str, Claim]] = defaultdict(dict)
    for name, claim in claims.items():
        if claim.spec.device is not None:
            found[claim.spec.device.node][name] = claim
    return found


def _rivals_text(group: Sequence[DeviceRequest]) -> str:
    components = [request.component for request in group]
    names = [
        request.component if components.count(request.component) == 1 else f"{request.component} ({request.device})"
        for request in group
    ]
    places = sorted(frozenset[Place]().union(*(request.fitting for request in group)))
    shown = _and([str(place) for place in places[:SHOWN]])
    if len(set(components)) == 1:
        return (
            f"{components[0]} wants {len(group)} devices, but only {shown} would do: remove a device or lower its count"
        )
    names = list(dict.fromkeys(names))
    if len(places) == 1:
        return f"{_and(names)} both want {shown}, which only one can have: remove the device from one of them"
    return f"{_and(names)} want {len(group)} devices, but only {shown} would do: remove a device from one of them"


def _and(names: Sequence[str]) -> str:
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def _claim_on(place: Place, held: Mapping[str, Mapping[str, Claim]], report: Telemetry) -> Claim | None:
    """The claim that holds the device, perhaps under the id it had before the node's agent reported it. held: by node and name."""
    here = held.get(place.node, {})
    if exact := here.get(claim_name_device(place.node, place.id)):
        return exact
    things = ((claim, claim.spec.device) for claim in here.values())
    return next((claim for claim, thing in things if thing and _is(place, thing, report)), None)


def _is_among(place: Place, used: Mapping[str, Collection[str]], telemetry: Mapping[str, Telemetry]) -> bool:
    things = (DeviceThing(node=place.node, type=UNKNOWN_DEVICE_TYPE, id=ident) for ident in used.get(place.node, ()))
    return any(_is(place, thing, telemetry[place.node]) for thing in things)


def _is(place: Place, thing: DeviceThing, report: Telemetry) -> bool:
    """Whether the thing, which is on the same node, is this device."""
    known = {device_label(device.id) for device in report.status.devices}
    device = next(device for device in report.status.devices if device.id == place.id)
    return is_device(thing, device, known=known)


def _belongs(claim: Claim, app: App, instance: Instance) -> bool:
    return claim.holder.uid == app.uid and claim.holder.instance == instance.robot
