"""What real ROS makes of our rendering: rclpy with Fast DDS, Cyclone DDS, Zenoh and ROS 1 in containers on real nodes.

rmw_cyclonedds and rmw_zenoh are in no package index. With Cyclone DDS the listener is rclpy with Fast DDS. With Zenoh two
libraries speak rmw_zenoh's wire format by way of the operator's router, and the operator's probe runs on a stand-in of rclpy.
`pytest --log-cli-level=INFO` on this file prints the seconds that it measures.
"""

import logging
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

logger = logging.getLogger(__name__)

PLACE = "real-ros"
TOPIC = "/chatter"
STARTED_S = 90.0
FOLLOWS_S = 5.0
"""Time within which readiness follows the messages, where `slowness` is 1."""
HEALS_S = 20.0
"""Time after which a pair talks again whose master was replaced, where `slowness` is 1."""
LISTEN = ["python3", "-m", "ros_nodes.chatter", "listener", TOPIC]
TALK = ["python3", "-m", "ros_nodes.chatter", "talker", TOPIC]
SOURCE = "source /opt/ros/$ROS_DISTRO/setup.bash"
SOURCE_JAZZY = ". /opt/ros/jazzy/setup.bash"
JOINS_S = 20.0
"""Time within which a laptop and a robot hear each other, where `slowness` is 1."""


def part(name: str, node: str, args: Sequence[str], image: str = "jazzy", **spec: Any) -> dict[str, Any]:
    """A component on this node; `spec` are fields of its pod."""
    own = {"image": images.reference(image), "imagePullPolicy": "IfNotPresent", "args": list(args)}
    return {"name": name, **own, "template": {"spec": {"nodeSelector": {"kubernetes.io/hostname": node}, **spec}}}


