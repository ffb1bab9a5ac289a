"""What can become of an app: each situation is an app, what happens around it, and what must be on the screen in the end."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from typing import Any

from tests.support.world import APIS, Object, World, plain_app

from robotapp_api.model.names import Label
from robotapp_testbed.components import SIMULATED_BY_KWOK
from robotapp_testbed.network import Topology
from robotapp_testbed.topology import Device, fleet

SEEN_S = 60.0
CAN = Device("can0", "can", interface="can0")
Before = Callable[["Place"], AbstractContextManager[object]]


@dataclass(frozen=True, slots=True)
class Place:
    """The world, and the names of its nodes and pools. `mark` makes them this world's own."""

    world: World
    mark: str

    @property
    def robots(self) -> list[str]:
        return [f"amr-{self.mark}-{number}" for number in (1, 2, 3)]

    @property
    def edges(self) -> list[str]:
        return [f"edge-{self.mark}-{number}" for number in (1, 2)]

    def pool(self, name: str) -> str:
        return f"{name}-{self.mark}"

    def patch_node(self, name: str, change: Mapping[str, Any], *, status: bool = False) -> None:
        self.world.cp.api.patch(f"/api/v1/nodes/{name}{'/status' if status else ''}", change)


@dataclass(frozen=True, slots=True)
class Situation:
    """`spec` fills in the app. `around` holds while the app is there and begins before it; `then` happens once it is Ready.

    `says`: condition -> `Status/Reason`.
    """

    says: Mapping[str, str]
    phase: str
    parts: Sequence[Object] = ({"name": "talk"}, {"name": "hear"})
    spec: Callable[[Place], Object] = field(default=lambda _: {})
    around: Before = nullcontext
    then: Before | None = None


def nodes(mark: str) -> Topology:
    place = Place(world=None, mark=mark)  # type: ignore[arg-type] - for its names alone
    return fleet(robots=place.robots, edges=place.edges, clouds=[f"cloud-{mark}-1"], devices={place.robots[0]: [CAN]})


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


# Around an app


@contextmanager
def other_app(place: Place, *, parts: Sequence[Object] = ({"name": "x"},), **spec: Any) -> Iterator[None]:
    """Another app that is Ready before this one comes."""
    other = Situation(says={}, phase="", parts=parts, spec=lambda _: spec)
    place.world.create(app_of(other, place, "other"))
    place.world.watch.until_ready("other", within_s=SEEN_S)
    yield


@contextmanager
def broken(place: Place, *names: str) -> Iterator[None]:
    """Nodes whose kubelet is silent: kwok no longer plays it, and their pods no longer count as ready, as the node controller has it."""
    for name in names:
        place.patch_node(name, {"metadata": {"labels": {Label.SIMULATED.value: None}}})
        _set_ready(place, name, "Unknown")
    for pod in place.world.pods():
        if pod["spec"].get("nodeName") in names:
            lost = [{"type": kind, "status": "False"} for kind in ("Ready", "ContainersReady")]
            path = f"/api/v1/namespaces/{place.world.namespace}/pods/{pod['metadata']['name']}/status"
            place.world.cp.api.patch(path, {"status": {"conditions": lost}})
    try:
        yield
    finally:
        for name in names:
            place.patch_node(name, {"metadata": {"labels": {Label.SIMULATED.value: SIMULATED_BY_KWOK}}})
            _set_ready(place, name, "True")


def _set_ready(place: Place, name: str, status: str) -> None:
    ready = {"type": "Ready", "status": status, "reason": "Test", "message": "", "lastTransitionTime": None}
    place.patch_node(name, {"status": {"conditions": [ready]}}, status=True)


@contextmanager
def labelled(place: Place, node: str, **labels: str | None) -> Iterator[None]:
    """`labels` by the last part of their robotics.io name; None takes one away."""
    stored = place.world.cp.api.get(f"/api/v1/nodes/{node}")["metadata"]["labels"]
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
    before = place.world.nodes.rtt_ms(one, other)
    place.world.telemetry.set_rtt(one, other, ms)
    place.world.telemetry.write()
    try:
        yield
    finally:
        place.world.telemetry.set_rtt(one, other, before)


@contextmanager
def pool_of(place: Place, name: str, **spec: Any) -> Iterator[None]:
    body = {"apiVersion": "robotics.io/v1alpha1", "kind": "DomainPool", "metadata": {"name": place.pool(name)}}
    place.world.cp.api.create(
        f"{APIS}/domainpools", {**body, "spec": {"scope": "Cluster", "quarantineSeconds": 1, **spec}}
    )
    try:
        yield
    finally:
        place.world.cp.api.delete(f"{APIS}/domainpools/{place.pool(name)}")


