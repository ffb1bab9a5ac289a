"""Pods with volumes on the live control plane, whose volume controller binds what the scheduler decided."""

import secrets
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.rigs.stage import Stage, nodes, pod
from campaigns.rigs.storage_live import (
    PROVISIONER,
    SELECTED_NODE,
    VOLUMES,
    claim,
    claims_path,
    provisioner,
    storage_class,
    volume,
)
from robotapp_scheduler.shell.process.loop import IN_FLIGHT
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live
Json = dict[str, Any]


@pytest.fixture
def local(installed_plane: ControlPlane) -> Iterator[str]:
    """A class of volumes that somebody makes by hand."""
    with storage_class(installed_plane, f"local-{secrets.token_hex(3)}") as name:
        yield name


@pytest.fixture
def made(installed_plane: ControlPlane) -> Iterator[str]:
    """A class of volumes that are made on demand."""
    with storage_class(installed_plane, f"made-{secrets.token_hex(3)}", PROVISIONER) as name:
        yield name


def mounts(*claims: str) -> list[Json]:
    return [{"name": name, "persistentVolumeClaim": {"claimName": name}} for name in claims]


def create_claim(stage: Stage, name: str, storage_class: str, size: str = "1Gi", **fields: Any) -> None:
    stage.cp.api.create(claims_path(stage.namespace), claim(name, storage_class, size, **fields))


def claim_of(stage: Stage, name: str) -> Json:
    found: Json = stage.cp.api.get(f"{claims_path(stage.namespace)}/{name}")
    return found


def bound_claim(stage: Stage, name: str) -> Json:
    """The claim once its controller calls it Bound, which may be a moment after its pod got its node."""
    found: Json = stage.wait(
        lambda: seen if (seen := claim_of(stage, name))["status"].get("phase") == "Bound" else None,
        what=lambda: f"{name}: {claim_of(stage, name)['status']}",
    )
    return found


def create_volume(stage: Stage, name: str, storage_class: str, size: str = "1Gi", *, node: str) -> str:
    """A volume that exists, ready to be given."""
    full = f"{name}-{stage.namespace}"
    stage.cp.api.create(VOLUMES, volume(full, storage_class, size, node=node))
    path = f"{VOLUMES}/{full}"
    stage.wait(
        lambda: stage.cp.api.get(path)["status"].get("phase") in {"Available", "Bound"},  # a pod may wait for it
        what=lambda: f"{full} is not available",
    )
    return full


@pytest.mark.usefixtures("scheduler")
def test_a_pod_gets_the_smallest_volume_that_fits_and_runs_where_it_is(
    installed_plane: ControlPlane, stage: Stage, local: str
) -> None:
    with nodes(installed_plane, edge("edge-1"), edge("edge-2"), edge("edge-3")):
        create_volume(stage, "tiny", local, "1Gi", node="edge-1")
        small = create_volume(stage, "small", local, "10Gi", node="edge-2")
        create_volume(stage, "big", local, "50Gi", node="edge-2")
        create_claim(stage, "map", local, "5Gi")
        stage.create_pod(pod("mapper", volumes=mounts("map")))
        assert stage.wait_bound("mapper") == "edge-2"
        assert bound_claim(stage, "map")["spec"]["volumeName"] == small
        stage.wait(lambda: stage.pod("mapper")["status"]["phase"] == "Running", what=lambda: "not running")


@pytest.mark.usefixtures("scheduler")
def test_a_claim_is_provisioned_on_the_node_that_was_chosen_for_its_first_pod(
    installed_plane: ControlPlane, stage: Stage, made: str
) -> None:
    with (
        nodes(installed_plane, edge("edge-1"), edge("edge-2")),
        provisioner(installed_plane, stage.namespace) as asked,
    ):
        create_claim(stage, "log", made)
        stage.create_pod(pod("recorder", volumes=mounts("log"), nodeSelector={"kubernetes.io/hostname": "edge-2"}))
        assert stage.wait_bound("recorder") == "edge-2"
        found = bound_claim(stage, "log")
        assert found["metadata"]["annotations"][SELECTED_NODE] == "edge-2"
        assert set(asked) == {"edge-2"}
        stage.create_pod(pod("reader", volumes=mounts("log")))
        assert stage.wait_bound("reader") == "edge-2"