def chat(
    name: str, ros2: Mapping[str, Any], *, distro: str, talker: Any, listener: Sequence[str], image: str = "jazzy"
) -> dict[str, Any]:
    """An app whose listener is ready while it hears the talker."""
    hearer = {**part("listener", "robot-1", listener, image), "ready": {"topic": {"name": TOPIC}}}
    spec = {"ros": {"distro": distro}, "ros2": ros2, "components": [talker, hearer]}
    return {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": name}, "spec": spec}


def fast_dds(name: str, *, external: Mapping[str, Any] | None = None, **discovery: Any) -> dict[str, Any]:
    """With a sidecar of the talker that listens."""
    image = {"image": images.reference("jazzy"), "imagePullPolicy": "IfNotPresent"}
    talker = part(
        "talker",
        "edge-1",
        TALK,
        initContainers=[{"name": "sidecar", **image, "restartPolicy": "Always", "args": LISTEN}],
    )
    opened = {"external": external} if external else {}
    ros2 = {"rmw": "rmw_fastrtps_cpp", "discovery": discovery, **opened}
    return chat(name, ros2, distro="jazzy", talker=talker, listener=LISTEN)


def cyclone_dds(name: str) -> dict[str, Any]:
    """With the operator's peers for the talker; the listener is of another middleware and names its peer itself."""
    variables = ["RMW_IMPLEMENTATION=rmw_fastrtps_cpp", f"ROS_STATIC_PEERS=talker.{child_name(name, '', PEERS)}"]
    talker = part("talker", "edge-1", ["python3", "-m", "ros_nodes.dds_talker", TOPIC], "ros2")
    ros2 = {"rmw": "rmw_cyclonedds_cpp", "discovery": {"mode": "Peers"}}
    return chat(name, ros2, distro="lyrical", talker=talker, listener=["env", *variables, *LISTEN])


def zenoh(name: str) -> dict[str, Any]:
    """With the operator's router, from the image of the first component, as every app with Zenoh has it."""
    talker = part("talker", "edge-1", ["python3", "-m", "ros_nodes.zenoh.talker", TOPIC], "zenoh")
    listener = ["python3", "-m", "ros_nodes.zenoh.listener", TOPIC]
    return chat(name, {"rmw": "rmw_zenoh_cpp"}, distro="jazzy", talker=talker, listener=listener, image="zenoh")


CHATS = {
    "server": fast_dds(
        "server",
        external={"expose": "NodePort"},
        mode="Server",
        image=images.reference("jazzy"),
        imagePullPolicy="IfNotPresent",
    ),
    "peers": fast_dds("peers", mode="Peers"),
    "cyclone": cyclone_dds("cyclone"),
    "zenoh": zenoh("zenoh"),
}


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    """All apps start at once."""
    nodes, delays = [robot("robot-1"), edge("edge-1")], {("robot-1", "edge-1"): 2}
    with real_machine(nodes, delays=delays, images=("jazzy", "ros2", "zenoh", "ros1"), kube_scheduler=True) as cp:
        product.install(cp)
        product.start_operator(cp)
        product.start_scheduler(cp)
        with created(cp, PLACE):
            pair = teleop.app("pair", ros=1, nodes={"operator": "edge-1", "robot": "robot-1"})
            teleop.apply(cp, PLACE, [pair, *CHATS.values()])
            yield cp


def is_ready(cp: RealNodes, app: str) -> bool:
    """Whether the app's listener is ready."""
    pod = teleop.pods(cp, PLACE, app).get("listener", {"status": {}})
    return any(each["type"] == "Ready" and each["status"] == "True" for each in pod["status"].get("conditions", ()))


def run_in(cp: RealNodes, app: str, component: str, line: str, *, program: str = "sh") -> str:
    """Runs a line in a shell in the component's container."""
    pod = teleop.pods(cp, PLACE, app)[component]["metadata"]["name"]
    return cp.kubectl("exec", "-n", PLACE, pod, "-c", component, "--", program, "-c", line)


def list_ready(cp: RealNodes, wanted: Sequence[str], *, within_s: float) -> list[str]:
    """Returns the apps whose listener is ready, when they are these or the time has passed."""
    wait_until(lambda: [app for app in CHATS if is_ready(cp, app)] == wanted, timeout_s=within_s, poll_s=0.2)
    return [app for app in CHATS if is_ready(cp, app)]


def test_readiness_follows_messages_with_servers_with_peers_with_cyclone_dds_and_with_a_zenoh_router(
    cluster: RealNodes,
) -> None:
    ready = list_ready(cluster, list(CHATS), within_s=STARTED_S)
    assert ready == list(CHATS), [read_pods(cluster, app) for app in CHATS if app not in ready]
    for line, wanted in (("touch /tmp/silence", []), ("rm /tmp/silence", list(CHATS))):
        for app in CHATS:
            run_in(cluster, app, "talker", line)
        allowed_s, began_s = FOLLOWS_S * slowness(seconds=0.2), time.monotonic()
        assert list_ready(cluster, wanted, within_s=allowed_s) == wanted, line
        logger.info("%s: all follow in %.1f s of %.1f s", line, time.monotonic() - began_s, allowed_s)


def read_pods(cp: RealNodes, app: str) -> str:
    """What kubectl shows of an app's pods and their last lines, for a failure's message."""
    selector = f"robotics.io/app={app}"
    pods = cp.kubectl("get", "pods", "-n", PLACE, "-l", selector, "-o", "wide")
    events = cp.kubectl("get", "events", "-n", PLACE, "--field-selector=type=Warning")
    return "\n".join((pods, events, cp.kubectl("logs", "-n", PLACE, "-l", selector, "--tail=8", "--prefix")))


@pytest.mark.parametrize("app", ["server", "peers"])
def test_a_sidecar_hears_its_component_and_a_shell_sees_the_graph(cluster: RealNodes, app: str) -> None:
    assert wait_until(lambda: is_ready(cluster, app), timeout_s=STARTED_S, poll_s=0.2)
    pod = teleop.pods(cluster, PLACE, app)["talker"]["metadata"]["name"]
    assert wait_until(
        lambda: "heard" in cluster.kubectl("logs", "-n", PLACE, pod, "-c", "sidecar"), timeout_s=FOLLOWS_S
    )
    listed = f"{SOURCE}; ROS_SUPER_CLIENT=TRUE python3 -m ros_nodes.chatter topics 3"
    assert f"{TOPIC} std_msgs/msg/String" in run_in(cluster, app, "listener", listed, program="bash").splitlines()
    echoed = f"{SOURCE}; python3 -m ros_nodes.chatter listener {TOPIC} | head -n 1"
    assert "heard" in run_in(cluster, app, "listener", echoed, program="bash")


def test_a_laptop_outside_of_the_cluster_hears_a_robot_and_is_heard(cluster: RealNodes) -> None:
    assert wait_until(lambda: is_ready(cluster, "server"), timeout_s=STARTED_S, poll_s=0.2)
    laptop = cluster.add_outsider("laptop", image="jazzy")
    variables = laptop_variables(cluster, "server")
    allowed_s, began_s = JOINS_S * slowness(), time.monotonic()
    hears = f"{SOURCE_JAZZY}; python3 -m ros_nodes.chatter listener {TOPIC} | head -n 1"
    assert "heard" in laptop.run(f"timeout {allowed_s:.0f} bash -c '{hears}'", variables)
    logger.info("the laptop heard the robot after %.1f s of %.1f s", time.monotonic() - began_s, allowed_s)
    laptop_talker = laptop.program(
        "talker", f"{SOURCE_JAZZY}; exec python3 -m ros_nodes.chatter talker /laptop", variables
    )
    laptop_talker.start()
    began_s = time.monotonic()
    heard = f"{SOURCE}; timeout {allowed_s:.0f} python3 -m ros_nodes.chatter listener /laptop | head -n 1"
    assert "heard" in run_in(cluster, "server", "talker", heard, program="bash")
    logger.info("the robot heard the laptop after %.1f s of %.1f s", time.monotonic() - began_s, allowed_s)
    laptop_talker.kill()


def test_only_the_addresses_of_the_servers_let_a_laptop_in(cluster: RealNodes) -> None:
    """The number of the domain does not keep anybody out: Fast DDS' servers introduce participants of all domains."""
    assert wait_until(lambda: is_ready(cluster, "server"), timeout_s=STARTED_S, poll_s=0.2)
    laptop = cluster.add_outsider("stranger", image="jazzy")
    variables = laptop_variables(cluster, "server")
    listed = f"{SOURCE_JAZZY}; python3 -m ros_nodes.chatter topics 5"
    without_servers = {name: value for name, value in variables.items() if name != "ROS_DISCOVERY_SERVER"}
    assert TOPIC not in laptop.run(listed, without_servers)
    assert TOPIC in laptop.run(listed, {**variables, "ROS_DOMAIN_ID": "200"})


def laptop_variables(cp: RealNodes, app: str) -> dict[str, str]:
    """Returns what docs/how-to/reach-a-component.md has a user set on a laptop, with the addresses of the status."""
    path = f"/apis/robotics.io/v1alpha1/namespaces/{PLACE}/robotappinstances?labelSelector=robotics.io/app={app}"

    def read_addresses() -> dict[str, str]:
        (instance,) = cp.api.get(path)["items"]
        return {link["component"]: link["url"] for link in instance["status"].get("links", ())}

    assert wait_until(lambda: len(read_addresses()) == 2, timeout_s=STARTED_S), read_addresses()
    addresses = read_addresses()
    return {
        "PATH": "/usr/bin:/bin",
        "PYTHONPATH": "/opt/robotapp",
        "HOME": "/tmp",  # noqa: S108 - within the image
        "ROS_DOMAIN_ID": str(teleop.domain(cp, PLACE, app)),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_DISCOVERY_SERVER": f"{addresses['discovery-0']};{addresses['discovery-1']}",
        "ROS_SUPER_CLIENT": "TRUE",
    }


@pytest.mark.parametrize("how", ["pod", "container"])
def test_a_pair_of_ros_1_talks_again_after_its_master_was_started_anew(cluster: RealNodes, how: str) -> None:
    assert wait_until(lambda: bool(teleop.trips(cluster, PLACE, "pair")), timeout_s=STARTED_S, poll_s=0.2)
    before = uids_of_pair(cluster)
    time.sleep(START_LEAD.total_seconds() + 1)
    allowed_s, began_s = HEALS_S * slowness(), time.monotonic()
    lose_master(cluster, how)

    def talks_anew() -> bool:
        return len(uids_of_pair(cluster) - before) == 2 and bool(teleop.trips(cluster, PLACE, "pair"))

    assert wait_until(talks_anew, timeout_s=allowed_s, poll_s=0.2)
    logger.info("the master's %s: talks again after %.1f s of %.1f s", how, time.monotonic() - began_s, allowed_s)
    path = f"/apis/events.k8s.io/v1/namespaces/{PLACE}/events"

    def read_notes() -> list[str]:
        return [each["note"] for each in cluster.api.get(path)["items"] if each["reason"] == "MasterRestarted"]

    assert wait_until(lambda: bool(read_notes()), timeout_s=10)
    assert read_notes()[0].endswith("operator, robot restarted")


def uids_of_pair(cp: RealNodes) -> set[str]:
    return {pod["metadata"]["uid"] for pod in teleop.pods(cp, PLACE, "pair").values()}


def lose_master(cp: RealNodes, how: str) -> None:
    """Deletes the pod of the pair's master, or ends its container."""
    selector = "robotics.io/app=pair,robotics.io/role=master"
    (pod,) = cp.api.get(f"/api/v1/namespaces/{PLACE}/pods?labelSelector={selector}")["items"]
    if how == "pod":
        cp.kubectl("delete", "pod", "-n", PLACE, pod["metadata"]["name"], "--wait=false")
    else:
        (container,) = pod["status"]["containerStatuses"]
        cp.node(pod["spec"]["nodeName"]).kill_container(container["containerID"])