@contextmanager
def edited(place: Place, **spec: Any) -> Iterator[None]:
    place.world.cp.api.patch(f"{place.world.apps_path}/app", {"spec": spec})
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


# The situations

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


def _with_domain(text: str) -> dict[str, str]:
    return {"Allocated": f"False/{text}", "Ready": f"False/{text}"}


SITUATIONS: Mapping[str, Situation] = {
    "a plain app": running(),
    "one component": running(parts=({"name": "only"},)),
    "two replicas": running(parts=({"name": "talk", "replicas": 2}, {"name": "hear"})),
    "a ROS 1 app": running(spec=lambda _: {"ros": {"distro": "noetic"}}),
    "suspended from the start": Situation(
        says={"Ready": "False/Suspended", "Placed": "Unknown/Suspended"},
        phase="Suspended",
        spec=lambda _: {"suspend": True},
    ),
    "suspended while it runs": Situation(
        says={"Ready": "False/Suspended"}, phase="Suspended", then=lambda place: edited(place, suspend=True)
    ),
    "an unknown distribution": wrong("UnknownDistro", spec=lambda _: {"ros": {"distro": "humbel"}}),
    "an unknown distribution with a budget": wrong(
        "UnknownDistro", spec=lambda _: {"ros": {"distro": "humbel"}, "edges": edge("30ms")}
    ),
    "another ROS version than the distribution's": wrong(spec=lambda _: {"ros": {"distro": "humble", "version": 1}}),
    "a variable the operator sets": wrong(
        parts=({"name": "talk", "env": [{"name": "RMW_IMPLEMENTATION", "value": "x"}]}, {"name": "hear"})
    ),
    "no robot matches": wrong(
        "NoMatchingRobot",
        "Pending",
        spec=lambda _: {"robots": {"nodeSelector": {"matchLabels": {Label.ROBOT.value: "nobody"}}}},
    ),
    "a master node that is not there": wrong(
        "InvalidSpec", "Pending", spec=lambda _: {"placement": {"masterNode": "ghost"}}
    ),
    "valid, then invalid": wrong(then=lambda place: edited(place, ros={"distro": "humble", "version": 1})),
    "three robots": running(spec=lambda place: {"robots": all_robots(place)}),
    "one robot": running(spec=lambda place: {"robots": robot(place)}, parts=ON_BOARD),
    "on an edge server": running(parts=({"name": "talk", "runsOn": ["Edge"]}, {"name": "hear"})),
    "in the cloud, else on an edge server": running(parts=({"name": "talk", "runsOn": ["Cloud", "Edge"]},)),
    "an edge server is wanted, all are cordoned, so on board": running(
        says=WELL | {"Placed": "True/FallbackUsed"},
        parts=({"name": "talk", "runsOn": ["Edge", "Robot"]},),
        spec=lambda place: {"robots": robot(place)},
        around=lambda place: cordoned(place, *place.edges),
    ),
    "only on edge servers, all are cordoned": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=({"name": "talk", "runsOn": ["Edge"]},),
        around=lambda place: cordoned(place, *place.edges),
    ),
    "a budget that is met": running(
        says=WELL | {"BudgetMet": "True/WithinBudget"},
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "edges": edge("90ms")},
    ),
    "a budget of the median": running(
        says=WELL | {"BudgetMet": "True/WithinBudget"},
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "edges": edge("90ms", percentile=50)},
    ),
    "an edge without a budget": running(says=WELL | {"BudgetMet": "True/NoBudget"}, spec=lambda _: {"edges": edge()}),
    "a budget no place can meet": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=({"name": "talk", "runsOn": ["Cloud"]}, {"name": "hear", "runsOn": ["Robot"]}),
        spec=lambda place: {"robots": robot(place), "edges": edge("5ms")},
    ),
    "a preferred budget that no place meets, given up after a second": running(
        says=WELL | {"Placed": "True/FallbackUsed", "BudgetMet": "False/BudgetExceeded"},
        parts=ON_BOARD,
        spec=lambda place: {
            "robots": robot(place),
            "edges": edge("1ms", enforce="Preferred"),
            "placement": {"fallback": {"after": "1s"}},
        },
    ),
    "a link that became too slow": running(
        says=WELL | {"BudgetMet": "False/BudgetExceeded"},
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "edges": edge("40ms")},
        around=lambda place: cordoned(place, place.edges[1]),
        then=lambda place: rtt(place, place.edges[0], place.robots[0], 80.0),
    ),
    "a device": running(parts=({"name": "talk", **BUS},)),
    "a device somebody else holds": Situation(
        says={"Allocated": "False/DeviceBusy", "Placed": "False/Unschedulable"},
        phase="Placing",
        parts=({"name": "talk", **BUS},),
        around=lambda place: other_app(place, parts=({"name": "x", **BUS},)),
    ),
    "a device no node has": Situation(
        says=NOWHERE | {"Allocated": "False/WaitingForDevices"},
        phase="Placing",
        parts=({"name": "talk", "devices": [{"name": "eye", "type": "usb", "model": "nobody-makes-it"}]},),
    ),
    "a device that is shared": running(
        parts=({"name": "talk", "devices": [{"name": "bus", "type": "can", "sharing": "Cluster"}]},)
    ),
    "more processors than any node has": Situation(
        says=NOWHERE, phase="Placing", parts=({"name": "talk", "resources": {"requests": {"cpu": "5000"}}},)
    ),
    "a node selector nothing fits": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=({"name": "talk", "template": {"spec": {"nodeSelector": {"nobody": "has"}}}},),
    ),
    "parameters in the app": running(
        parts=(
            {"name": "talk", "args": ["run"], "parameters": [{"inline": "talk:\n  ros__parameters:\n    speed: 1\n"}]},
        )
    ),
    "a domain of its own choice": running(spec=lambda _: {"ros2": {"domain": 17}}),
    "a domain another app has": Situation(
        says=_with_domain("DomainTaken"),
        phase="Pending",
        spec=lambda _: {"ros2": {"domain": 18}},
        around=lambda place: other_app(place, ros2={"domain": 18}),
    ),
    "a pool that is not there": Situation(
        says=_with_domain("PoolNotFound"), phase="Pending", spec=lambda _: {"ros2": {"pool": "nowhere"}}
    ),
    "a pool that is full": Situation(
        says=_with_domain("DomainExhausted"),
        phase="Pending",
        spec=lambda place: {"ros2": {"pool": place.pool("one")}},
        around=lambda place: other_app(place, ros2={"pool": place.pool("one")}),
    ),
    "a pool with a quota of nothing": Situation(
        says=_with_domain("QuotaExceeded"),
        phase="Pending",
        spec=lambda place: {"ros2": {"pool": place.pool("quota")}},
        around=lambda place: pool_of(place, "quota", ids="60-69", quota={"default": 0}),
    ),
    "a domain shared with another app": running(
        spec=lambda place: {"ros2": {"shareWith": [{"namespace": place.world.namespace, "name": "other"}]}},
        around=other_app,
    ),
    "a domain of an app that is not there": Situation(
        says={"Ready": "False/*", "Allocated": "*/*"},
        phase="Pending",
        spec=lambda place: {"ros2": {"shareWith": [{"namespace": place.world.namespace, "name": "nobody"}]}},
    ),
    "together on one node": running(parts=({"name": "talk", "colocateWith": ["hear"]}, {"name": "hear"})),
    "never on one node": running(parts=({"name": "talk", "separateFrom": ["hear"]}, {"name": "hear"})),
    "fields that do nothing yet": running(spec=lambda _: {"ros2": {"transport": "SHM"}}),
    "a robot out of reach": Situation(
        says={"Ready": "False/RobotOffline"},
        phase="Offline",
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "connectivity": NO_GRACE},
        then=lambda place: broken(place, place.robots[0]),
    ),
    "a robot out of reach for a moment": Situation(
        says={"Ready": "False/RobotNotReady"},
        phase="Degraded",
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place)},
        then=lambda place: broken(place, place.robots[0]),
    ),
    "one of three robots out of reach": Situation(
        says={"Ready": "False/RobotOffline"},
        phase="Degraded",
        parts=ON_BOARD,
        spec=lambda place: {"robots": all_robots(place), "connectivity": NO_GRACE},
        then=lambda place: broken(place, place.robots[0]),
    ),
    "a robot with two computers and none of them primary": Situation(
        says={"Accepted": "True/Accepted", "Ready": "False/RobotNodeUnclear"},
        phase="Pending",
        spec=lambda place: {"robots": robot(place)},
        around=lambda place: labelled(place, place.edges[1], robot=place.robots[0]),
    ),
    "an update that fits nowhere": Situation(
        says={"Ready": "False/*", "Placed": "False/Unschedulable"},
        phase="Placing",
        then=lambda place: edited(
            place, components=[{"name": "talk", "image": "y", "resources": {"requests": {"cpu": "5000"}}}]
        ),
    ),
}
