"""The judges of the truth test find what is false: each sentence here contradicts the world beside it."""

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from campaigns.truth.explained import false_explanation
from campaigns.truth.history import History
from campaigns.truth.screen import Screen
from campaigns.truth.told import false_events

ROBOT = {"robotics.io/robot": "amr", "robotics.io/tier": "robot"}
EDGE = {"topic": "/t", "from": "talk", "to": "hear", "kind": "Topic", "latency": {"budget": "40ms"}}


def node(name: str, **labels: str) -> dict[str, Any]:
    ready = [{"type": "Ready", "status": "True"}]
    meta = {"name": name, "labels": {key.replace("__", "/"): value for key, value in labels.items()}, "annotations": {}}
    status = {"conditions": ready, "allocatable": {"cpu": "4", "memory": "8Gi"}}
    return {"metadata": meta, "spec": {}, "status": status}


def pod(component: str, where: str) -> dict[str, Any]:
    labels = {"robotics.io/component": component, "robotics.io/instance": "amr"}
    return {
        "metadata": {"name": f"{component}-1", "uid": f"u-{component}", "labels": labels},
        "spec": {"nodeName": where, "containers": [{}], "nodeSelector": {}},
        "status": {"phase": "Running"},
    }


def report(name: str, devices: tuple[dict[str, Any], ...] = (), **rtt_ms: float) -> dict[str, Any]:
    rtt = [{"peer": peer, "p50Us": 1000 * ms, "p95Us": 1000 * ms} for peer, ms in rtt_ms.items()]
    return {"metadata": {"name": name}, "status": {"rtt": rtt, "devices": list(devices)}}


NODES = [node("amr", **{key.replace("/", "__"): value for key, value in ROBOT.items()}), node("edge"), node("cloud")]
PODS = [pod("talk", "edge"), pod("hear", "amr")]
CAMERA = {"id": "cam", "type": "usb", "present": False}
REPORTS = [report("edge", (CAMERA,), amr=5, cloud=60), report("cloud", amr=60)]
HOLDER = {"namespace": "n", "name": "app", "instance": "amr"}
CLAIMS = [{"spec": {"holder": HOLDER, "device": {"id": "cam", "node": "edge"}}}]


class StillSite:
    """As it is in these tests."""

    class cp:  # noqa: N801 - an attribute of a StillSite
        class api:  # noqa: N801
            @staticmethod
            def get(path: str) -> dict[str, Any]:
                found = {"robotclaims": CLAIMS, "nodes": NODES, "nodetelemetries": REPORTS}
                return {"items": found[path.rpartition("/")[2]]}

    @staticmethod
    def pods() -> list[dict[str, Any]]:
        return PODS


@pytest.fixture
def history() -> History:
    found = History(StillSite())  # type: ignore[arg-type]
    found.look()
    return found


def row(component: str, where: str, *reasons: str, **fields: Any) -> dict[str, Any]:
    empty = {"runnerUp": "", "scores": {where: 1}, "devices": [], "tier": "", "planned": "", "recorded": True}
    return {"component": component, "pod": f"{component}-1", "node": where, "reasons": list(reasons), **empty, **fields}


def screen(*, reasons: tuple[str, ...] = (), edge: dict[str, Any] | None = None, **fields: Any) -> Screen:
    explained_edges = [edge] if edge else []
    rows = [row("talk", "edge", *reasons), row("hear", "amr")]
    given = {
        "app": {
            "metadata": {"namespace": "n", "name": "app", "generation": 1},
            "spec": {"components": [{"name": "talk"}, {"name": "hear"}], "edges": [EDGE]},
        },
        "instances": [{"spec": {"robot": "amr"}}],
        "deployments": [],
        "pods": PODS,
        "claims": CLAIMS,
        "nodes": {each["metadata"]["name"]: each for each in NODES},
        "telemetry": {each["metadata"]["name"]: each for each in REPORTS},
        "events": [],
        "row": {},
        "info": "",
        "explanation": "edge amr",
        "explained": {"note": "", "instances": [{"robot": "amr", "components": rows, "edges": explained_edges}]},
        "status": {"conditions": []},
    }
    return Screen(**{**given, **fields})  # type: ignore[arg-type]


def event(reason: str, note: str, *, ago: timedelta = timedelta()) -> dict[str, Any]:
    return {"reason": reason, "note": note, "eventTime": (datetime.now(UTC) - ago).isoformat()}


