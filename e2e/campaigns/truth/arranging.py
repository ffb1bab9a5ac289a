"""What situations are made of: their form, and what can be arranged around an app or happen to it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from typing import Any

from campaigns.rigs.simulated_site import APIS, Object, SimulatedSite, plain_app
from campaigns.truth.screen import Screen
from robotapp_api.model.names import Label
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane.components import SIMULATED_BY_KWOK
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import Device, fleet

SEEN_S = 60.0
CAN = Device("can0", "can", interface="can0")
CAMERA = Device("video-cam", "video", model="d435")
Before = Callable[["Place"], AbstractContextManager[object]]


@dataclass(frozen=True, slots=True)
class Place:
    """The site, and the names of its nodes and pools. `mark` makes them this site's own."""

    site: SimulatedSite
    mark: str
    seen: dict[str, Any] = field(default_factory=dict)
    """What a situation noted for its own check at the end."""

    @property
    def robots(self) -> list[str]:
        return [f"amr-{self.mark}-{number}" for number in (1, 2, 3)]

    @property
    def edges(self) -> list[str]:
        return [f"edge-{self.mark}-{number}" for number in (1, 2)]

    @property
    def cloud(self) -> str:
        return f"cloud-{self.mark}-1"

    def pool(self, name: str) -> str:
        return f"{name}-{self.mark}"

    def patch_node(self, name: str, change: Mapping[str, Any], *, status: bool = False) -> None:
        self.site.cp.api.patch(f"/api/v1/nodes/{name}{'/status' if status else ''}", change)


@dataclass(frozen=True, slots=True)
class Situation:
    """`spec` fills in the app. `around` holds while the app is there and begins before it; `then` happens once it is Ready.

    `says`: condition -> `Status/Reason`. `tells`: regular expressions that messages must fit. `events` there must be, `no_events`
    there may not. `also`: what else is wrong on the screen. Not `ready_first`: `then` begins at once.
    """

    says: Mapping[str, str]
    phase: str
    parts: Sequence[Object] = ({"name": "talk"}, {"name": "hear"})
    spec: Callable[[Place], Object] = field(default=lambda _: {})
    around: Before = nullcontext
    then: Before | None = None
    ready_first: bool = True
    tells: Sequence[str] = ()
    events: Sequence[str] = ()
    no_events: Sequence[str] = ()
    also: Callable[[Place, Screen], Iterable[str]] = lambda _place, _screen: ()


def nodes(mark: str) -> Topology:
    place = Place(site=None, mark=mark)  # type: ignore[arg-type] - for its names alone
    devices = {place.robots[0]: [CAN], **{name: [CAMERA] for name in place.edges}}
    return fleet(robots=place.robots, edges=place.edges, clouds=[place.cloud], devices=devices)


def pools(mark: str) -> dict[str, str]:
    """Ids by name."""
    return {f"many-{mark}": "1-30", f"one-{mark}": "40-40", f"spare-{mark}": "50-50"}


def app_of(situation: Situation, place: Place, name: str = "app") -> Object:
    spec = situation.spec(place)
    pool = {"pool": place.pool("many")}
    ros1 = spec.get("ros", {}).get("distro") == "noetic"
    app = plain_app(name, parts=[part["name"] for part in situation.parts], **spec)
    for component, part in zip(app["spec"]["components"], situation.parts, strict=True):
        component.update(part)
    if not ros1:
        app["spec"]["ros2"] = pool | app["spec"].get("ros2", {})
    return app


def until(what: str, condition: Callable[[], object]) -> None:
    if not wait_until(lambda: bool(condition()), timeout_s=SEEN_S, poll_s=0.3):
        raise TimeoutError(f"{what}: not within {SEEN_S:g} s")


# Around an app


@contextmanager
def other_app(place: Place, *, parts: Sequence[Object] = ({"name": "x"},), **spec: Any) -> Iterator[None]:
    """Another app that is Ready before this one comes."""
    other = Situation(says={}, phase="", parts=parts, spec=lambda _: spec)
    place.site.create(app_of(other, place, "other"))
    place.site.watch.until_ready("other", within_s=SEEN_S)
    yield


@contextmanager
def broken(place: Place, *names: str) -> Iterator[None]:
    """Nodes whose kubelet is silent: kwok no longer plays it, and their pods no longer count as ready, as the node controller has it."""
    for name in names:
        place.patch_node(name, {"metadata": {"labels": {Label.SIMULATED.value: None}}})
        _set_ready(place, name, "Unknown")
    for pod in place.site.pods():
        if pod["spec"].get("nodeName") in names:
            lost = [{"type": kind, "status": "False"} for kind in ("Ready", "ContainersReady")]
            path = f"/api/v1/namespaces/{place.site.namespace}/pods/{pod['metadata']['name']}/status"
            place.site.cp.api.patch(path, {"status": {"conditions": lost}})
    try:
        yield
    finally:
        for name in names:
            place.patch_node(name, {"metadata": {"labels": {Label.SIMULATED.value: SIMULATED_BY_KWOK}}})
            _set_ready(place, name, "True")
        for name in names:
            _await_node_controller(place, name)


