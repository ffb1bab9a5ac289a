"""Components in the network of their node, and sidecars, on real nodes: they find the others and are found, by real DDS and real ROS 1."""

import time
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.nodes import teleop_app as teleop
from robotapp_testbed import images, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import edge, robot
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

FOUND_S = 60.0


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes = [robot("robot-1"), edge("edge-1")]
    with real_machine(nodes, delays={}, images=("tools", *teleop.IMAGES), kube_scheduler=True) as cp:
        product.install(cp)
        product.start_operator(cp)
        product.start_scheduler(cp)
        yield cp


@pytest.fixture
def place(cluster: RealNodes) -> Iterator[str]:
    with created(cluster, f"host-{time.monotonic_ns() % 100_000}") as name:
        yield name


def pair(name: str, *, ros: int, hosted: tuple[str, ...]) -> dict[str, Any]:
    """The teleoperation pair on two nodes, some of it in the network of its node, with a sidecar that prints its domain."""
    app = teleop.app(name, ros=ros, nodes={"operator": "edge-1", "robot": "robot-1"})
    for component in app["spec"]["components"]:
        pod = component["template"]["spec"]
        pod["hostNetwork"] = component["name"] in hosted
        line = 'echo "domain $ROS_DOMAIN_ID master $ROS_MASTER_URI"; exec sleep 100000'
        sidecar = {"name": "beside", "image": images.reference("tools"), "imagePullPolicy": "IfNotPresent"}
        pod["containers"] = [sidecar | {"command": ["sh", "-c", line]}]
    return app


@pytest.mark.parametrize("ros", [2, 1])
@pytest.mark.parametrize("hosted", [("robot",), ("operator", "robot")], ids=["one", "both"])
def test_components_find_each_other_across_the_networks_of_nodes_and_pods(
    cluster: RealNodes, place: str, ros: int, hosted: tuple[str, ...]
) -> None:
    name = f"pair-{ros}-{len(hosted)}"
    teleop.apply(cluster, place, [pair(name, ros=ros, hosted=hosted)])
    assert teleop.silent(cluster, place, [name], within_s=FOUND_S) == []
    for component, pod in teleop.pods(cluster, place, name).items():
        node = {"operator": "edge-1", "robot": "robot-1"}[component]
        assert (pod["status"]["podIP"] == cluster.node(node).ip) is (component in hosted)

    def said() -> str:
        pod_name = teleop.pods(cluster, place, name)["robot"]["metadata"]["name"]
        return cluster.kubectl("logs", "-n", place, pod_name, "-c", "beside", check=False)

    expected = f"domain {teleop.domain(cluster, place, name)} " if ros == 2 else "master http://"
    assert wait_until(lambda: expected in said(), timeout_s=FOUND_S), said()
