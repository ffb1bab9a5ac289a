"""Faults of nodes: what runs goes on where it can, and the cluster's view recovers."""

from collections.abc import Iterator

import pytest
from tests.support import real_pods
from tests.support.real_pods import pod

from robotapp_testbed import wait_until
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

NOTICED_S = 20.0
RECOVERED_S = 30.0


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


def test_pods_outlive_their_kubelet(whole: RealNodes, real_namespace: str) -> None:
    real_pods.run(whole, real_namespace, pod("stays", "edge-1"))
    before = real_pods.container(whole, real_namespace, "stays")
    node = whole.node("edge-1")
    node.kubelet.kill()
    goes_and_comes(whole, "edge-1")
    assert before["containerID"].rpartition("/")[2] in node.ctr("tasks", "list")
    node.kubelet.start()
    whole.wait_nodes(timeout_s=RECOVERED_S)
    after = real_pods.container(whole, real_namespace, "stays")
    assert (after["containerID"], after["restartCount"]) == (before["containerID"], 0)


def test_pods_outlive_their_container_runtime(whole: RealNodes, real_namespace: str) -> None:
    real_pods.run(whole, real_namespace, pod("stays", "edge-1"))
    before = real_pods.container(whole, real_namespace, "stays")
    node = whole.node("edge-1")
    node.containerd.restart()
    real_pods.run(whole, real_namespace, pod("next", "edge-1"))
    after = real_pods.container(whole, real_namespace, "stays")
    assert (after["containerID"], after["restartCount"]) == (before["containerID"], 0)


def test_a_node_that_is_cut_off_goes_on_and_is_seen_again(whole: RealNodes, real_namespace: str) -> None:
    real_pods.run(whole, real_namespace, pod("here", "robot-1"), pod("there", "edge-1"))
    before = real_pods.container(whole, real_namespace, "here")
    address = real_pods.address(whole, real_namespace, "here")
    node = whole.node("robot-1")
    node.cut_off()
    try:
        goes_and_comes(whole, "robot-1")
        assert real_pods.round_trip_ms(whole, real_namespace, "there", address) < 100  # its pods' network still works
    finally:
        node.reconnect()
    whole.wait_nodes(timeout_s=RECOVERED_S)
    after = real_pods.container(whole, real_namespace, "here")
    assert (after["containerID"], after["restartCount"]) == (before["containerID"], 0)


def test_a_node_that_crashes_comes_back_and_starts_its_pods_again(whole: RealNodes, real_namespace: str) -> None:
    real_pods.run(whole, real_namespace, pod("here", "robot-1"), pod("there", "edge-1"))
    whole.node("edge-1").crash()
    goes_and_comes(whole, "edge-1")
    whole.node("edge-1").restart()
    whole.wait_nodes(timeout_s=RECOVERED_S)
    assert real_pods.await_restart(whole, real_namespace, "there", above=0)
    target = real_pods.address(whole, real_namespace, "there")
    assert real_pods.round_trip_ms(whole, real_namespace, "here", target) < 100  # plugged into the switch again
    assert real_pods.container(whole, real_namespace, "here")["restartCount"] == 0


def test_a_killed_container_is_started_again_in_its_pod(whole: RealNodes, real_namespace: str) -> None:
    real_pods.run(whole, real_namespace, pod("again", "robot-1"))
    address = real_pods.address(whole, real_namespace, "again")
    whole.node("robot-1").kill_container(real_pods.container(whole, real_namespace, "again")["containerID"])
    assert real_pods.await_restart(whole, real_namespace, "again", above=0)
    assert real_pods.address(whole, real_namespace, "again") == address


def test_pods_outlive_the_api_server(whole: RealNodes, real_namespace: str) -> None:
    real_pods.run(whole, real_namespace, pod("stays", "edge-1"))
    before = real_pods.container(whole, real_namespace, "stays")
    whole.process("kube-apiserver").restart()
    whole.wait_nodes(timeout_s=RECOVERED_S)
    real_pods.run(whole, real_namespace, pod("next", "edge-1"))
    after = real_pods.container(whole, real_namespace, "stays")
    assert (after["containerID"], after["restartCount"]) == (before["containerID"], 0)


def test_a_kubelet_that_hangs_is_noticed_and_goes_on(whole: RealNodes) -> None:
    kubelet = whole.node("edge-1").kubelet
    kubelet.pause()
    try:
        goes_and_comes(whole, "edge-1")
    finally:
        kubelet.resume()
    whole.wait_nodes(timeout_s=RECOVERED_S)
    assert kubelet.rss_bytes() > 20e6
