"""What a user reads and does: the table, waiting, applying twice, refusals with a next step, deletion without an operator."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.live.journeys.conftest import Pools

from campaigns.rigs.appwatch import condition, is_ready
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from robotapp_api.model.names import OPERATOR_MANAGER, SYSTEM_NAMESPACE, EventReason, Label
from robotapp_operator.watch.informers import LATENCY_DELAY_S
from robotapp_testbed import wait_until

pytestmark = pytest.mark.live

EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("*.yaml"))
TELEOP = Path(__file__).parents[3] / "examples" / "teleop.yaml"
PATIENCE_S = 60.0
"""For what takes a second or two on an idle machine."""
STILL_S = 2 * LATENCY_DELAY_S
"""The operator puts off nothing that it writes about an app for longer than half of this."""
KOPF_WAITS_S = 5.0
"""How long kopf waits at its end for tasks that do not end by themselves."""
LEASE = f"/apis/coordination.k8s.io/v1/namespaces/{SYSTEM_NAMESPACE}/leases/{OPERATOR_MANAGER}"


def test_the_example_is_waited_for_and_the_table_says_domain_robot_and_budget(
    world: SimulatedSite, pools: Pools
) -> None:
    app = _teleop(world, pools)
    world.kubectl("apply", "-f", "-", stdin=app)
    assert "condition met" in world.kubectl(
        "wait", "--for=condition=Ready", "robotapp/teleop", f"--timeout={PATIENCE_S:g}s"
    )
    assert wait_until(lambda: "/" in _row(world, "teleop")["BUDGET"], timeout_s=PATIENCE_S, poll_s=0.2)
    columns = _row(world, "teleop")
    assert columns["READY"] == "2/2"
    assert columns["PHASE"] == "Running"
    assert columns["ROBOTS"] == "1/1"
    assert columns["DOMAIN"] in {str(number) for number in range(1, 13)}
    spent, _, budget = columns["BUDGET"].partition("/")
    assert budget == "30ms"
    assert float(spent) <= 30

    def told() -> list[str]:
        return [each["reason"] for each in world.events("teleop")]

    wait_until(lambda: len(told()) >= 2, timeout_s=PATIENCE_S, poll_s=0.1)  # they follow what they tell of
    assert told() == [EventReason.DOMAIN_ALLOCATED, EventReason.PLACED]


@pytest.mark.parametrize("source", ["README.md", *(f"examples/{path.name}" for path in EXAMPLES)])
def test_the_apps_of_readme_and_examples_are_taken_as_they_are_written(world: SimulatedSite, source: str) -> None:
    text = (TELEOP.parents[1] / source).read_text()
    if source == "README.md":
        text = text.partition("```yaml\n")[2].partition("```")[0]
    assert "created (server dry run)" in world.kubectl(
        "apply", "--dry-run=server", "--validate=strict", "-f", "-", stdin=text
    )


def test_applying_twice_changes_nothing(world: SimulatedSite, pools: Pools) -> None:
    app = _teleop(world, pools)
    for extra in ([], ["--server-side", "--force-conflicts"]):
        world.kubectl("apply", *extra, "-f", "-", stdin=app)
        world.watch.until_ready("teleop", within_s=PATIENCE_S)
        assert wait_until(lambda: _is_still(world, "teleop"), timeout_s=PATIENCE_S)
        before = world.app("teleop")["metadata"]
        pods = {pod["metadata"]["uid"] for pod in world.pods()}
        world.kubectl("apply", *extra, "-f", "-", stdin=app)
        time.sleep(STILL_S)  # what must not happen has no event to wait for
        after = world.app("teleop")["metadata"]
        assert (after["generation"], after["resourceVersion"]) == (before["generation"], before["resourceVersion"])
        assert {pod["metadata"]["uid"] for pod in world.pods()} == pods


def test_deletion_is_not_held_up_by_an_operator_that_is_down_and_leaves_nothing(
    world: SimulatedSite, pools: Pools
) -> None:
    world.create(plain_app("orphaned", ros2={"pool": pools.twelve}))
    world.watch.until_ready("orphaned", within_s=PATIENCE_S)
    world.operator.kill()
    try:
        world.kubectl(
            "delete", "robotapp", "orphaned", f"--timeout={PATIENCE_S:g}s"
        )  # waits until the object itself is gone
        assert wait_until(lambda: not world.left(), timeout_s=PATIENCE_S, poll_s=0.2), (
            world.left()
        )  # the scheduler sweeps too
    finally:
        world.operator.start().wait_ready()
        assert "Traceback" not in world.operator.log_text()


def test_a_stopped_operator_ends_at_once_and_its_successor_need_not_wait(world: SimulatedSite, pools: Pools) -> None:
    """Other programs of this machine can only delay an end, so the quickest of three counts."""

    def end_s(number: int) -> float:
        name = f"served-{number}"
        world.create(plain_app(name, ros2={"pool": pools.twelve}))
        world.watch.until_ready(name, within_s=PATIENCE_S)
        began_s = time.monotonic()
        assert world.operator.stop() == 0
        took_s = time.monotonic() - began_s
        assert "holderIdentity" not in world.cp.api.get(LEASE)["spec"], "its successor waits until the Lease runs out"
        world.operator.start().wait_ready()
        return took_s

    assert any(end_s(number) < 0.9 * KOPF_WAITS_S for number in range(3))
    world.create(plain_app("after", ros2={"pool": pools.twelve}))
    world.watch.until_ready("after", within_s=PATIENCE_S)


def test_a_domain_written_into_a_deployment_by_hand_is_taken_out_again(world: SimulatedSite, pools: Pools) -> None:
    world.create(plain_app("edited", parts=("only",), ros2={"pool": pools.twelve}))
    world.watch.until_ready("edited", within_s=PATIENCE_S)
    number = world.app("edited")["status"]["summary"]["domain"]
    world.kubectl("set", "env", "deployment", "--selector", "robotics.io/app=edited", "ROS_DOMAIN_ID=99")
    assert wait_until(lambda: _domains(world) == {number}, timeout_s=PATIENCE_S, poll_s=0.2), _domains(world)
    assert wait_until(
        lambda: all(pod["spec"].get("nodeName") for pod in world.pods()), timeout_s=PATIENCE_S, poll_s=0.2
    )
    world.watch.until(lambda apps: is_ready(apps["edited"]), within_s=PATIENCE_S, what="edited Ready again")


def test_an_app_too_big_for_every_node_is_told_how_many_and_what_to_ask_next(
    world: SimulatedSite, pools: Pools
) -> None:
    app = plain_app("big", parts=("giant",), ros2={"pool": pools.twelve})
    app["spec"]["components"][0]["resources"] = {"requests": {"cpu": "5000"}}
    world.create(app)
    parts = ("0 of 1 placed", "giant", "nodes are available", "Insufficient cpu", "kubectl robotapp explain big")
    said = _said(world, "big", "Placed", parts)
    assert "preemption" not in said["message"]
    assert wait_until(
        lambda: EventReason.NODE_REJECTED in {e["reason"] for e in world.events("big")}, timeout_s=PATIENCE_S
    )
    assert "Insufficient cpu" in world.kubectl("get", "robotapp", "big", "-o", "wide")


def test_an_app_whose_number_is_taken_is_told_by_whom_and_three_ways_out(world: SimulatedSite, pools: Pools) -> None:
    world.create(plain_app("first", parts=("only",), ros2={"pool": pools.twelve, "domain": 5}))
    world.watch.until_ready("first", within_s=PATIENCE_S)
    world.create(plain_app("late", parts=("only",), ros2={"pool": pools.twelve, "domain": 5}))
    _said(
        world,
        "late",
        "Allocated",
        ("domain 5", pools.twelve, f"{world.namespace}/first", "leave spec.ros2.domain out", "shareWith", "delete"),
    )
    assert condition(world.app("late"), "Progressing")["status"] == "False"


def _teleop(world: SimulatedSite, pools: Pools) -> dict[str, Any]:
    """The example, for a robot and a pool of this world."""
    app: dict[str, Any] = yaml.safe_load(TELEOP.read_text())
    robot = next(node.robot for node in world.nodes if node.robot)
    app["spec"]["robots"] = {"nodeSelector": {"matchLabels": {str(Label.ROBOT): robot}}}
    app["spec"]["ros2"] = {"pool": pools.twelve}
    return app


def _row(world: SimulatedSite, name: str) -> dict[str, str]:
    """The app's line of `kubectl get ra` by column; empty cells stay empty."""
    head, line = world.kubectl("get", "ra", name).splitlines()[:2]
    starts = [head.index(word) for word in head.split()]
    ends = [*starts[1:], None]
    return {head[a:b].strip(): line[a:b].strip() for a, b in zip(starts, ends, strict=True)}


