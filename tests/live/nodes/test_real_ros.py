"""What real ROS makes of our rendering: rclpy with Fast DDS, Cyclone DDS and ROS 1 in containers on real nodes.

rmw_cyclonedds and rmw_zenoh are in no package index, so with Cyclone DDS the listener is rclpy with Fast DDS.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pytest
from tests.support.work_unit import slowness

from campaigns.nodes import teleop_app as teleop
from robotapp_api.values.naming import child_name
from robotapp_operator.plan.diff.master_restarts import START_LEAD
from robotapp_operator.plan.spec.desired import PEERS
from robotapp_testbed import images, wait_until
from robotapp_testbed.binaries import pins
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import edge, robot
from robotapp_testbed.real import RealNodes

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(pins.platform_names()["arch"] != "amd64", reason="wheels of rclpy are for amd64 alone"),
]

TOPIC = "/chatter"
STARTED_S = 60.0
FOLLOWS_S = 5.0
"""Time within which readiness follows the messages, where `slowness` is 1."""
HEALS_S = 20.0
"""Time after which a pair talks again whose master was replaced, where `slowness` is 1."""


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes, delays = [robot("robot-1"), edge("edge-1")], {("robot-1", "edge-1"): 2}
    with real_machine(nodes, delays=delays, images=("jazzy", "ros2", "ros1"), kube_scheduler=True) as cp:
        product.install(cp)
        product.start_operator(cp)
        product.start_scheduler(cp)
        yield cp


@pytest.fixture
def place(cluster: RealNodes) -> Iterator[str]:
    with created(cluster, f"ros-{time.monotonic_ns() % 100_000}") as name:
        yield name


def part(name: str, node: str, args: Sequence[str], image: str = "jazzy", **fields: Any) -> dict[str, Any]:
    """A component on this node."""
    spec = {"nodeSelector": {"kubernetes.io/hostname": node}, **fields.pop("spec", {})}
    common = {"image": images.reference(image), "imagePullPolicy": "IfNotPresent", "template": {"spec": spec}}
    return {"name": name, "args": ["python3", "-m", *args], **common, **fields}


def chatter(ros2: Mapping[str, Any], *, talker: Mapping[str, Any], listener: Mapping[str, Any], distro: str) -> Any:
    """An app whose listener is ready while it hears the talker."""
    ready = {"ready": {"topic": {"name": TOPIC}}}
    spec = {
        "ros": {"distro": distro},
        "ros2": ros2,
        "components": [{**talker}, {**listener, **ready}],
    }
    return {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": "chat"}, "spec": spec}


def is_ready(cp: RealNodes, place: str, component: str) -> bool:
    pod = teleop.pods(cp, place, "chat").get(component, {"status": {}})
    return any(each["type"] == "Ready" and each["status"] == "True" for each in pod["status"].get("conditions", ()))


def run_in(cp: RealNodes, place: str, component: str, line: str) -> str:
    """Runs a line as somebody who opened a shell in the component's container."""
    pod = teleop.pods(cp, place, "chat")[component]["metadata"]["name"]
    return cp.kubectl("exec", "-n", place, pod, "-c", component, "--", "bash", "-c", line)


def assert_readiness_follows(cp: RealNodes, place: str) -> None:
    """The listener becomes ready, not ready and ready again as the talker speaks."""
    assert wait_until(lambda: is_ready(cp, place, "listener"), timeout_s=STARTED_S, poll_s=0.2)
    for line, wanted in (("touch /tmp/silence", False), ("rm /tmp/silence", True)):
        run_in(cp, place, "talker", line)
        follows_s = FOLLOWS_S * slowness(seconds=0.2)
        assert wait_until(lambda wanted=wanted: is_ready(cp, place, "listener") is wanted, timeout_s=follows_s), line  # type: ignore[misc] # mypy sees no type for a default


