"""A recording of a real topic on real nodes: rclpy subscriptions, MCAP on disk, a killed recorder, and the bags pulled by kubectl robotapp."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import Reader
from tests.support.work_unit import slowness

from campaigns.nodes import teleop_app as teleop
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

PLACE = "recordings"
TOPIC = "/chatter"
STARTED_S = 90.0
RECORDED_S = 20.0
CHUNK_S = 1.0
PERIOD_S = 0.1
"""Time between two messages of the talker."""
IMAGE = {"image": images.reference("jazzy"), "imagePullPolicy": "IfNotPresent"}
TALKER = {
    "name": "talker",
    **IMAGE,
    "args": ["python3", "-m", "ros_nodes.chatter", "talker", TOPIC],
    "template": {"spec": {"nodeSelector": {"kubernetes.io/hostname": "edge-1"}}},
}
SPEC = {
    "ros": {"distro": "jazzy"},
    "ros2": {"discovery": IMAGE},
    "components": [TALKER],
    "recordings": [
        {
            "name": "all",
            "topics": {"regex": ".*", "exclude": "/rosout|/parameter_events"},
            "split": {"size": "1Mi", "duration": "3s"},
            "retain": {"size": "8Mi"},
            **IMAGE,
        }
    ],
}
APP = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": "rec"}, "spec": SPEC}


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes, delays = [robot("robot-1"), edge("edge-1")], {("robot-1", "edge-1"): 2}
    with real_machine(nodes, delays=delays, images=("jazzy",), kube_scheduler=True) as cp:
        product.install(cp)
        product.start_operator(cp)
        product.start_scheduler(cp)
        with created(cp, PLACE):
            teleop.apply(cp, PLACE, [APP])
            yield cp


def run_bags(cp: RealNodes, *arguments: str) -> str:
    """What `kubectl robotapp bags …` prints."""
    command = [sys.executable, "-c", "from robotapp_cli.main import main; main()", "bags", *arguments]
    path = f"{cp.bin_dir}{os.pathsep}{os.environ['PATH']}"
    access = ["-n", PLACE, f"--kubeconfig={cp.kubeconfig('admin')}"]
    result = subprocess.run(
        [*command, *access], capture_output=True, text=True, check=False, env={**os.environ, "PATH": path}
    )
    return result.stdout + result.stderr


def read_numbers(path: Path) -> list[int]:
    """The numbers that the talker sent, from its strings."""
    with Reader(path) as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == (TOPIC, "std_msgs/msg/String")
        assert "string data" in connection.msgdef.data
        return [parse_number(bytes(data)) for _, _, data in reader.messages()]


def parse_number(data: bytes) -> int:
    """The text of a serialized `std_msgs/msg/String`: a head of 4 bytes, its length with the zero at its end, and padding."""
    length = int.from_bytes(data[4:8], "little")
    return int(data[8 : 8 + length - 1])


def read_pod(cp: RealNodes) -> dict[str, Any]:
    return teleop.pods(cp, PLACE, "rec").get("all", {"status": {}, "metadata": {"name": "-"}})


def count_restarts(cp: RealNodes) -> int:
    return sum(each["restartCount"] for each in read_pod(cp)["status"].get("containerStatuses", ()))


def test_a_killed_recorder_keeps_what_it_recorded_and_its_bags_are_pulled(cluster: RealNodes, tmp_path: Path) -> None:
    def shows(text: str) -> bool:
        return text in run_bags(cluster, "list", "rec")

    assert wait_until(lambda: shows("closed"), timeout_s=STARTED_S + RECORDED_S * slowness(), poll_s=1.0), run_bags(
        cluster, "list", "rec"
    )
    pod = read_pod(cluster)
    (container,) = pod["status"]["containerStatuses"]
    cluster.node(pod["spec"]["nodeName"]).kill_container(container["containerID"])
    assert wait_until(lambda: count_restarts(cluster) == 1, timeout_s=RECORDED_S * slowness(), poll_s=0.5)

    def logs() -> str:
        return cluster.kubectl("logs", "-n", PLACE, pod["metadata"]["name"])

    assert wait_until(lambda: f"recording {TOPIC}" in logs(), timeout_s=RECORDED_S * slowness(), poll_s=0.5), logs()
    assert "messages of a recorder that was killed are kept" in logs()
    time.sleep(3 + CHUNK_S)  # so that the new recorder closes a bag
    assert wait_until(lambda: run_bags(cluster, "list", "rec").count("closed") >= 3, timeout_s=RECORDED_S * slowness())

    told = run_bags(cluster, "pull", "rec", "--to", str(tmp_path))
    paths = sorted(tmp_path.glob("*.mcap"))
    assert len(paths) >= 3, told
    lives = [read_numbers(path) for path in paths]
    numbers = [number for life in lives for number in life]
    assert numbers == sorted(set(numbers))
    assert all(life == list(range(life[0], life[-1] + 1)) for life in lives), "no gap within a bag"
    newest = paths[-1].name
    assert f"{len(lives[-1])} messages" in run_bags(cluster, "info", "rec", newest)
    assert "is there already" in run_bags(cluster, "pull", "rec", newest, "--to", str(tmp_path))
