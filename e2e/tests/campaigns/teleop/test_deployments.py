"""One deployment on a cluster that is made by hand: what is applied, read and removed, and what its pods tell."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import pytest

from campaigns.teleop import apps, deployments, metrics
from campaigns.teleop.cluster import Site
from campaigns.teleop.deployments import Attempt
from campaigns.teleop.design import FAR, NEAR, ROBOT, Arm, Condition, Turn
from campaigns.teleop.metrics import LOST_MS
from robotapp_testbed.failures import TestbedError

TURN = Turn(7, 3, Condition(2, ballast=False, worse_link=False), Arm.OURS)
DISCOVERY = "fast-discovery"


def pod(name: str, component: str, node: str = "") -> dict[str, Any]:
    labels = {"robotics.io/app": "teleop-7", **({"robotics.io/component": component} if component else {})}
    statuses = [{"containerID": f"containerd://{name}", "restartCount": 1 if name == DISCOVERY else 0}]
    return {
        "metadata": {"name": name, "uid": name, "labels": labels, "creationTimestamp": name},
        "spec": {"nodeName": node} if node else {},
        "status": {"containerStatuses": statuses},
    }


class FakeCluster:
    """API server and nodes in one. Pods go when their containers are killed; the operator's file is in `folder`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.pods = [pod("robot", "robot", ROBOT), pod("operator", apps.OPERATOR, NEAR), pod(DISCOVERY, "", FAR)]
        self.killed: list[str] = []
        self.fault = ""
        self.created: dict[str, Any] = {}

    @property
    def api(self) -> "FakeCluster":
        return self

    def create(self, path: str, app: Mapping[str, Any]) -> None:
        assert path.endswith("/namespaces/eo2/robotapps")
        self.created = dict(app)

    def get(self, path: str) -> dict[str, Any]:
        assert path.endswith("/namespaces/eo2/pods?labelSelector=robotics.io/app=teleop-7")
        return {"items": [one for one in self.pods if one["metadata"]["name"] not in self.killed]}

    def delete(self, path: str) -> None:
        assert path.endswith("/robotapps/teleop-7")
        self.pods = [one for one in self.pods if one["spec"]]  # nothing holds a pod without a node
        for one in self.pods:
            one["metadata"]["deletionTimestamp"] = "now"

    def node(self, name: str) -> "FakeCluster":
        assert name in {one["spec"].get("nodeName") for one in self.pods}
        return self

    def empty_dir(self, uid: str, volume: str) -> Path:
        assert (uid, volume) == ("operator", "results")
        return self.folder

    def kill_container(self, container_id: str) -> None:
        name = container_id.removeprefix("containerd://")
        self.killed.append(name)
        if name == "robot":
            raise TestbedError("no such task")

    @property
    def cp(self) -> "FakeCluster":
        return self

    def find_fault(self) -> str:
        return self.fault


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeCluster:
    monkeypatch.setattr(metrics, "SETTLE_S", 0.05)
    monkeypatch.setattr(metrics, "WINDOW_S", 0.1)
    monkeypatch.setattr(metrics, "NO_TRIP_S", 0.3)
    monkeypatch.setattr(deployments, "_TAIL_S", 0.0)
    return FakeCluster(tmp_path)


def deploy(cluster: FakeCluster) -> deployments.Deployment:
    return Attempt(cast(Site, cluster), TURN, session=2).run()


def test_a_deployment_is_applied_read_and_removed(cluster: FakeCluster) -> None:
    begun_s = time.time()
    rows = [f"{begun_s + 0.05 * number:.9f},{6.5 if number else ''}\n" for number in range(4)]
    (cluster.folder / apps.FILE).write_text("sent_s,rtt_ms\n" + "".join(rows))
    deployment = deploy(cluster)
    assert cluster.created["metadata"] == {"name": "teleop-7"}
    assert sorted(cluster.killed) == [DISCOVERY, "operator", "robot"]
    assert (deployment.turn, deployment.session, deployment.node, deployment.void) == (TURN, 2, NEAR, "")
    assert (deployment.helpers, deployment.restarts) == ({DISCOVERY: FAR}, 1)
    assert deployment.trips_ms == (6.5, 6.5)
    assert deployment.figures is not None
    assert abs(deployment.figures.first_trip_s - 0.0565) < 0.05
    assert deployment.load is not None


def test_a_deployment_without_a_round_trip_is_given_up_and_removed(cluster: FakeCluster) -> None:
    cluster.pods[1]["spec"].clear()  # it found no node
    deployment = deploy(cluster)
    assert (deployment.node, deployment.load, deployment.trips_ms) == ("", None, ())
    assert deployment.figures is not None
    assert (deployment.figures.missed_share, deployment.figures.p50_ms) == (1.0, LOST_MS)


def test_a_deployment_on_a_broken_site_is_void(cluster: FakeCluster) -> None:
    cluster.fault = "edge-2 not Ready"
    assert deploy(cluster).void == "edge-2 not Ready"


def test_the_newest_operator_counts_and_helpers_are_what_is_no_component() -> None:
    pods = [pod("o1", "operator", NEAR), pod("r", "robot", ROBOT), pod("d", "", FAR), pod("o2", "operator", FAR)]
    assert deployments.find_operator_node(pods) == FAR
    assert deployments.list_helper_nodes(pods) == {"d": FAR}
    assert deployments.find_operator_node([pod("o1", "operator")]) == ""
    assert deployments.find_operator_node([]) == ""