@pytest.mark.parametrize("mode", ["Server", "Peers"])
def test_with_fast_dds_readiness_follows_messages_a_sidecar_hears_its_component_and_commands_see_the_graph(
    cluster: RealNodes, place: str, mode: str
) -> None:
    listen = ["ros_nodes.chatter", "listener", TOPIC]
    sidecar = {
        "name": "sidecar",
        "image": images.reference("jazzy"),
        "imagePullPolicy": "IfNotPresent",
        "restartPolicy": "Always",
        "args": ["python3", "-m", *listen],
    }
    helper = {"image": images.reference("jazzy"), "imagePullPolicy": "IfNotPresent"} if mode == "Server" else {}
    app = chatter(
        {"rmw": "rmw_fastrtps_cpp", "discovery": {"mode": mode, **helper}},
        talker=part("talker", "edge-1", ["ros_nodes.chatter", "talker", TOPIC], spec={"initContainers": [sidecar]}),
        listener=part("listener", "robot-1", listen),
        distro="jazzy",
    )
    teleop.apply(cluster, place, [app])
    assert_readiness_follows(cluster, place)
    pod = teleop.pods(cluster, place, "chat")["talker"]["metadata"]["name"]
    assert "heard" in cluster.kubectl("logs", "-n", place, pod, "-c", "sidecar")
    shell = "source /opt/ros/$ROS_DISTRO/setup.bash; "
    listed = run_in(
        *(cluster, place, "talker"),
        f"{shell} touch /tmp/silence; ROS_SUPER_CLIENT=TRUE python3 -m ros_nodes.chatter topics 3",
    )
    assert f"{TOPIC} std_msgs/msg/String" in listed.splitlines()
    echo = f"{shell} (sleep 3; rm /tmp/silence) & python3 -m ros_nodes.chatter listener {TOPIC} | head -n 1"
    assert "heard" in run_in(cluster, place, "talker", echo)


def test_with_cyclone_dds_and_peers_readiness_follows_messages(cluster: RealNodes, place: str) -> None:
    """A listener in another middleware names its peers itself."""
    peers = f"talker.{child_name('chat', '', PEERS)}"
    variables = {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_STATIC_PEERS": peers}
    env = [{"name": name, "value": value} for name, value in variables.items()]
    app = chatter(
        {"rmw": "rmw_cyclonedds_cpp", "discovery": {"mode": "Peers"}},
        talker=part("talker", "edge-1", ["ros_nodes.dds_talker", TOPIC], "ros2"),
        listener=part("listener", "robot-1", ["ros_nodes.chatter", "listener", TOPIC], env=env),
        distro="lyrical",  # whose Cyclone DDS is the image's
    )
    teleop.apply(cluster, place, [app])
    assert_readiness_follows(cluster, place)


@pytest.mark.parametrize("how", ["pod", "container"])
def test_a_pair_of_ros_1_talks_again_after_its_master_was_replaced(cluster: RealNodes, place: str, how: str) -> None:
    teleop.first_trip_s(cluster, place, teleop.app("pair", ros=1, nodes={"operator": "edge-1", "robot": "robot-1"}))
    before = teleop.pods(cluster, place, "pair")
    time.sleep(START_LEAD.total_seconds() + 1)
    lose_master(cluster, place, how)

    def talks_anew() -> bool:
        pods = teleop.pods(cluster, place, "pair")
        replaced = all(pods[name]["metadata"]["uid"] != before[name]["metadata"]["uid"] for name in before)
        return replaced and bool(teleop.trips(cluster, place, "pair"))

    assert wait_until(talks_anew, timeout_s=HEALS_S * slowness(), poll_s=0.2)
    path = f"/apis/events.k8s.io/v1/namespaces/{place}/events"

    def told() -> list[str]:
        return [each["note"] for each in cluster.api.get(path)["items"] if each["reason"] == "MasterRestarted"]

    assert wait_until(lambda: bool(told()), timeout_s=10)
    assert told()[0].endswith("operator, robot restarted")


def lose_master(cp: RealNodes, place: str, how: str) -> None:
    """Deletes its pod, or ends its container."""
    selector = "robotics.io/app=pair,robotics.io/role=master"
    (pod,) = cp.api.get(f"/api/v1/namespaces/{place}/pods?labelSelector={selector}")["items"]
    if how == "pod":
        cp.kubectl("delete", "pod", "-n", place, pod["metadata"]["name"], "--wait=false")
    else:
        (container,) = pod["status"]["containerStatuses"]
        cp.node(pod["spec"]["nodeName"]).kill_container(container["containerID"])
