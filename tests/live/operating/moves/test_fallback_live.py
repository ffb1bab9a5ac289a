"""An app whose wishes cannot be met waits, runs with what it gave up, and its user sees that, with our operator and scheduler."""

import secrets
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import pytest

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_api.model.names import Annotation, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology

ROBOT = "amr-1"
EDGES = ("edge-1", "edge-2")
ON_ROBOT = {"nodeSelector": {"matchLabels": {Label.ROBOT.value: ROBOT}}}
WISH = {"topic": "/image", "from": "planner", "to": "driver", "latency": {"budget": "30ms", "enforce": "Preferred"}}
AFTER_S = 4


@pytest.fixture(scope="module")
def network(installed_plane: ControlPlane) -> Iterator[topology.SimulatedTelemetry]:
    """A robot, two edge servers that are too far from it, an operator and a scheduler."""
    nodes = topology.fleet([ROBOT], list(EDGES), 0)
    topology.apply(installed_plane, nodes)
    scheduler = product.start_scheduler(installed_plane, sweep_seconds=1)
    operator = product.start_operator(
        installed_plane, name=f"operator-{secrets.token_hex(2)}", sweep_seconds=1, no_leader_election=True
    )
    with topology.SimulatedTelemetry(installed_plane, nodes, interval_s=2) as telemetry:
        for name, rtt_ms in zip(EDGES, (42.0, 60.0), strict=True):
            telemetry.set_rtt(name, ROBOT, rtt_ms)
        yield telemetry
    operator.stop()
    scheduler.stop()
    topology.remove(installed_plane, nodes)


@pytest.fixture
def user(installed_plane: ControlPlane, namespace: str) -> Tenant:
    return Tenant(installed_plane, namespace)


def pod_of(user: Tenant, component: str) -> dict[str, Any]:
    """The newest pod of a component that is not ending, {} without one."""
    pods = [
        pod
        for pod in user.listed("pods")
        if pod["metadata"]["labels"].get(Label.COMPONENT.value) == component
        and "deletionTimestamp" not in pod["metadata"]
    ]
    return pods[-1] if pods else {}


def scheduled(pod: dict[str, Any]) -> dict[str, Any]:
    found = [each for each in pod.get("status", {}).get("conditions", ()) if each["type"] == "PodScheduled"]
    return found[0] if found else {}


def seconds_waited(pod: dict[str, Any]) -> float:
    """From its creation until it was bound."""
    times = (pod["metadata"]["creationTimestamp"], scheduled(pod)["lastTransitionTime"])
    made, bound = map(datetime.fromisoformat, times)
    return (bound - made).total_seconds()


@pytest.mark.usefixtures("network")
def test_an_app_waits_for_its_preferred_budget_and_then_runs_without_it_and_tells_the_numbers(user: Tenant) -> None:
    parts = [part("planner", runsOn=["Edge"]), part("driver", runsOn=["Robot"])]
    fallback = {"steps": ["RelaxPreferred", "Wait"], "after": f"{AFTER_S}s"}
    user.apply("wishes", *parts, robots=ON_ROBOT, edges=[WISH], placement={"fallback": fallback})
    eventually(
        lambda: (
            "/image to driver prefers 30ms, best is 42ms (measured) on edge-1"
            in scheduled(pod_of(user, "planner")).get("message", "")
        ),
        what=lambda: user.listed("pods"),
    )
    placed = user.wait("wishes", "Placed", "True", reason="FallbackUsed")
    planner = pod_of(user, "planner")
    assert seconds_waited(planner) >= AFTER_S
    node = planner["spec"]["nodeName"]
    time = "42ms" if node == "edge-1" else "60ms"
    assert (
        f"given up: {ROBOT}: /image between planner and driver takes {time} (measured, {node} to {ROBOT}) instead of 30ms"
        in placed["message"]
    )
    assert Annotation.FALLBACK.value in planner["metadata"]["annotations"]
    eventually(lambda: "FallbackUsed" in user.event_reasons("wishes"), what=lambda: user.event_reasons("wishes"))
    assert "placement" not in user.condition("wishes", "Accepted")["message"]


@pytest.mark.usefixtures("network")
def test_an_app_that_would_rather_wait_is_placed_when_its_budget_can_be_met(
    user: Tenant, network: topology.SimulatedTelemetry
) -> None:
    parts = [part("planner", runsOn=["Edge"]), part("driver", runsOn=["Robot"])]
    waits = {"steps": ["Wait"], "after": "1s"}
    user.apply("patient", *parts, robots=ON_ROBOT, edges=[WISH], placement={"fallback": waits})
    placed = user.wait("patient", "Placed", "False", reason="Unschedulable")
    assert "best is 42ms (measured) on edge-1; the pod waits until that is met" in placed["message"]
    network.set_rtt("edge-2", ROBOT, 8.0)
    try:
        user.wait("patient", "Placed", "True", reason="Placed")
        assert pod_of(user, "planner")["spec"]["nodeName"] == "edge-2"
    finally:
        network.set_rtt("edge-2", ROBOT, 60.0)


@pytest.mark.usefixtures("network")
def test_edge_then_robot_goes_on_board_while_the_edge_is_cordoned_and_that_is_told(
    user: Tenant, installed_plane: ControlPlane
) -> None:
    def cordon(value: bool) -> None:
        for name in EDGES:
            installed_plane.api.patch(f"/api/v1/nodes/{name}", {"spec": {"unschedulable": value}})

    cordon(True)
    try:
        user.apply("falls", part("planner", runsOn=["Edge", "Robot"]), robots=ON_ROBOT)
        placed = user.wait("falls", "Placed", "True", reason="FallbackUsed")
        assert pod_of(user, "planner")["spec"]["nodeName"] == ROBOT
        assert "given up: amr-1: planner runs on tier Robot instead of Edge" in placed["message"]
        eventually(lambda: "FallbackUsed" in user.event_reasons("falls"), what=lambda: user.event_reasons("falls"))
    finally:
        cordon(False)
    user.cp.kubectl("delete", "pod", pod_of(user, "planner")["metadata"]["name"], "-n", user.namespace, "--wait=false")
    user.wait("falls", "Placed", "True", reason="Placed")
    assert pod_of(user, "planner")["spec"]["nodeName"] in EDGES