def _await_node_controller(place: Place, name: str) -> None:
    """Until its next pass, seconds later, the node controller takes a node for lost, and the pods of the next app for not ready;
    kwok does not report them again.
    """

    def tainted() -> bool:
        taints = place.site.cp.api.get(f"/api/v1/nodes/{name}")["spec"].get("taints", ())
        return any(
            taint["key"].startswith("node.kubernetes.io/") and taint["effect"] == "NoExecute" for taint in taints
        )

    until(f"the node controller takes its taint off {name}", lambda: not tainted())


def _set_ready(place: Place, name: str, status: str) -> None:
    ready = {"type": "Ready", "status": status, "reason": "Test", "message": "", "lastTransitionTime": None}
    place.patch_node(name, {"status": {"conditions": [ready]}}, status=True)


@contextmanager
def labelled(place: Place, node: str, **labels: str | None) -> Iterator[None]:
    """`labels` by the last part of their robotics.io name; None takes one away."""
    stored = place.site.cp.api.get(f"/api/v1/nodes/{node}")["metadata"]["labels"]
    keys = {f"robotics.io/{name.replace('_', '-')}": value for name, value in labels.items()}
    place.patch_node(node, {"metadata": {"labels": keys}})
    try:
        yield
    finally:
        place.patch_node(node, {"metadata": {"labels": {key: stored.get(key) for key in keys}}})


@contextmanager
def cordoned(place: Place, *names: str) -> Iterator[None]:
    for name in names:
        place.patch_node(name, {"spec": {"unschedulable": True}})
    try:
        yield
    finally:
        for name in names:
            place.patch_node(name, {"spec": {"unschedulable": None}})


@contextmanager
def rtt(place: Place, one: str, other: str, ms: float) -> Iterator[None]:
    before = place.site.nodes.rtt_ms(one, other)
    place.site.telemetry.set_rtt(one, other, ms)
    place.site.telemetry.write()
    try:
        yield
    finally:
        place.site.telemetry.set_rtt(one, other, before)


@contextmanager
def pool_of(place: Place, name: str, **spec: Any) -> Iterator[None]:
    body = {"apiVersion": "robotics.io/v1alpha1", "kind": "DomainPool", "metadata": {"name": place.pool(name)}}
    place.site.cp.api.create(
        f"{APIS}/domainpools",
        {**body, "spec": {"scope": "Cluster", "network": place.pool(name), "quarantineSeconds": 1, **spec}},
    )
    try:
        yield
    finally:
        place.site.cp.api.delete(f"{APIS}/domainpools/{place.pool(name)}")


@contextmanager
def edited(place: Place, **spec: Any) -> Iterator[None]:
    place.site.cp.api.patch(f"{place.site.apps_path}/app", {"spec": spec})
    yield


def robot(place: Place, number: int = 0) -> Object:
    return {"nodeSelector": {"matchLabels": {Label.ROBOT.value: place.robots[number]}}}


def all_robots(place: Place) -> Object:
    return {
        "nodeSelector": {"matchExpressions": [{"key": Label.ROBOT.value, "operator": "In", "values": place.robots}]}
    }


def edge(budget: str | None = None, **fields: Any) -> list[Object]:
    latency = {"latency": {"budget": budget, **fields}} if budget else {}
    return [{"topic": "/t", "from": "talk", "to": "hear", **latency}]


# What is told

WELL = {"Ready": "True/AllComponentsReady", "Placed": "True/Placed", "Stalled": "False/NotStalled"}
NOWHERE = {"Ready": "False/Unschedulable", "Placed": "False/Unschedulable"}
NO_GRACE = {"grace": "1s"}
ON_BOARD = ({"name": "talk", "runsOn": ["Edge"]}, {"name": "hear", "runsOn": ["Robot"]})
BUS = {"devices": [{"name": "bus", "type": "can"}]}


def refused(reason: str = "InvalidSpec") -> dict[str, str]:
    return {"Accepted": f"False/{reason}", "Stalled": f"True/{reason}", "Ready": f"False/{reason}"}


def running(**fields: Any) -> Situation:
    return Situation(**{"says": WELL, "phase": "Running", **fields})


def wrong(reason: str = "InvalidSpec", phase: str = "Failed", **fields: Any) -> Situation:
    return Situation(says=refused(reason), phase=phase, **fields)


def with_domain(text: str) -> dict[str, str]:
    return {"Allocated": f"False/{text}", "Ready": f"False/{text}"}