def _domains(world: SimulatedSite) -> set[str]:
    """Every domain that any container of any Deployment names."""
    items = world.cp.api.get(f"/apis/apps/v1/namespaces/{world.namespace}/deployments")["items"]
    pods = [item["spec"]["template"]["spec"] for item in items]
    containers = [each for pod in pods for each in (*pod["containers"], *pod.get("initContainers", ()))]
    variables = [variable for container in containers for variable in container.get("env", ())]
    return {variable["value"] for variable in variables if variable["name"] == "ROS_DOMAIN_ID"}


def _is_still(world: SimulatedSite, name: str) -> bool:
    """The stored object did not change for a while."""
    before = world.app(name)["metadata"]["resourceVersion"]
    time.sleep(STILL_S)
    return bool(world.app(name)["metadata"]["resourceVersion"] == before)


def _said(world: SimulatedSite, name: str, kind: str, parts: Sequence[str]) -> Mapping[str, Any]:
    """The condition once it is False and says all of this."""

    def found() -> Mapping[str, Any]:
        return condition(world.watch.apps.get(name, {}), kind)

    def says() -> bool:
        return found().get("status") == "False" and all(part in found()["message"] for part in parts)

    assert wait_until(says, timeout_s=PATIENCE_S, poll_s=0.1), found()
    return found()
