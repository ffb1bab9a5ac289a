"""What a user reads and does: the table, waiting, applying twice, refusals with a next step, deletion without an operator."""

import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.integration.journeys.conftest import Pools
from tests.support.appwatch import condition, is_ready
from tests.support.world import World, plain_app

from robotapp_api.model.names import EventReason, Label
from robotapp_testbed import wait_until

pytestmark = pytest.mark.live

TELEOP = Path(__file__).parents[3] / "examples" / "teleop.yaml"


def test_the_example_is_waited_for_and_the_table_says_domain_robot_and_budget(world: World, pools: Pools) -> None:
    app = _teleop(world, pools)
    world.kubectl("apply", "-f", "-", stdin=app)
    assert "condition met" in world.kubectl("wait", "--for=condition=Ready", "robotapp/teleop", "--timeout=30s")
    columns = _row(world, "teleop")
    assert columns["READY"] == "2/2"
    assert columns["PHASE"] == "Running"
    assert columns["ROBOTS"] == "1/1"
    assert columns["DOMAIN"] in {str(number) for number in range(1, 13)}
    spent, _, budget = columns["BUDGET"].partition("/")
    assert budget == "30ms"
    assert float(spent) <= 30
    assert [each["reason"] for each in world.events("teleop")] == [EventReason.DOMAIN_ALLOCATED, EventReason.PLACED]


def test_applying_twice_changes_nothing(world: World, pools: Pools) -> None:
    app = _teleop(world, pools)
    for extra in ([], ["--server-side", "--force-conflicts"]):
        world.kubectl("apply", *extra, "-f", "-", stdin=app)
        world.watch.until_ready("teleop", within_s=30)
        assert wait_until(lambda: _is_still(world, "teleop"), timeout_s=10)
        before = world.app("teleop")["metadata"]
        pods = {pod["metadata"]["uid"] for pod in world.pods()}
        world.kubectl("apply", *extra, "-f", "-", stdin=app)
        time.sleep(1.0)  # what must not happen has no event to wait for
        after = world.app("teleop")["metadata"]
        assert (after["generation"], after["resourceVersion"]) == (before["generation"], before["resourceVersion"])
        assert {pod["metadata"]["uid"] for pod in world.pods()} == pods


def test_deletion_is_not_held_up_by_an_operator_that_is_down_and_leaves_nothing(world: World, pools: Pools) -> None:
    world.create(plain_app("orphaned", dds={"pool": pools.twelve}))
    world.watch.until_ready("orphaned", within_s=30)
    world.operator.kill()
    try:
        world.kubectl("delete", "robotapp", "orphaned", "--timeout=5s")  # waits until the object itself is gone
        assert wait_until(lambda: not world.left(), timeout_s=30, poll_s=0.2), world.left()  # the scheduler sweeps too
    finally:
        world.operator.start().wait_ready()
        assert "Traceback" not in world.operator.log_text()


def test_a_stopped_operator_ends_at_once_and_its_successor_need_not_wait(world: World, pools: Pools) -> None:
    world.create(plain_app("before", dds={"pool": pools.twelve}))
    world.watch.until_ready("before", within_s=30)
    began_s = time.monotonic()
    assert world.operator.stop() == 0
    assert time.monotonic() - began_s < 4.5  # kopf gives tasks that do not end by themselves five seconds
    world.operator.start().wait_ready()
    world.create(plain_app("after", dds={"pool": pools.twelve}))
    world.watch.until_ready("after", within_s=10)  # less than the Lease of an operator that was killed


