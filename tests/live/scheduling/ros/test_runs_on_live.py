"""`runsOn` as an order on a real API server: the edge while it fits, on board at once when it does not, whatever scores."""

import json
from typing import Any

import pytest
from tests.support.apiobjects import component

from campaigns.rigs.ports import ask
from campaigns.rigs.stage import Json, Stage, deployment, nodes
from robotapp_api.model.names import API_VERSION, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge, robot
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live
# Every test has edge nodes of its own names: pods of the test before may still be counted on theirs.
ROBOT = "amr-1"
TELEMETRY = f"/apis/{API_VERSION}/nodetelemetries"


def allowed(*tiers: str) -> Json:
    """What the operator writes for `runsOn`: the nodes of these tiers, and of robots only the instance's own."""
    own = {"key": str(Label.ROBOT), "operator": "In", "values": [ROBOT]}
    terms = [
        [own] if tier == "Robot" else [{"key": str(Label.TIER), "operator": "In", "values": [tier.lower()]}]
        for tier in tiers
    ]
    required = {"nodeSelectorTerms": [{"matchExpressions": term} for term in terms]}
    robots = [{"key": str(Label.ROBOT), "operator": "Exists"}, {"key": str(Label.TIER), "operator": "Exists"}]
    return {
        "affinity": {"nodeAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": required}},
        "tolerations": robots,
    }


def start(stage: Stage, name: str, runs_on: tuple[str, ...], *, cpu: str = "1", **spec: Any) -> str:
    """An app of one component; the node its pod is bound to."""
    mine = {"nodeSelector": {"matchLabels": {str(Label.ROBOT): ROBOT}}}
    app = stage.create_app(name, [component("planner", runsOn=list(runs_on))], robots=mine, **spec)
    box = {"name": "main", "image": "registry.invalid/main:1", "resources": {"requests": {"cpu": cpu}}}
    stage.create_deployment(deployment(app, "planner", instance=ROBOT, containers=[box], **allowed(*runs_on)))
    return stage.wait_bound(pod_of(stage, name))


def pod_of(stage: Stage, app: str) -> str:
    pods = stage.wait(lambda: stage.pods(**{str(Label.APP): app}), what=lambda: f"{app} has no pod")
    return str(pods[0]["metadata"]["name"])


def explained(stage: Stage, app: str, scheduler: Process) -> Json:
    status, text = ask(f"{scheduler.health_url}/explain/{stage.namespace}/{pod_of(stage, app)}")
    assert status == 200, text
    found: Json = json.loads(text)
    return found


def test_edge_then_robot_goes_to_the_edge_while_it_fits_and_on_board_at_once_when_it_is_full(
    installed_plane: ControlPlane, stage: Stage, scheduler: Process
) -> None:
    """The robot is empty and much larger, so every score speaks for it."""
    edges = (edge("two", cpu="2"), edge("one", cpu="1"))
    with nodes(installed_plane, robot(ROBOT, cpu="64", memory="128Gi"), *edges):
        stage.wait_known("two", "one")
        where = [start(stage, f"app-{number}", ("Edge", "Robot"), cpu="900m") for number in range(4)]
        assert (sorted(where[:3]), where[3]) == (["one", "two", "two"], ROBOT)
        assert explained(stage, "app-0", scheduler)["tier"] == (
            "tier Edge comes first in runsOn; 1 feasible node(s) of later tiers were left out"
        )
        fallen_back = explained(stage, "app-3", scheduler)
        assert fallen_back["tier"] == "no node of tier Edge was feasible: tier Robot is next in runsOn"
        assert ("NodeResourcesFit", 2) in {(each["plugin"], each["nodes"]) for each in fallen_back["refusals"]}


@pytest.mark.usefixtures("scheduler")
def test_the_order_wins_over_the_score_in_either_direction(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, robot(ROBOT, cpu="4"), edge("large", cpu="64", memory="128Gi")):
        stage.wait_known("large")
        assert start(stage, "robot-first", ("Robot", "Edge")) == ROBOT
        assert start(stage, "edge-first", ("Edge", "Robot")) == "large"


@pytest.mark.usefixtures("scheduler")
def test_an_edge_beyond_the_required_budget_is_no_place_and_beyond_a_preferred_one_it_is(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, robot(ROBOT), edge("far")):
        rtt = [{"peer": "far", "p50Us": 50_000, "p95Us": 50_000}]
        telemetry = {"apiVersion": API_VERSION, "kind": "NodeTelemetry", "metadata": {"name": ROBOT}}
        installed_plane.api.create(TELEMETRY, telemetry)
        status = {"status": {"intervalSeconds": 100, "seq": 1, "rtt": rtt}}
        installed_plane.api.patch(f"{TELEMETRY}/{ROBOT}/status", status)
        stage.wait_known("far")
        for enforce, node in (("Required", ROBOT), ("Preferred", "far")):
            latency = {"budget": "20ms", "enforce": enforce}
            topic = {"topic": "/scan", "from": "@robot", "to": "planner", "latency": latency}
            assert start(stage, enforce.lower(), ("Edge", "Robot"), edges=[topic]) == node
