"""Real nodes come and go, whatever ends them, and leave the machine as it was; several clusters live side by side."""

import random
from pathlib import Path

import pytest
from tests.support.work_unit import slowness

from campaigns.nodes import machine_census, nodes, real_pods
from campaigns.nodes.real_pods import pod
from robotapp_testbed import TestbedError
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

NAMES = ("robot-1", "robot-2", "edge-1", "cloud-1")


@pytest.mark.usefixtures("real_machine")
def test_up_and_down_again_and_again_leaves_the_machine_as_it_was() -> None:
    slow = slowness()
    lives = [nodes.live(NAMES) for _ in range(3)]
    assert [each.left for each in lives] == [{}, {}, {}]
    # Twice what is allowed on an idle machine, which scripts/bench nodes holds against it: here others may run as well.
    allowed = 2 * max(slow, slowness())
    assert min(each.up_s for each in lives) < allowed * nodes.UP_S
    assert min(each.down_s for each in lives) < allowed * nodes.DOWN_S


@pytest.mark.usefixtures("real_machine")
@pytest.mark.parametrize("moment", range(3))
def test_an_owner_killed_at_any_moment_leaves_nothing_and_the_next_up_works(moment: int) -> None:
    strike = nodes.kill(["robot-1", "edge-1"], random.uniform(2.0 * moment, 2.0 * moment + 2.0))
    assert strike.left == {}, strike


def test_two_clusters_do_not_disturb_each_other(real_nodes: RealNodes, real_namespace: str) -> None:
    real_pods.run(real_nodes, real_namespace, pod("stays", "robot-1"))
    mine = real_pods.container(real_nodes, real_namespace, "stays")
    with RealNodes(["robot-1", "edge-1"]) as other:
        real_pods.run(other, "default", pod("stays", "robot-1"))
        # Both clusters have the same pod network, so the same addresses: none reaches the other's.
        assert real_pods.address(other, "default", "stays").startswith("10.244.1.")
        assert other.addresses.host_ip != real_nodes.addresses.host_ip
        names = {item["metadata"]["name"] for item in real_nodes.api.get("/api/v1/pods")["items"]}
        assert len(names & {"stays"}) == 1
    with other:  # what was ended starts again, with nothing of its first life
        assert other.ready_nodes() == {"robot-1", "edge-1"}
        assert other.api.get("/api/v1/namespaces/default/pods")["items"] == []
    assert real_pods.container(real_nodes, real_namespace, "stays")["containerID"] == mine["containerID"]
    real_nodes.wait_nodes()


def test_a_start_that_fails_leaves_nothing(real_machine: type[RealNodes]) -> None:
    before = machine_census.take()
    plane = real_machine(["robot-1"], extra_args={"kube-apiserver": ["--no-such-flag"]})
    with pytest.raises(TestbedError, match="unknown flag: --no-such-flag"):
        plane.start()
    assert machine_census.left_since(before) == {}


def test_settings_of_the_machine_are_only_pretended_inside(real_nodes: RealNodes) -> None:
    box = real_nodes.node("robot-1").box
    asked_for = {"vm/overcommit_memory": "1", "kernel/panic": "10", "kernel/panic_on_oops": "1"}
    assert {name: box.run("/bin/cat", f"/proc/sys/{name}").strip() for name in asked_for} == asked_for
    assert Path("/proc/sys/kernel/panic").read_text().strip() != "10"
