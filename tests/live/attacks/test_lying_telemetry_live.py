"""Agents that lose every probe, fall silent, or write the same round for ever; and nodes that go while their agents' objects stay."""

import math
import secrets
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.rigs.live import eventually, instances_of
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from robotapp_api.model.names import API_VERSION
from robotapp_testbed import ApiStatusError, ControlPlane
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import edge, robot

pytestmark = pytest.mark.live
TELEMETRY = f"/apis/{API_VERSION}/nodetelemetries"
HEARTBEAT_S = 2
MARK = secrets.token_hex(2)
ROBOT, EDGE, SPARE = f"amr-{MARK}", f"edge-{MARK}", f"spare-{MARK}"
TOPIC = {"topic": "/cmd_vel", "from": "panel", "to": "driver", "latency": {"budget": "30ms"}}
Json = dict[str, Any]


@pytest.fixture(scope="module")
def world(installed_plane: ControlPlane) -> Iterator[SimulatedSite]:
    nodes = [robot(ROBOT), edge(EDGE), edge(SPARE, taints=[{"key": "spare", "effect": "NoSchedule"}])]
    pools = {f"lies-{MARK}": "1-9"}
    with SimulatedSite(installed_plane, Topology(nodes), pools=pools, telemetry_s=HEARTBEAT_S) as made:
        yield made


def teleop(name: str) -> Json:
    app = plain_app(
        name, parts=("panel", "driver"), edges=[TOPIC], ros2={"pool": f"lies-{MARK}"},
        robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": ROBOT}}},
    )  # fmt: skip
    panel, driver = app["spec"]["components"]
    panel["runsOn"], driver["runsOn"] = ["Edge"], ["Robot"]
    return app


def condition(world: SimulatedSite, name: str, kind: str) -> Json:
    found = world.app(name).get("status", {}).get("conditions", [])
    return next((item for item in found if item["type"] == kind), {})


def wait_budget(world: SimulatedSite, name: str, status: str, reason: str) -> str:
    def settled() -> bool:
        found = condition(world, name, "BudgetMet")
        return (found.get("status"), found.get("reason")) == (status, reason)

    eventually(settled, what=lambda: world.app(name)["status"])
    return str(condition(world, name, "BudgetMet")["message"])


def test_a_link_that_loses_every_probe_breaks_the_budget_in_status_and_for_the_scheduler(world: SimulatedSite) -> None:
    world.create(teleop("before"))
    wait_budget(world, "before", "True", "WithinBudget")
    world.telemetry.set_rtt(ROBOT, EDGE, math.inf)
    message = wait_budget(world, "before", "False", "BudgetExceeded")
    assert "unreachable of 30ms" in message
    assert "get no answer" in message

    def shown() -> list[tuple[Any, ...]]:  # the instance's object is written after the app's status
        (instance,) = instances_of(world.cp, world.app("before"))
        return [(each["measured"], each.get("met"), each.get("p95")) for each in instance["status"].get("edges", ())]

    eventually(lambda: shown() == [(True, False, None)], what=shown)
    world.create(teleop("during"))
    eventually(
        lambda: "got no answer from the other end" in condition(world, "during", "Placed").get("message", ""),
        what=lambda: condition(world, "during", "Placed"),
    )
    world.telemetry.set_rtt(ROBOT, EDGE, 2.0)
    wait_budget(world, "during", "True", "WithinBudget")


def test_an_agent_that_writes_the_same_round_for_ever_is_believed_for_three_of_its_periods(
    world: SimulatedSite,
) -> None:
    """Each write is another resourceVersion, as from a stuck agent or from anybody who labels the object."""
    world.create(teleop("stuck"))
    wait_budget(world, "stuck", "True", "WithinBudget")
    for name in (ROBOT, EDGE, SPARE):
        world.telemetry.silence(name)
    stop = threading.Event()

    def write() -> None:
        number = 0
        while not stop.wait(0.3):
            number += 1
            for name in (ROBOT, EDGE):
                world.cp.api.patch(f"{TELEMETRY}/{name}", {"metadata": {"labels": {"written": str(number)}}})

    writer = threading.Thread(target=write)
    writer.start()
    try:
        message = wait_budget(world, "stuck", "Unknown", "NotMeasured")
        assert "no recent measurement" in message
    finally:
        stop.set()
        writer.join()
    for name in (ROBOT, EDGE, SPARE):
        world.telemetry.speak(name)
    wait_budget(world, "stuck", "True", "WithinBudget")


def test_a_node_that_goes_takes_its_telemetry_along_whoever_created_it(world: SimulatedSite) -> None:
    path = f"{TELEMETRY}/{SPARE}"
    uid = world.cp.api.get(f"/api/v1/nodes/{SPARE}")["metadata"]["uid"]
    owners = [{"apiVersion": "v1", "kind": "Node", "name": SPARE, "uid": uid}]
    assert world.cp.api.get(path)["metadata"]["ownerReferences"] == owners
    world.cp.api.patch(path, {"metadata": {"ownerReferences": None}})
    eventually(lambda: world.cp.api.get(path)["metadata"].get("ownerReferences") == owners)
    world.telemetry.silence(SPARE)
    world.cp.api.delete(f"/api/v1/nodes/{SPARE}")

    def gone() -> bool:
        try:
            world.cp.api.get(path)
        except ApiStatusError as error:
            return error.status == 404
        return False

    eventually(gone)
