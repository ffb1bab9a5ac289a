"""The demo as a guest in somebody's own cluster: here a control plane without simulated nodes plays that cluster."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from journeys import demo, steps
from journeys.stage import Stage
from robotapp_testbed import ControlPlane, TestbedError, wait_until
from robotapp_testbed.control_plane import guest
from robotapp_testbed.control_plane.guest import GuestPlane
from robotapp_testbed.control_plane.servers import Program

pytestmark = pytest.mark.live

KINDS = (
    "namespaces,nodes,customresourcedefinitions,clusterroles,clusterrolebindings,roles,rolebindings,serviceaccounts,pods,"
    "configmaps,validatingadmissionpolicies,validatingadmissionpolicybindings"
)
LATE = "configmap/kube-apiserver-legacy-service-account-token-tracking"
"""Which the API server makes a moment after it serves."""


@pytest.fixture(scope="module")
def cluster() -> Iterator[ControlPlane]:
    with ControlPlane(kwok=False, kube_scheduler=True) as plane:
        assert wait_until(lambda: complete(plane), timeout_s=60, poll_s=0.2), inventory(plane)
        yield plane


def complete(cluster: ControlPlane) -> bool:
    """Whether the cluster's own programs have made what they make a moment after their start."""
    there = inventory(cluster)
    maps = cluster.kubectl("get", "configmaps", "--all-namespaces", "--no-headers", "-o", "name").split()
    accounts = cluster.kubectl("get", "serviceaccounts", "--all-namespaces", "--no-headers", "-o", "name").split()
    namespaces = sum(name.startswith("namespace/") for name in there)
    per_namespace = (maps.count("configmap/kube-root-ca.crt"), accounts.count("serviceaccount/default"))
    return per_namespace == (namespaces, namespaces) and LATE in there


def inventory(cluster: ControlPlane) -> set[str]:
    listed = cluster.kubectl("get", KINDS, "--all-namespaces", "--no-headers", "-o", "name")
    return set(listed.split())


def guest_of(cluster: ControlPlane, *nodes: str) -> GuestPlane:
    return GuestPlane(cluster.kubeconfig(), nodes=nodes, namespaces=demo.NAMESPACES)


def test_an_app_becomes_ready_there_and_the_cluster_is_left_as_it_was(
    cluster: ControlPlane, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demo, "STORY", (steps.apply_teleop,))
    # What may take two seconds on an idle machine is measured there (`scripts/bench apply`); here others run as well.
    monkeypatch.setattr(steps, "READY_LIMIT_S", 60.0)
    wait_for_collector = GuestPlane.learn_new_kinds

    def learn(plane: GuestPlane) -> None:
        cluster.process(Program.CONTROLLER_MANAGER).restart()  # a user's cluster needs up to 30 s instead
        wait_for_collector(plane)

    monkeypatch.setattr(GuestPlane, "learn_new_kinds", learn)
    before = inventory(cluster)
    stage = Stage()
    with guest_of(cluster) as plane, ExitStack() as stack:
        demo._tell_on(stage, plane, stack)
        assert "node/amr-07" in inventory(cluster)
    assert stage.held == 4
    assert inventory(cluster) == before


def test_what_exists_is_never_touched(cluster: ControlPlane) -> None:
    before = inventory(cluster)
    cluster.kubectl("create", "namespace", "demo")
    try:
        with pytest.raises(TestbedError, match=r"already has namespace/demo\. It would change what is there"):
            guest_of(cluster).start()
    finally:
        cluster.kubectl("delete", "namespace", "demo")
    assert inventory(cluster) == before


def test_a_killed_guest_is_removed_by_down(cluster: ControlPlane, tmp_path: Path) -> None:
    before = inventory(cluster)
    log = tmp_path / "demo.log"
    command = [sys.executable, "-m", "journeys.demo", "--once", f"--kubeconfig={cluster.kubeconfig()}"]
    with log.open("wb") as output:
        story = subprocess.Popen(command, stdout=output, stderr=output)
        assert wait_until(lambda: "namespace/robotapp-system" in inventory(cluster), timeout_s=120, poll_s=0.2)
        os.kill(story.pid, signal.SIGKILL)
        story.wait()
    with pytest.raises(TestbedError, match="An earlier run was killed before it could clean up"):
        guest_of(cluster).start()
    assert guest.remove(cluster.kubeconfig(), namespaces=demo.NAMESPACES)
    assert inventory(cluster) == before
    assert not guest.remove(cluster.kubeconfig(), namespaces=demo.NAMESPACES)