TRUE_EVENTS = [
    ("DeviceClaimed", "domain 7; 1 of 1 device reserved"),
    ("Placed", "2 of 2 components on amr, edge"),
    ("DeviceLost", "talk: device cam on edge is gone: plug it in again; onLoss decides what happens to the pod"),
    ("BudgetExceeded", "1 of 1 edge is over budget, worst /t talk -> hear 5ms of 40ms; move a component closer"),
    ("NodeRejected", "0 of 2 placed; talk: 0/3 nodes are available: 2 Insufficient cpu, 1 node(s) were unschedulable."),
]
FALSE_EVENTS = [
    ("Placed", "2 of 2 components on amr, cloud"),
    ("DeviceLost", "talk: device cam on amr is gone: plug it in again"),
    (
        "DeviceLost",
        "talk: device cam on edge is gone: plug it in again (hear would have 2ms on edge, but it is closed)",
    ),
    ("DeviceReturned", "device cam on edge is back: domain 7; 1 of 1 device"),
    ("DeviceBusy", "device cam on edge is held by n/other: it is free when its holder is deleted or suspended"),
    ("BudgetExceeded", "1 of 1 edge is over budget, worst /t talk -> hear 9ms of 40ms; move a component closer"),
    ("BudgetExceeded", "1 of 1 edge is over budget, worst /t talk -> hear 5ms of 30ms; move a component closer"),
    ("NodeRejected", "0 of 2 placed; talk: 0/2 nodes are available: 2 Insufficient cpu."),
    ("NodeRejected", "0 of 2 placed; talk: 0/3 nodes are available: 2 Insufficient cpu."),
    ("Rescheduled", "talk moved from cloud to edge: device cam on cloud is lost"),
    ("RobotOffline", "node amr of the robot is not Ready: kubectl describe node amr shows why"),
    ("DomainAllocated", "domain 7"),
    ("DeviceClaimed", "domain 7; 2 of 2 devices reserved"),
    ("DeviceClaimed", "domain 7; 0 of 1 device reserved"),
    ("Invented", "something"),
]


@pytest.mark.parametrize(("reason", "note"), TRUE_EVENTS)
def test_a_true_event_passes(history: History, reason: str, note: str) -> None:
    assert list(false_events(screen(events=[event(reason, note)]), history)) == []


@pytest.mark.parametrize(("reason", "note"), FALSE_EVENTS)
def test_a_false_event_is_found(history: History, reason: str, note: str) -> None:
    assert list(false_events(screen(events=[event(reason, note)]), history))


def test_what_became_so_later_was_not_so_when_it_was_told(history: History) -> None:
    early = event("Placed", "2 of 2 components on amr, edge", ago=timedelta(minutes=1))
    assert list(false_events(screen(events=[early]), history))


@pytest.mark.parametrize(
    ("line", "true"),
    [
        ("cloud: 60.0 ms to amr > 40 ms", True),
        ("cloud: 61.0 ms to amr > 40 ms", False),
        ("cloud: about 60.0 ms to amr > 40 ms", False),
        ("cloud: 60.0 ms to edge > 40 ms", False),
        ("cloud: 60.0 ms to amr > 30 ms", False),
        ("cloud: 60.0 ms, exceeded the latency budget", False),
        ("cloud: Insufficient cpu, 40 free", False),
        ("cloud: were unschedulable", False),
        ("cloud: had no free device for the pod", True),
        ("cloud: didn't match Pod's node affinity/selector", False),
        ("cloud: felt wrong", False),
        ("edge: 60.0 ms to amr > 40 ms", False),
    ],
)
def test_a_false_reason_of_a_refused_node_is_found(history: History, line: str, *, true: bool) -> None:
    assert (list(false_explanation(screen(reasons=(line,)), history)) == []) == true


@pytest.mark.parametrize(
    ("fields", "true"),
    [
        ({"measured": True, "p95": "5ms", "met": True}, True),
        ({"measured": True, "p95": "7ms", "met": True}, False),
        ({"measured": True, "p95": "5ms", "newest": "9 ms"}, False),
        ({"measured": False, "p95": "5ms", "estimated": True}, False),
        ({"measured": False}, False),
        ({"measured": True, "p95": "5ms", "budget": "50ms"}, False),
        ({"measured": True, "p95": "5ms", "nodes": ["cloud", "amr"]}, False),
    ],
)
def test_a_false_edge_is_found(history: History, fields: dict[str, Any], *, true: bool) -> None:
    edge = {"kind": "Topic", "topic": "/t", "from": "talk", "to": "hear", "budget": "40ms", "percentile": 95}
    shown = screen(edge={**edge, "nodes": ["edge", "amr"], **fields})
    assert (list(false_explanation(shown, history)) == []) == true


def test_a_plan_that_was_worse_than_another_is_found(history: History) -> None:
    planned = "planned together with its group; no plan was better"
    near, far = (
        {"scores": {"edge": 1, "cloud": 1}, "planned": planned},
        {"scores": {"cloud": 1, "edge": 1}, "planned": planned},
    )
    hear = row("hear", "amr", planned=planned)

    def told(talk: dict[str, Any], where: str) -> list[str]:
        pods = [pod("talk", where), pod("hear", "amr")]
        view = {"robot": "amr", "components": [talk, hear], "edges": []}
        return list(
            false_explanation(
                screen(pods=pods, explained={"note": "", "instances": [view]}, explanation="edge cloud amr"), history
            )
        )

    assert told(row("talk", "edge", **near), "edge") == []
    assert [text for text in told(row("talk", "cloud", **far), "cloud") if "no plan was better" in text]
