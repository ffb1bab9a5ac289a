"""Resolves a pod's ROS requirements against the cluster as it is now: annotations or RobotApp in, `RosContext` out."""

from collections.abc import Callable
from datetime import datetime
from typing import Final, Protocol

from robotapp_api.model.names import GPU, POD_CLAIM, ROBOT_END, Label
from robotapp_api.values.placement.neighbours import NO_NEIGHBOURS
from robotapp_api.values.quantities.duration import parse_us
from robotapp_claims.rules.device import claimed
from robotapp_scheduler.core.api.robotics_v1alpha1 import Component
from robotapp_scheduler.core.api.ros import (
    DEFAULT_QOS_CLASS,
    EXCLUSIVE_TYPES,
    DeviceHolder,
    DeviceRequest,
    Endpoint,
    Hardware,
    InvalidAnnotation,
    PeerGroup,
    RosContext,
    RosRequest,
    SharedVolume,
)
from robotapp_scheduler.core.pods.pod_info import Member, PlacedPod, PodInfo
from robotapp_scheduler.core.robotics.access_links import AccessLinks
from robotapp_scheduler.core.robotics.app_index import App, AppIndex, Link, balances, on_one_node, tied
from robotapp_scheduler.core.robotics.fallback import held_until

HELPER_BUDGET_US: Final = 100_000
"""Measure of a helper's nearness in an app without budgets."""
NOTHING: Final = RosRequest()
"""Annotations that are present and require nothing."""


class Surroundings(Protocol):
    """What resolving looks at (the Cluster)."""

    @property
    def apps(self) -> AppIndex: ...
    @property
    def now(self) -> Callable[[], datetime]:
        """The time of day."""

    def robot_nodes(self, robot: str) -> tuple[str, ...]:
        """Nodes of a robot."""

    def robot_end(self, robot: str) -> tuple[str, ...]:
        """The robot's primary node; all of its nodes while that is not known."""

    @property
    def links(self) -> AccessLinks: ...
    def placed_named(self, namespace: str, name: str) -> list[PlacedPod]:
        """Placed pods of this name, or of the Deployment of this name."""

    def shared_volume(self, namespace: str, claim: str) -> SharedVolume | None:
        """What a claim means for a pod whose shared data it is; None where it limits no pod."""


def resolve(pod: PodInfo, around: Surroundings) -> RosContext | None:
    """The pod's context; None when it has no ROS field at all, so that every ROS plugin skips it.

    A pod of a RobotApp takes everything from the app; annotations only count on other pods.
    """
    if pod.member is not None:
        app = around.apps.app(pod.member.app_uid)
        component = app.components.get(pod.member.component) if app else None
        if app is not None and component is not None:
            return _of_app(pod, pod.member, app, component, around)
        if app is not None:
            return _of_helper(pod, pod.member, app, around)
    request = pod.ros_request
    if request is None or isinstance(request, InvalidAnnotation) or request == NOTHING:
        return None
    return _of_annotations(pod, request, around)


# --- Pods of a RobotApp ----------------------------------------------------------------------------------------------


def _of_app(pod: PodInfo, member: Member, app: App, component: Component, around: Surroundings) -> RosContext:
    spec = app.source.spec
    own_budget_us = _us(component.policies.latency_budget)
    until = held_until(app, member.instance, around.apps, around.now)
    endpoints = _app_endpoints(pod, member, app, around, held=until is not None)
    if not endpoints and own_budget_us is not None:
        endpoints = _robot_endpoint(member.instance, around, budget_us=own_budget_us)
    # Those that a driver hands over are in the pod's ResourceClaim, and in no RobotClaim.
    handed_over = any(each.name == POD_CLAIM for each in pod.pod.spec.resource_claims)
    requests = tuple(
        DeviceRequest(d.name, d.type, d.model, d.interface, d.usb_id or "", claimed(d))
        for d in component.devices
        if d.type != GPU and not (handed_over and claimed(d))
        for _ in range(d.count)
    )
    shared = component.shared_data
    flows = tuple(around.links.flows(member, component.name, but=pod.uid)) if app.flows else ()
    free_bps = around.links.free() if flows else None
    return RosContext(
        tenant=pod.namespace,
        qos_class=component.qos_class,
        endpoints=endpoints,
        unknown_end=_lacks_end(member, app, component, around),
        flows=flows if free_bps is not None else (),
        links=hash(free_bps.tobytes()) if free_bps is not None else 0,
        deadline_us=_us(component.policies.deadline),
        zones=spec.placement.zones,
        master_node=spec.placement.master_node,
        hardware=_app_hardware(component),
        devices=requests,
        holder=DeviceHolder(app.uid, pod.namespace, member.instance, member.component, pod.uid) if requests else None,
        tiers=component.runs_on if len(component.runs_on) > 1 else (),
        together=(
            *_partners(pod, member, app, around),
            *_named_peers(pod, shared.peer_pods, around),
        ),
        apart=_apart(member, app, around),
        volumes=_shared_volumes(pod, shared.claim_names, around),
        balance=balances(app),
        held_until=until,
    )


