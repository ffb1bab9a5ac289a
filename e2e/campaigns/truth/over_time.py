"""What happens to an app that runs: devices, links, nodes and robots that go and come back, moves, and what was asked before."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from campaigns.rigs.simulated_site import APIS, Object
from campaigns.truth.arranging import (
    CAMERA,
    NO_GRACE,
    NOWHERE,
    ON_BOARD,
    WELL,
    Place,
    Situation,
    all_robots,
    broken,
    cordoned,
    edge,
    edited,
    labelled,
    other_app,
    robot,
    rtt,
    running,
    until,
)
from campaigns.truth.screen import Screen, spoken
from robotapp_api.model.names import Annotation, Label
from robotapp_testbed.machines import topology

NEAR_MS: Final = 2.0


def seeing(on_loss: str) -> tuple[Object]:
    """A component on an edge server with a camera."""
    return ({"name": "talk", "runsOn": ["Edge"], "devices": [{"name": "cam", "type": "video", "onLoss": on_loss}]},)


def moving(**limits: Any) -> Callable[[Place], Object]:
    """An app of a robot and an edge server within 40 ms of it, with these limits of moves."""
    reschedule = {"when": "BudgetExceeded", "for": "1s", **limits}
    return lambda place: {
        "robots": robot(place),
        "edges": edge("40ms"),
        "placement": {"reschedule": reschedule},
    }


# What happens


def node_of(place: Place, component: str) -> str:
    """Where its only pod is that is not ending, "" while there is none."""
    for pod in place.site.pods():
        meta = pod["metadata"]
        if meta["labels"].get(Label.COMPONENT.value) == component and "deletionTimestamp" not in meta:
            return str(pod["spec"].get("nodeName", ""))
    return ""


def the_other(place: Place, node: str) -> str:
    return next(name for name in place.edges if name != node)


def told(place: Place, reason: str) -> None:
    until(f"event {reason}", lambda: reason in {each["reason"] for each in place.site.events("app")})


@contextmanager
def unplugged(place: Place) -> Iterator[None]:
    node = node_of(place, "talk")
    place.site.telemetry.unplug(node, CAMERA.id)
    try:
        yield
    finally:
        place.site.telemetry.plug(node, CAMERA.id)


@contextmanager
def unplugged_for_a_while(place: Place) -> Iterator[None]:
    with unplugged(place):
        told(place, "DeviceLost")
    yield


@contextmanager
def unplugged_until_it_counts(place: Place) -> Iterator[None]:
    """For ten seconds, so that the loss is recorded and the pod restarts afterwards."""
    first = {pod["metadata"]["uid"] for pod in place.site.pods()}
    with unplugged(place):
        recorded = Annotation.LOST_DEVICES.value
        until(
            "the loss is recorded", lambda: any(recorded in each["metadata"]["annotations"] for each in _wanted(place))
        )
    until("the pod restarts", lambda: not first & {pod["metadata"]["uid"] for pod in place.site.pods()})
    yield


@contextmanager
def unplugged_then_suspended(place: Place) -> Iterator[None]:
    with unplugged(place):
        told(place, "DeviceLost")
        with edited(place, suspend=True):
            yield


@contextmanager
def slowed(place: Place) -> Iterator[None]:
    """The link of the node where it is gets slow; the other edge server is near."""
    here = node_of(place, "talk")
    with rtt(place, the_other(place, here), place.robots[0], NEAR_MS), rtt(place, here, place.robots[0], 80.0):
        yield


@contextmanager
def slowed_twice(place: Place) -> Iterator[None]:
    """It moves, and then its new place gets slow, while the old one is near again."""
    here = node_of(place, "talk")
    there = the_other(place, here)
    with slowed(place):
        told(place, "Rescheduled")
        with rtt(place, here, place.robots[0], NEAR_MS), rtt(place, there, place.robots[0], 80.0):
            yield


@contextmanager
def node_lost(place: Place) -> Iterator[None]:
    with broken(place, node_of(place, "talk")):
        yield


@contextmanager
def linked(place: Place, bandwidth: str, *names: str) -> Iterator[None]:
    for name in names:
        place.patch_node(name, {"metadata": {"annotations": {Annotation.LINK_BANDWIDTH.value: bandwidth}}})
    try:
        yield
    finally:
        for name in names:
            place.patch_node(name, {"metadata": {"annotations": {Annotation.LINK_BANDWIDTH.value: None}}})


@contextmanager
def robot_gone(place: Place) -> Iterator[None]:
    """A robot's node is deleted, and the pods there with it, as the control plane's garbage collector has it."""
    gone, site = place.robots[0], place.site
    site.cp.api.delete(f"/api/v1/nodes/{gone}")
    claim = next(each for each in site.claims() if each["spec"]["holder"]["instance"] == gone)
    place.seen["claim"] = claim["metadata"]["name"]
    path = f"/api/v1/namespaces/{site.namespace}/pods"
    try:
        until(
            "its instance ends",
            lambda: gone not in {pod["metadata"]["labels"][Label.INSTANCE] for pod in _wanted(place)},
        )
        for pod in site.pods():
            if pod["spec"].get("nodeName") == gone:
                site.cp.api.delete(f"{path}/{pod['metadata']['name']}?gracePeriodSeconds=0")
        yield
    finally:
        topology.apply(site.cp, [node for node in site.nodes if node.name == gone])
        site.telemetry.write()


def _wanted(place: Place) -> list[Object]:
    path = f"/apis/apps/v1/namespaces/{place.site.namespace}/deployments"
    found = place.site.cp.api.get(path)["items"]
    return [each for each in found if Label.INSTANCE.value in each["metadata"]["labels"]]


def parked(place: Place, _: Screen) -> Iterable[str]:
    """The claim of the robot that is gone is kept for it, and named so."""
    claim = place.site.cp.api.get(f"{APIS}/robotclaims/{place.seen['claim']}")
    phase, nodes = claim["status"].get("phase"), claim["status"].get("nodes")
    if (phase, nodes) != ("Parked", [place.robots[0]]):
        yield f"claim {place.seen['claim']} is {phase} for {nodes}"
    shown = spoken(place.site, "domains", everywhere=True)
    line = next((line for line in shown.splitlines() if place.site.namespace in line and place.robots[0] in line), "")
    if "arked" not in line:
        yield f"domains does not say that it is parked: {shown}"


# What was asked before


@contextmanager
def asked_and_lost(place: Place) -> Iterator[None]:
    """what-if about the loss of the node, and then that loss."""
    here = node_of(place, "talk")
    answer = spoken(place.site, "what-if", "--node-loss", here, "-o", "json", scheduler=True)
    place.seen["answer"] = json.loads(answer)
    with broken(place, here):
        until("it leaves the node", lambda: node_of(place, "talk") != here)
        yield


def as_predicted(place: Place, screen: Screen) -> Iterable[str]:
    """What what-if told of the loss is what came of it: places, pods that wait, verdicts of edges."""
    answer = place.seen["answer"]
    for each in answer["pods"]:
        if not each["component"]:
            continue  # discovery servers
        here = [pod for pod in screen.pods_of(each["component"]) if "deletionTimestamp" not in pod["metadata"]]
        now = [pod["spec"]["nodeName"] for pod in here if pod["spec"].get("nodeName")]
        wanted = {"Moves": [each["to"]], "Pending": [], "Stays": [each["from"]]}.get(each["outcome"])
        if now != wanted:
            yield f"what-if: {each['component']} {each['outcome']} to {each['to']}, but it is on {now}"
    told_of = {each["component"] for each in answer["pods"]}
    if "talk" not in told_of:
        yield f"what-if told of {told_of} alone"
    met = screen.condition("BudgetMet")[0]
    verdicts = {each["after"]["verdict"] if each["after"] else "gone" for each in answer["edges"]} or {"Met"}
    if verdicts != {{"True": "Met", "False": "Exceeded", "Unknown": "Unknown"}[met]}:
        yield f"what-if: {verdicts}, but BudgetMet is {met}"


def asked(budget: str) -> Callable[[Place], Object]:
    return lambda place: {"robots": robot(place), "edges": edge(budget), "connectivity": NO_GRACE}


FAILS_OVER: Final = (
    {"name": "talk", "runsOn": ["Edge"], "onDisconnect": "Failover"},
    {"name": "hear", "runsOn": ["Robot"]},
)
LOST: Final = {"Allocated": "False/DeviceLost", "Ready": "True/AllComponentsReady"}


def still_there(_: Place, screen: Screen) -> Iterable[str]:
    if not screen.nodes_of("talk"):
        yield "its pod is gone"


def jittery(place: Place) -> Any:
    """The median is within the budget and the 95th percentile is not."""
    return _jitter(place, place.edges[0], place.robots[0], p95_ms=70.0)


@contextmanager
def _jitter(place: Place, one: str, other: str, *, p95_ms: float) -> Iterator[None]:
    telemetry = place.site.telemetry
    telemetry.set_p95(one, other, p95_ms)
    try:
        with cordoned(place, place.edges[1]):
            yield
    finally:
        telemetry.set_p95(one, other, None)


@contextmanager
def held_elsewhere(place: Place) -> Iterator[None]:
    """Another app holds the other edge server's camera."""
    camera = {"devices": [{"name": "cam", "type": "video"}]}
    with (
        cordoned(place, place.edges[0]),
        other_app(place, parts=({"name": "x", "runsOn": ["Edge"], **camera},)),
    ):
        pass
    yield