def test_a_domain_written_into_a_deployment_by_hand_is_taken_out_again(world: World, pools: Pools) -> None:
    world.create(plain_app("edited", parts=("only",), dds={"pool": pools.twelve}))
    world.watch.until_ready("edited", within_s=30)
    number = world.app("edited")["status"]["summary"]["domain"]
    world.kubectl("set", "env", "deployment", "--selector", "robotics.io/app=edited", "ROS_DOMAIN_ID=99")
    assert wait_until(lambda: _domains(world) == {number}, timeout_s=10, poll_s=0.2), _domains(world)
    assert wait_until(lambda: all(pod["spec"].get("nodeName") for pod in world.pods()), timeout_s=20, poll_s=0.2)
    world.watch.until(lambda apps: is_ready(apps["edited"]), within_s=20, what="edited Ready again")


def test_an_app_too_big_for_every_node_is_told_how_many_and_what_to_ask_next(world: World, pools: Pools) -> None:
    app = plain_app("big", parts=("giant",), dds={"pool": pools.twelve})
    app["spec"]["components"][0]["resources"] = {"requests": {"cpu": "5000"}}
    world.create(app)
    said = _until(world, "big", "Placed", "False")
    for part in ("0 of 1 placed", "giant", "nodes are available", "Insufficient cpu", "kubectl robotapp explain big"):
        assert part in said["message"]
    assert "preemption" not in said["message"]
    assert wait_until(lambda: EventReason.NODE_REJECTED in {e["reason"] for e in world.events("big")}, timeout_s=5)
    assert "Insufficient cpu" in world.kubectl("get", "robotapp", "big", "-o", "wide")


def test_an_app_whose_number_is_taken_is_told_by_whom_and_three_ways_out(world: World, pools: Pools) -> None:
    world.create(plain_app("first", parts=("only",), dds={"pool": pools.twelve, "domain": 5}))
    world.watch.until_ready("first", within_s=30)
    world.create(plain_app("late", parts=("only",), dds={"pool": pools.twelve, "domain": 5}))
    said = _until(world, "late", "Allocated", "False")
    for part in ("domain 5", pools.twelve, f"{world.namespace}/first", "leave out", "shareWith", "delete"):
        assert part in said["message"]
    assert condition(world.app("late"), "Progressing")["status"] == "False"


def _teleop(world: World, pools: Pools) -> dict[str, Any]:
    """The example, for a robot and a pool of this world."""
    app: dict[str, Any] = yaml.safe_load(TELEOP.read_text())
    robot = next(node.robot for node in world.nodes if node.robot)
    app["spec"]["robots"] = {"selector": {"matchLabels": {str(Label.ROBOT): robot}}}
    app["spec"]["dds"] = {"pool": pools.twelve}
    return app


def _row(world: World, name: str) -> dict[str, str]:
    """The app's line of `kubectl get ra` by column; empty cells stay empty."""
    head, line = world.kubectl("get", "ra", name).splitlines()[:2]
    starts = [head.index(word) for word in head.split()]
    ends = [*starts[1:], None]
    return {head[a:b].strip(): line[a:b].strip() for a, b in zip(starts, ends, strict=True)}


def _domains(world: World) -> set[str]:
    """Every domain that any container of any Deployment names."""
    items = world.cp.api.get(f"/apis/apps/v1/namespaces/{world.namespace}/deployments")["items"]
    pods = [item["spec"]["template"]["spec"] for item in items]
    containers = [each for pod in pods for each in (*pod["containers"], *pod.get("initContainers", ()))]
    variables = [variable for container in containers for variable in container.get("env", ())]
    return {variable["value"] for variable in variables if variable["name"] == "ROS_DOMAIN_ID"}


def _is_still(world: World, name: str) -> bool:
    """The stored object did not change for a second."""
    before = world.app(name)["metadata"]["resourceVersion"]
    time.sleep(1.0)
    return bool(world.app(name)["metadata"]["resourceVersion"] == before)


def _until(world: World, name: str, kind: str, status: str) -> Any:
    world.watch.until(
        lambda apps: name in apps and condition(apps[name], kind).get("status") == status,
        within_s=20,
        what=f"{name}: {kind}={status}",
    )
    return condition(world.watch.apps[name], kind)
