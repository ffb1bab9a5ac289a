"""Faults of nodes and their programs; those that an app and its claims must outlive are in test_faults_of_apps.py."""

from collections.abc import Iterator

import pytest
from tests.support.work_unit import slowness

from campaigns.nodes import real_pods
from campaigns.nodes.real_pods import pod
from robotapp_testbed import wait_until
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

NOTICED_S = 90.0
RECOVERED_S = 120.0


@pytest.fixture
def whole(real_nodes: RealNodes) -> Iterator[RealNodes]:
    """The session's nodes, all Ready before and after."""
    yield real_nodes
    real_nodes.wait_nodes()


def is_lost(cp: RealNodes, name: str) -> bool:
    return name not in cp.ready_nodes()


def goes_and_comes(cp: RealNodes, name: str) -> None:
    """Wait until the node is seen as lost; the caller brings it back and calls `wait_nodes`."""
    assert wait_until(lambda: is_lost(cp, name), timeout_s=NOTICED_S, poll_s=0.1)


def test_pods_outlive_their_container_runtime(whole: RealNodes, real_namespace: str) -> None:
    real_pods.run(whole, real_namespace, pod("stays", "edge-1"))
    before = real_pods.container(whole, real_namespace, "stays")
    node = whole.node("edge-1")
    node.containerd.restart()
    real_pods.run(whole, real_namespace, pod("next", "edge-1"))
    after = real_pods.container(whole, real_namespace, "stays")
    assert (after["containerID"], after["restartCount"]) == (before["containerID"], 0)


def test_a_node_that_crashes_comes_back_and_starts_its_pods_again(whole: RealNodes, real_namespace: str) -> None:
    real_pods.run(whole, real_namespace, pod("here", "robot-1"), pod("there", "edge-1"))
    whole.node("edge-1").crash()
    goes_and_comes(whole, "edge-1")
    whole.node("edge-1").restart()
    whole.wait_nodes(timeout_s=RECOVERED_S)
    assert real_pods.await_restart(whole, real_namespace, "there", above=0)
    target = real_pods.address(whole, real_namespace, "there")
    assert (
        real_pods.round_trip_ms(whole, real_namespace, "here", target) < 100 * slowness()
    )  # plugged into the switch again
    assert real_pods.container(whole, real_namespace, "here")["restartCount"] == 0


def test_a_kubelet_that_hangs_is_noticed_and_goes_on(whole: RealNodes) -> None:
    kubelet = whole.node("edge-1").kubelet
    kubelet.pause()
    try:
        goes_and_comes(whole, "edge-1")
    finally:
        kubelet.resume()
    whole.wait_nodes(timeout_s=RECOVERED_S)
    assert kubelet.rss_bytes() > 20e6