OVER_TIME: Mapping[str, Situation] = {
    "a device that vanished": Situation(
        says=LOST,
        phase="Running",
        parts=seeing("Keep"),
        then=unplugged,
        events=["DeviceLost"],
        no_events=["DeviceReturned", "Rescheduled"],
    ),
    "a device that vanished and is back": running(
        says=WELL | {"Allocated": "True/Allocated"},
        parts=seeing("Keep"),
        then=unplugged_for_a_while,
        events=["DeviceLost", "DeviceReturned"],
        no_events=["Rescheduled"],
    ),
    "a device that vanished and is back, and the pod restarts": running(
        says=WELL | {"Allocated": "True/Allocated"},
        parts=seeing("Restart"),
        then=unplugged_until_it_counts,
        events=["DeviceLost", "DeviceReturned"],
        no_events=["Rescheduled"],
    ),
    "a device that vanished while another node has one": running(
        says=WELL | {"Allocated": "True/Allocated"},
        parts=seeing("Reschedule"),
        then=unplugged,
        events=["DeviceLost", "Rescheduled"],
        no_events=["DeviceReturned"],
    ),
    "a device that vanished while the other one is held": Situation(
        says=LOST,
        phase="Running",
        parts=seeing("Reschedule"),
        around=held_elsewhere,
        then=unplugged,
        tells=["is gone.*no other node has such a device that is free"],
        no_events=["DeviceReturned", "Rescheduled"],
    ),
    "a device that vanished before the app was suspended": Situation(
        says={"Ready": "False/Suspended"},
        phase="Suspended",
        parts=seeing("Keep"),
        then=unplugged_then_suspended,
        events=["DeviceLost"],
        no_events=["DeviceReturned"],
    ),
    "a component that moves to a better node": running(
        says=WELL | {"BudgetMet": "True/WithinBudget"},
        parts=ON_BOARD,
        spec=moving(cooldown="10m"),
        then=slowed,
        events=["Rescheduled"],
    ),
    "a component that would be better elsewhere and may not move": running(
        says=WELL | {"BudgetMet": "False/BudgetExceeded"},
        parts=ON_BOARD,
        spec=moving(when="Never"),
        then=slowed,
        tells=["talk would have 2ms on .*, but placement.reschedule.when is Never"],
        events=["BudgetExceeded"],
        no_events=["Rescheduled"],
    ),
    "a component that moved a moment ago": running(
        says=WELL | {"BudgetMet": "False/BudgetExceeded"},
        parts=ON_BOARD,
        spec=moving(cooldown="10m"),
        then=slowed_twice,
        tells=["placement.reschedule.cooldown, until"],
        events=["Rescheduled", "BudgetExceeded"],
    ),
    "a component that may not move on any day": running(
        says=WELL | {"BudgetMet": "False/BudgetExceeded"},
        parts=ON_BOARD,
        spec=moving(maxPerDay=0),
        then=slowed,
        tells=["placement.reschedule.maxPerDay is 0"],
        no_events=["Rescheduled"],
    ),
    "a budget of the median that the 95th percentile exceeds": running(
        says=WELL | {"BudgetMet": "True/WithinBudget"},
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place), "edges": edge("40ms", percentile=50)},
        around=jittery,
        also=lambda _, screen: [] if "median" in screen.explanation else [f"explain: {screen.explanation}"],
    ),
    "near one end and too far from another": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=({"name": "talk", "runsOn": ["Robot"]}, {"name": "hear"}, {"name": "far", "runsOn": ["Cloud"]}),
        spec=lambda place: {
            "robots": robot(place),
            "edges": [
                {"topic": "/t", "from": "talk", "to": "hear", "latency": {"budget": "20ms"}},
                {"topic": "/f", "from": "hear", "to": "far", "latency": {"budget": "50ms"}},
            ],
        },
    ),
    "more bandwidth than the links carry": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=ON_BOARD,
        spec=lambda place: {
            "robots": robot(place),
            "edges": [{"topic": "/t", "from": "talk", "to": "hear", "bandwidth": "40M"}],
        },
        around=lambda place: linked(place, "10M", *place.edges, place.robots[0]),
    ),
    "stopped because its node does not answer": Situation(
        says={"Ready": "False/*"},
        phase="Placing",
        parts=({"name": "talk", "runsOn": ["Edge"], "onDisconnect": "Stop"},),
        spec=lambda _: {"connectivity": NO_GRACE},
        then=node_lost,
        tells=[r"stopped, because node \S+ is not Ready \(onDisconnect: Stop\)"],
    ),
    "kept although its node does not answer": Situation(
        says={"Ready": "False/*"},
        phase="Degraded",
        parts=({"name": "talk", "runsOn": ["Edge"], "onDisconnect": "Keep"},),
        spec=lambda _: {"connectivity": NO_GRACE},
        then=node_lost,
        tells=[r"node \S+ is not Ready"],
        also=still_there,
    ),
    "started elsewhere because its node does not answer": running(
        parts=({"name": "talk", "runsOn": ["Edge"], "onDisconnect": "Failover"},),
        spec=lambda _: {"connectivity": NO_GRACE},
        then=node_lost,
    ),
    "a robot whose label was taken away": Situation(
        says={"Ready": "False/RobotOffline"},
        phase="Offline",
        parts=ON_BOARD,
        spec=lambda place: {"robots": robot(place)},
        then=lambda place: labelled(place, place.robots[0], robot=None),
        tells=["is out of sight: no node with the label"],
    ),
    "one of three robots is gone for longer than the grace": running(
        parts=({"name": "hear", "runsOn": ["Robot"]},),
        spec=lambda place: {"robots": all_robots(place), "connectivity": NO_GRACE},
        then=robot_gone,
        also=parked,
    ),
    "a node loss that was asked about, and another node is near": running(
        says=WELL | {"BudgetMet": "True/WithinBudget"},
        parts=FAILS_OVER,
        spec=asked("40ms"),
        then=asked_and_lost,
        also=as_predicted,
    ),
    "a node loss that was asked about, and no other node is near": Situation(
        says=NOWHERE,
        phase="Placing",
        parts=FAILS_OVER,
        spec=asked("10ms"),
        around=lambda place: rtt(place, place.edges[1], place.robots[0], 15.0),
        then=asked_and_lost,
        also=as_predicted,
    ),
    "a node loss that was asked about, and a preferred budget is exceeded elsewhere": running(
        says={"Ready": "True/AllComponentsReady", "BudgetMet": "False/BudgetExceeded"},
        parts=FAILS_OVER,
        spec=lambda place: {
            "robots": robot(place),
            "edges": edge("10ms", enforce="Preferred"),
            "connectivity": NO_GRACE,
            "placement": {"fallback": {"after": "1s"}},
        },
        around=lambda place: rtt(place, place.edges[1], place.robots[0], 15.0),
        then=asked_and_lost,
        also=as_predicted,
    ),
}
LONG: Final = frozenset({"a component that moved a moment ago"})
"""They take a minute, because a second verdict is published that much later: for `scripts/bench truth` alone."""