def _of_helper(pod: PodInfo, member: Member, app: App, surroundings: Surroundings) -> RosContext:
    """Returns the context of a discovery server, router or master: the nearer to the components that it serves, the better.

    It has no budget of its own. The app's tightest one is the measure, so that a server is not farther away than its clients.
    """
    budgets_us = [link.budget_us for links in app.links.values() for link in links if link.budget_us is not None]
    budget_us = min(budgets_us, default=HELPER_BUDGET_US)
    endpoints = []
    for name in app.components:
        nodes = _nodes_of(member, (name,), surroundings) or surroundings.apps.expected(member, name)
        if nodes:
            endpoints.append(Endpoint(f"component {name}", nodes, budget_us, required=False))
    return RosContext(tenant=pod.namespace, endpoints=tuple(endpoints))


def _app_hardware(component: Component) -> tuple[Hardware, ...]:
    # No claim is made for a GPU: its device plugin allocates it, the node only has to have one.
    gpus = tuple(Hardware(d.type, d.model, d.interface) for d in component.devices if d.type == GPU)
    return component.requires + gpus


def _app_endpoints(pod: PodInfo, member: Member, app: App, around: Surroundings, *, held: bool) -> tuple[Endpoint, ...]:
    """`held`: Preferred budgets are required."""
    component = app.components[member.component]
    own_us = _us(component.policies.latency_budget)
    found: list[Endpoint] = []
    for link in app.links.get(component.name, ()):
        budget_us = link.budget_us if link.budget_us is not None else own_us
        if link.peer == ROBOT_END:
            nodes = around.robot_end(member.instance)
            if nodes:
                found.append(_end(link, nodes, budget_us, required=link.required or held))
            continue
        peer = app.components.get(link.peer)
        # A pod that cannot go elsewhere is placed all the same; the peer, which can, has to come closer.
        required = (link.required or held) and not (tied(component) and peer is not None and not tied(peer))
        replicas = around.apps.replicas(member, link.peer)
        places: list[tuple[str, ...]] = [(r.node,) for r in replicas if r.node and r.pod.metadata.uid != pod.uid]
        if not places:
            # A pod planned before its peer must not end up where no node of the peer is in reach.
            tied_to = around.robot_nodes(member.instance) if peer is not None and tied(peer) else ()
            places = [tied_to or around.apps.expected(member, link.peer)]
        found.extend(_end(link, nodes, budget_us, required=required) for nodes in places if nodes)
    return tuple(dict.fromkeys(found))


def _lacks_end(member: Member, app: App, component: Component, around: Surroundings) -> bool:
    """Has a required budget the robot as its other end, where no node is the instance's robot?"""
    links = app.links.get(component.name, ())
    to_robot = any(link.peer == ROBOT_END and link.required for link in links)
    if not links:  # then the component's own budget is that of its distance to the robot
        to_robot = _us(component.policies.latency_budget) is not None
    return to_robot and not around.robot_end(member.instance)


def _end(link: Link, nodes: tuple[str, ...], budget_us: int | None, *, required: bool) -> Endpoint:
    what = link.edge
    return Endpoint(what, nodes, budget_us, link.percentile, required, not link.required)


def _partners(pod: PodInfo, member: Member, app: App, around: Surroundings) -> tuple[PeerGroup, ...]:
    """Components it must share a node with, whichever of them declares it; one that is planned later by where it may still go."""
    found = []
    for name in app.neighbours.get(member.component, NO_NEIGHBOURS).together:
        nodes = _nodes_of(member, (name,), around) or tuple(sorted(around.apps.expected(member, name)))
        found.append(PeerGroup(what=f"component {name}", nodes=nodes))
    if app.components[member.component].replicas > 1 and on_one_node(app, member.component):
        own = {each.node for each in around.apps.replicas(member, member.component) if each.pod.metadata.uid != pod.uid}
        found.append(PeerGroup(what=f"component {member.component}", nodes=tuple(sorted(own - {""}))))
    return tuple(found)


