"""Pods of higher priority make room on a real API server: who goes, what users read, and what survives a restart."""

from collections.abc import Iterator

import pytest

from campaigns.rigs.stage import Json, Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live
CLASSES = "/apis/scheduling.k8s.io/v1/priorityclasses"
PRIORITIES = {"live-low": 10, "live-middle": 100, "live-high": 1000, "live-polite": 1000}


@pytest.fixture(scope="module", autouse=True)
def priorities(installed_plane: ControlPlane) -> Iterator[None]:
    for name, value in PRIORITIES.items():
        policy = {"preemptionPolicy": "Never"} if name == "live-polite" else {}
        installed_plane.api.create(CLASSES, {"metadata": {"name": name}, "value": value, **policy})
    yield
    for name in PRIORITIES:
        installed_plane.api.delete(f"{CLASSES}/{name}")


def ranked(name: str, priority: str, cpu: str, **fields: object) -> Json:
    return pod(name, requests={"cpu": cpu}, priorityClassName=f"live-{priority}", **fields)  # type: ignore[arg-type]


def own(stage: Stage, number: int = 1) -> str:
    """A node name no other test has used: pods of other tests may still be on theirs."""
    return f"edge-{stage.namespace}-{number}"


def gone(stage: Stage, name: str) -> bool:
    try:
        stage.pod(name)
    except ApiStatusError as error:
        return error.status == 404
    return False


def wait_running(stage: Stage, name: str) -> None:
    stage.wait(lambda: stage.pod(name)["status"]["phase"] == "Running", what=lambda: f"{name} does not run")


@pytest.mark.usefixtures("scheduler")
def test_the_pod_of_lower_priority_is_deleted_and_the_higher_one_takes_its_place(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge(own(stage, 1), cpu="2")):
        for name, priority in (("low", "low"), ("middle", "middle")):
            stage.create_pod(ranked(name, priority, "900m"))
            stage.wait_bound(name)
        vip = stage.create_pod(ranked("vip", "high", "1"))
        assert stage.wait_bound("vip") == own(stage)
        stage.wait(lambda: gone(stage, "low"), what=lambda: "low is still there")
        assert stage.node_of("middle") == own(stage)
        note = stage.wait_event("vip", reason="FailedScheduling")["note"]
        assert note == (
            "0/1 nodes are available: 1 Insufficient cpu. preemption: found a potential placement for pod "
            f"on node {own(stage)}, preempting 1 victims"
        )
        event = stage.wait_event("low", reason="Preempted")
        assert event["note"] == f"Preempted by pod {vip['metadata']['uid']} on node {own(stage)}"
        assert (event["type"], event["action"]) == ("Normal", "Preempting")
        assert event["reportingController"] == "ros-aware-scheduler"


@pytest.mark.usefixtures("scheduler")
def test_a_victim_with_a_finalizer_shows_why_it_goes_and_the_preemptor_waits_for_it(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge(own(stage, 1), cpu="2")):
        low = ranked("low", "low", "1500m")
        low["metadata"]["finalizers"] = ["example.com/hold"]
        stage.create_pod(low)
        stage.wait_bound("low")
        stage.create_pod(ranked("vip", "high", "1"))
        victim = stage.wait(
            lambda: found if (found := stage.pod("low"))["metadata"].get("deletionTimestamp") else None,
            what=lambda: "low is not being deleted",
        )
        condition = next(each for each in victim["status"]["conditions"] if each["type"] == "DisruptionTarget")
        assert (condition["status"], condition["reason"]) == ("True", "PreemptionByScheduler")
        assert condition["message"] == "ros-aware-scheduler: preempting to accommodate a higher priority pod"
        stage.wait(
            lambda: stage.pod("vip")["status"].get("nominatedNodeName") == own(stage),
            what=lambda: "vip is not nominated",
        )
        installed_plane.api.patch(f"{stage.pods_path}/low", {"metadata": {"finalizers": None}})
        assert stage.wait_bound("vip") == own(stage)


@pytest.mark.usefixtures("scheduler")
def test_a_disruption_budget_sends_the_preemption_elsewhere(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge(own(stage, 1), cpu="2"), edge(own(stage, 2), cpu="2")):
        for name in ("guarded", "free"):
            stage.create_pod(ranked(name, "low", "1500m", labels={"app": name}))
            stage.wait_bound(name)
            wait_running(stage, name)
        path = f"/apis/policy/v1/namespaces/{stage.namespace}/poddisruptionbudgets"
        spec = {"minAvailable": 1, "selector": {"matchLabels": {"app": "guarded"}}}
        installed_plane.api.create(path, {"metadata": {"name": "guard"}, "spec": spec})
        stage.wait(
            lambda: installed_plane.api.get(f"{path}/guard")["status"].get("currentHealthy") == 1,
            what=lambda: f"{installed_plane.api.get(f'{path}/guard')['status']}",
        )
        stage.wait_known(own(stage, 1), own(stage, 2))  # the budget was there before: by now it is known, too
        where = stage.node_of("free")
        stage.create_pod(ranked("vip", "middle", "1"))
        assert stage.wait_bound("vip") == where
        assert gone(stage, "free")
        assert not stage.pod("guarded")["metadata"].get("deletionTimestamp")


@pytest.mark.usefixtures("scheduler")
def test_a_pod_that_never_preempts_waits_and_says_so(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge(own(stage, 1), cpu="2")):
        stage.create_pod(ranked("low", "low", "1500m"))
        stage.wait_bound("low")
        stage.create_pod(ranked("polite", "polite", "1"))
        message = stage.wait_refused("polite", reason="Unschedulable")
        assert message == (
            "0/1 nodes are available: 1 Insufficient cpu. preemption: not eligible due to preemptionPolicy=Never."
        )


def test_a_nomination_survives_a_restart_of_the_scheduler(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge(own(stage, 1), cpu="2")):
        # Gated, so that nobody binds it: what keeps the room free for it is its status alone.
        stage.create_pod(ranked("promised", "high", "1500m", schedulingGates=[{"name": "example.com/hold"}]))
        installed_plane.api.patch(f"{stage.pods_path}/promised/status", {"status": {"nominatedNodeName": own(stage)}})
        process: Process = start_scheduler(installed_plane, log_format="text")
        try:
            stage.create_pod(ranked("rival", "middle", "1"))
            assert stage.wait_refused("rival", reason="Unschedulable").startswith(
                "0/1 nodes are available: 1 Insufficient cpu."
            )
            stage.delete_pod("promised")
            assert stage.wait_bound("rival") == own(stage)
        finally:
            process.stop()


@pytest.mark.usefixtures("scheduler")
def test_many_preemptors_find_room_at_once_and_nobody_is_lost(installed_plane: ControlPlane, stage: Stage) -> None:
    count = 6
    with nodes(installed_plane, *(edge(own(stage, i), cpu="2") for i in range(count))):
        for i in range(count):
            stage.create_pod(ranked(f"low-{i}", "low", "1500m"))
        for i in range(count):
            stage.wait_bound(f"low-{i}")
        for i in range(count):
            stage.create_pod(ranked(f"vip-{i}", "high", "1500m"))
        assert {stage.wait_bound(f"vip-{i}") for i in range(count)} == {own(stage, i) for i in range(count)}
