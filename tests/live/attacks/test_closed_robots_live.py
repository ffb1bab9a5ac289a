"""Robots choose their tenants under every scheduler: a tenant's app that names kube-scheduler gets on none that is closed to it.

The attacker is `admin` of a namespace. kube-scheduler itself binds the pods, and the robots bear the taint that
docs/security.md recommends; pods of RobotApps tolerate it.
"""

import json
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from campaigns.rigs.live import eventually
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from campaigns.rigs.twin import THEIRS, kube_scheduler
from robotapp_api.model.names import SCHEDULING_GATE, Annotation, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import CommandError
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import SimulatedNode, edge, robot

pytestmark = pytest.mark.live
Json = dict[str, Any]
MARK = secrets.token_hex(2)
OWNER = f"team-that-owns-{MARK}"
CLOSED, EDGE = f"amr-secret-{MARK}", f"edge-{MARK}"
ALLOWED = str(Annotation.ALLOWED_NAMESPACES)
POOL = f"closed-{MARK}"
EVERYTHING = [{"operator": "Exists"}]


def tainted(name: str, *, allowed: str | None) -> SimulatedNode:
    taint = {"key": "robotics.io/robot", "value": name, "effect": "NoSchedule"}
    return robot(name, annotations={} if allowed is None else {ALLOWED: allowed}, taints=[taint])


@pytest.fixture(scope="module")
def world(installed_plane: ControlPlane, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedSite]:
    folder: Path = tmp_path_factory.mktemp("twin")
    nodes = Topology([tainted(CLOSED, allowed=OWNER), edge(EDGE)])
    with SimulatedSite(installed_plane, nodes, pools={POOL: "1-40"}) as made, kube_scheduler(installed_plane, folder):
        rights = ("rolebinding", "owner", "--clusterrole=admin", "--user=tenant")
        made.kubectl("create", *rights)
        yield made


@pytest.fixture(autouse=True)
def _as_it_was(world: SimulatedSite) -> Iterator[None]:
    yield
    world.clear()
    cordon(world, on=False)
    admit(world, CLOSED, OWNER)


def as_tenant(world: SimulatedSite, *args: str, stdin: object = None) -> str:
    return world.cp.kubectl("-n", world.namespace, *args, stdin=stdin, identity="tenant")


def attack(
    world: SimulatedSite,
    name: str,
    *,
    template: Json | None = None,
    on: tuple[str, ...] = ("Robot",),
    parts: tuple[str, ...] = ("driver",),
    **spec: Any,
) -> None:
    fields = {"schedulerName": THEIRS, "ros2": {"pool": POOL, "rmw": "rmw_cyclonedds_cpp"}, **spec}
    app = plain_app(name, parts=parts, **{key: value for key, value in fields.items() if value is not None})
    for part in app["spec"]["components"]:
        if on:
            part["runsOn"] = list(on)
        if template:
            part["template"] = {"spec": template}
    as_tenant(world, "create", "-f", "-", stdin=app)


def admit(world: SimulatedSite, node: str, allowed: str | None) -> None:
    world.cp.api.patch(f"/api/v1/nodes/{node}", {"metadata": {"annotations": {ALLOWED: allowed}}})


def cordon(world: SimulatedSite, *, on: bool) -> None:
    world.cp.api.patch(f"/api/v1/nodes/{CLOSED}", {"spec": {"unschedulable": on}})


def placed(world: SimulatedSite, name: str) -> Json:
    found = world.app(name).get("status", {}).get("conditions", [])
    return next((item for item in found if item["type"] == "Placed"), {})


def places(world: SimulatedSite) -> list[str]:
    return [pod["spec"].get("nodeName", "") for pod in world.pods() if not pod["metadata"].get("deletionTimestamp")]


def wait_refused(world: SimulatedSite, name: str) -> None:
    """The pods wait under our gate, and the reason names nobody."""
    said = f"no node that it may use admits namespace {world.namespace}"
    eventually(lambda: said in placed(world, name).get("message", ""), what=lambda: placed(world, name))
    for pod in world.pods():
        assert not pod["spec"].get("nodeName")
        assert SCHEDULING_GATE in [gate["name"] for gate in pod["spec"]["schedulingGates"]]
    told = json.dumps([world.app(name)["status"], world.pods(), world.events(name)])
    assert OWNER not in told
    assert CLOSED not in told