def _apart(member: Member, app: App, around: Surroundings) -> tuple[str, ...]:
    """Nodes of components it must not share one with, whichever of the two declares it.

    A peer that is placed later counts on the only node it can use: the pod that is placed first must leave that node to it.
    """
    names = app.neighbours.get(member.component, NO_NEIGHBOURS).apart
    nodes = set(_nodes_of(member, names, around))
    for name in names:
        peer = app.components[name]
        if not _nodes_of(member, (name,), around):
            places = around.robot_nodes(member.instance) if tied(peer) else around.apps.expected(member, name)
            nodes.update(places if len(places) == 1 else ())
    return tuple(sorted(nodes))


def _nodes_of(member: Member, components: tuple[str, ...], around: Surroundings) -> tuple[str, ...]:
    nodes = {replica.node for name in components for replica in around.apps.replicas(member, name) if replica.node}
    return tuple(sorted(nodes))


# --- Pods with annotations -------------------------------------------------------------------------------------------


def _of_annotations(pod: PodInfo, request: RosRequest, around: Surroundings) -> RosContext:
    requests = tuple(
        DeviceRequest(name=f"{h.type}{i}", type=h.type, model=h.model, interface=h.interface)
        for i, h in enumerate(request.hardware)
        if h.type in EXCLUSIVE_TYPES
    )
    endpoints = _annotated_endpoints(pod, request, around)
    return RosContext(
        tenant=pod.namespace,
        qos_class=request.qos_class,
        endpoints=endpoints,
        unknown_end=request.latency_budget_us is not None and not endpoints,
        deadline_us=request.deadline_us,
        zones=request.zones,
        master_node=request.master_node,
        hardware=request.hardware,
        devices=requests,
        holder=DeviceHolder(uid=pod.uid, namespace=pod.namespace, pod_uid=pod.uid) if requests else None,
        together=_named_peers(pod, request.peer_pods, around),
        volumes=_shared_volumes(pod, request.volume_claims, around),
    )


def _annotated_endpoints(pod: PodInfo, request: RosRequest, around: Surroundings) -> tuple[Endpoint, ...]:
    """The other end of a bare pod's budget: master node, else its placed peers, else the robot of its label."""
    budget_us = request.latency_budget_us
    if request.master_node:
        return (Endpoint(f"master node {request.master_node}", (request.master_node,), budget_us),)
    peers = _named_peers(pod, request.peer_pods, around)
    placed = tuple(Endpoint(f"peer {peer.what}", (node,), budget_us) for peer in peers for node in peer.nodes)
    return placed or _robot_endpoint(pod.labels.get(Label.ROBOT, ""), around, budget_us=budget_us)


def _robot_endpoint(robot: str, around: Surroundings, *, budget_us: int | None) -> tuple[Endpoint, ...]:
    nodes = around.robot_end(robot) if robot else ()
    return (Endpoint(f"robot {robot}", nodes, budget_us),) if nodes else ()


def _named_peers(pod: PodInfo, names: tuple[str, ...], around: Surroundings) -> tuple[PeerGroup, ...]:
    """Peers by pod or Deployment name in the pod's own namespace; order of start does not matter."""
    groups = []
    for name in dict.fromkeys(names):
        nodes = sorted({peer.node for peer in around.placed_named(pod.namespace, name) if peer.uid != pod.uid})
        groups.append(PeerGroup(what=name, nodes=tuple(nodes)))
    return tuple(groups)


def _shared_volumes(pod: PodInfo, claims: tuple[str, ...], around: Surroundings) -> tuple[SharedVolume, ...]:
    found = (around.shared_volume(pod.namespace, claim) for claim in dict.fromkeys(claims))
    return tuple(each for each in found if each is not None)


def _us(text: str) -> int | None:
    """A duration of an app; unreadable ones are in `App.problems` and hold the pod before it gets here."""
    try:
        return parse_us(text) if text else None
    except ValueError:
        return None


def qos_fields(pod: PodInfo, apps: AppIndex) -> tuple[str, str, str] | None:
    """(qos class, reliability, liveliness) for the queue; None for a pod without ROS fields."""
    if pod.member is not None:
        app = apps.app(pod.member.app_uid)
        component = app.components.get(pod.member.component) if app else None
        if component is not None:
            return component.qos_class, component.policies.reliability, component.policies.liveliness
    request = pod.ros_request
    if isinstance(request, RosRequest):
        return request.qos_class, request.reliability, request.liveliness
    return (DEFAULT_QOS_CLASS, "", "") if pod.member is not None else None