@pytest.mark.usefixtures("scheduler")
def test_a_pod_says_where_it_goes_while_its_volume_is_made(
    installed_plane: ControlPlane, stage: Stage, made: str
) -> None:
    def promised() -> str:
        return str(stage.pod("recorder")["status"].get("nominatedNodeName", ""))

    with nodes(installed_plane, edge("edge-1")):
        create_claim(stage, "log", made)
        stage.create_pod(pod("recorder", volumes=mounts("log")))
        stage.wait(lambda: promised() == "edge-1", what=lambda: f"promised {promised()!r}")
        with provisioner(installed_plane, stage.namespace):
            assert stage.wait_bound("recorder") == "edge-1"
        assert promised() == ""


@pytest.mark.usefixtures("scheduler")
def test_a_provisioner_that_refuses_a_node_sends_the_pod_back_to_try_again(
    installed_plane: ControlPlane, stage: Stage, made: str
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        create_claim(stage, "log", made)
        with provisioner(installed_plane, stage.namespace, refuses=frozenset({"edge-1"})):
            stage.create_pod(pod("recorder", volumes=mounts("log")))
            message = stage.wait_refused("recorder", reason="SchedulerError", saying="provisioning failed")
        assert message == ('running PreBind plugin "VolumeBinding": binding volumes: provisioning failed for PVC "log"')
        with provisioner(installed_plane, stage.namespace):
            assert stage.wait_bound("recorder") == "edge-1"


@pytest.mark.usefixtures("scheduler")
def test_a_pod_whose_claim_is_missing_says_so_and_is_tried_when_it_appears(
    installed_plane: ControlPlane, stage: Stage, local: str
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.wait_known("edge-1")
        stage.create_pod(pod("mapper", volumes=mounts("map")))
        message = stage.wait_refused("mapper", reason="Unschedulable")
        assert message == '0/1 nodes are available: persistentvolumeclaim "map" not found. not found'
        create_claim(stage, "map", local)

        def none_free() -> bool:
            return "didn't find available persistent volumes" in str(stage.refusal("mapper").get("message"))

        stage.wait(none_free, what=lambda: str(stage.refusal("mapper")))
        create_volume(stage, "v", local, node="edge-1")
        assert stage.wait_bound("mapper") == "edge-1"


@pytest.mark.usefixtures("scheduler")
def test_an_ephemeral_volume_is_claimed_by_its_controller_and_provisioned(
    installed_plane: ControlPlane, stage: Stage, made: str
) -> None:
    template = {"spec": claim("x", made)["spec"]}
    with nodes(installed_plane, edge("edge-1")), provisioner(installed_plane, stage.namespace):
        stage.create_pod(pod("worker", volumes=[{"name": "scratch", "ephemeral": {"volumeClaimTemplate": template}}]))
        assert stage.wait_bound("worker") == "edge-1"
        assert bound_claim(stage, "worker-scratch")


@pytest.mark.usefixtures("scheduler")
def test_pods_that_wait_for_volumes_hold_nobody_up(installed_plane: ControlPlane, stage: Stage, made: str) -> None:
    with nodes(installed_plane, edge("edge-1"), edge("edge-2")):  # a node takes 110 pods
        for index in range(IN_FLIGHT + 6):
            create_claim(stage, f"log-{index}", made)
            stage.create_pod(pod(f"slow-{index}", volumes=mounts(f"log-{index}")))
        stage.create_pod(pod("plain"))
        assert stage.wait_bound("plain")
        with provisioner(installed_plane, stage.namespace):
            stage.wait(
                lambda: all(each["spec"].get("nodeName") for each in stage.pods()),
                what=lambda: "some are not bound",
                timeout_s=150.0,
            )


def test_a_scheduler_that_dies_between_the_claim_and_the_binding_leaves_nothing_lost(
    installed_plane: ControlPlane, stage: Stage, made: str, local: str
) -> None:
    with nodes(installed_plane, edge("edge-1"), edge("edge-2")):
        create_claim(stage, "log", made)
        create_claim(stage, "map", local)
        create_volume(stage, "v", local, node="edge-2")
        create_volume(stage, "w", local, node="edge-1")
        first = start_scheduler(installed_plane, sweep_seconds=1, insecure_explain=True, log_format="text")
        try:
            stage.create_pod(pod("recorder", volumes=mounts("log", "map")))
            chosen = stage.wait(
                lambda: claim_of(stage, "log")["metadata"].get("annotations", {}).get(SELECTED_NODE),
                what=lambda: f"nobody chose: {stage.refusal('recorder')}",
            )
        finally:
            first.kill()
        assert not stage.node_of("recorder")
        second: Process = start_scheduler(installed_plane, sweep_seconds=1, insecure_explain=True, log_format="text")
        try:
            with provisioner(installed_plane, stage.namespace):
                assert stage.wait_bound("recorder") == chosen
        finally:
            second.stop()
        assert bound_claim(stage, "map")