WAYS: dict[str, Json] = {
    "any robot": {},
    "a toleration of everything": {"template": {"tolerations": EVERYTHING}},
    "the label of robots": {"template": {"nodeSelector": {"robotics.io/tier": "robot"}, "tolerations": EVERYTHING}, "on": ()},
    "ROS 1": {"ros": {"distro": "noetic"}, "ros2": None, "ros1": {"master": "External", "uri": "http://m:11311"}},
}  # fmt: skip


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_an_app_for_any_robot_waits_and_starts_when_it_is_admitted(world: SimulatedSite, way: Json) -> None:
    attack(world, "guest", **way)
    wait_refused(world, "guest")
    admit(world, CLOSED, f"{OWNER}, {world.namespace}")
    eventually(lambda: places(world) == [CLOSED], what=world.pods)


def test_servers_of_its_discovery_get_there_no_more_than_its_components(world: SimulatedSite) -> None:
    """Servers go where all components may go: with a node selector of the template that is a robot."""
    there = {"nodeSelector": {str(Label.ROBOT): CLOSED}, "tolerations": EVERYTHING}
    attack(
        world, "guest", template=there, on=(), parts=("driver", "panel"), ros2={"pool": POOL, "rmw": "rmw_fastrtps_cpp"}
    )
    eventually(lambda: len(world.pods()) == 4, what=world.pods)
    said = f"no node that it may use admits namespace {world.namespace}"
    eventually(lambda: said in placed(world, "guest").get("message", ""), what=lambda: placed(world, "guest"))
    assert places(world) == [""] * 4
    admit(world, CLOSED, None)
    eventually(lambda: places(world) == [CLOSED] * 4, what=lambda: places(world))


def test_a_roscore_on_a_named_node_is_no_way_round(world: SimulatedSite) -> None:
    noetic = {"ros": {"distro": "noetic"}, "ros2": None, "placement": {"masterNode": CLOSED}}
    attack(world, "guest", on=("Edge",), template={"tolerations": EVERYTHING}, **noetic)
    said = f'there is no node "{CLOSED}" that admits namespace {world.namespace}'
    eventually(
        lambda: any(said in item["message"] for item in world.app("guest").get("status", {}).get("conditions", [])),
        what=lambda: world.app("guest").get("status"),
    )
    assert places(world) == [], "as if there were no such node"


def test_among_other_nodes_those_that_are_closed_are_left_out(world: SimulatedSite) -> None:
    attack(world, "guest", on=(), template={"tolerations": EVERYTHING})
    eventually(lambda: places(world) == [EDGE], what=world.pods)
    (pod,) = world.pods()
    assert CLOSED not in json.dumps(pod), "whose robots there are is no tenant's business"


def test_a_robot_that_closes_while_a_pod_waits_for_room_takes_it_no_more(world: SimulatedSite) -> None:
    """The pod was let go when the robot was open; what runs already would stay."""
    admit(world, CLOSED, None)
    cordon(world, on=True)
    attack(world, "guest")
    eventually(lambda: [pod for pod in world.pods() if not pod["spec"].get("schedulingGates")], what=world.pods)
    admit(world, CLOSED, OWNER)
    wait_refused(world, "guest")
    cordon(world, on=False)
    admit(world, CLOSED, world.namespace)
    eventually(lambda: places(world) == [CLOSED], what=world.pods)


def test_the_tenant_cannot_take_the_gate_off_his_pods(world: SimulatedSite) -> None:
    attack(world, "guest")
    wait_refused(world, "guest")
    (pod,) = world.pods()
    name = pod["metadata"]["name"]
    with pytest.raises(CommandError, match="taken off by the robotapp operator alone"):
        as_tenant(world, "patch", "pod", name, "--type=merge", "-p", '{"spec": {"schedulingGates": null}}')
    pod |= {"apiVersion": "v1", "kind": "Pod"}
    pod["spec"].pop("schedulingGates")
    with pytest.raises(CommandError, match="taken off by the robotapp operator alone"):
        as_tenant(world, "replace", "-f", "-", stdin=pod)
    assert places(world) == [""]


def test_with_spec_robots_its_own_robot_is_the_only_one(world: SimulatedSite) -> None:
    """Instances of closed robots do not exist; that of an open one is bound to it, and to no sibling that is closed."""
    selector = {"matchExpressions": [{"key": str(Label.ROBOT), "operator": "In", "values": [CLOSED]}]}
    attack(world, "guest", robots={"nodeSelector": selector}, template={"tolerations": EVERYTHING})
    eventually(
        lambda: world.app("guest").get("status", {}).get("conditions", [{}])[1].get("reason") == "NoMatchingRobot",
        what=lambda: world.app("guest").get("status"),
    )
    assert world.pods() == []
