"""A rollback on a real control plane: version N+1 (a wheel of its own) writes, N runs, and the user goes on editing."""

import secrets
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.live.operating.versions import newer_wheel

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_operator import __version__
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.processes.process import Process

RENDERED_BY = "robotics.io/rendered-by"
NEWER = newer_wheel.next_version()
AT_ONCE_S = 15.0
"""Seconds for an edit to act: one or two on an idle machine."""

Start = Callable[[str], Process]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return newer_wheel.unpacked(tmp_path_factory.mktemp("newer"))


@pytest.fixture
def start(installed_plane: ControlPlane, nodes: object, wheel: Path) -> Iterator[Start]:
    """Ends the operator that runs and starts the one of that version."""
    assert nodes
    running: list[Process] = []

    def start(version: str) -> Process:
        while running:
            running.pop().stop()
        env = {"PYTHONPATH": str(wheel)} if version == NEWER else {}
        name = f"operator-{secrets.token_hex(2)}"
        process = product.start_operator(installed_plane, name=name, env=env, sweep_seconds=1, no_leader_election=True)
        running.append(process)
        return process

    yield start
    for process in running:
        process.stop()


def pod_spec(tenant: Tenant, component: str) -> dict[str, Any]:
    (found,) = tenant.deployments(component)
    spec: dict[str, Any] = found["spec"]["template"]["spec"]
    return spec


def main(tenant: Tenant, component: str) -> dict[str, Any]:
    container: dict[str, Any] = pod_spec(tenant, component)["containers"][0]
    return container


def writers(tenant: Tenant) -> set[str]:
    """Versions that wrote the components' templates; those of the infrastructure are the same in both versions."""
    return {item["metadata"]["annotations"][RENDERED_BY] for item in tenant.deployments()}


def generations(tenant: Tenant) -> dict[str, int]:
    return {item["metadata"]["name"]: item["metadata"]["generation"] for item in tenant.listed("apps/deployments")}


def begun_by_the_newer(tenant: Tenant, start: Start, ids: str, name: str) -> None:
    """An app that N+1 wrote and that is ready, with N at work."""
    start(NEWER)
    tenant.apply(name, part("a"), part("b"), ros2={"pool": ids})
    tenant.wait_ready(name)
    assert writers(tenant) == {NEWER}
    assert pod_spec(tenant, "a")["enableServiceLinks"] is True
    start(__version__)


def test_after_a_rollback_suspend_image_replicas_and_deletion_act_at_once(
    tenant: Tenant, start: Start, ids: str
) -> None:
    begun_by_the_newer(tenant, start, ids, "back")
    before = generations(tenant)
    time.sleep(3)
    assert generations(tenant) == before, "the rollback itself rolls nothing"

    tenant.edit("back", suspend=True)
    eventually(lambda: not tenant.listed("pods"), timeout_s=AT_ONCE_S)
    assert tenant.app("back")["status"]["conditions"]
    tenant.edit("back", suspend=False)
    tenant.wait_ready("back")

    tenant.edit("back", components=[part("a", replicas=2) | {"image": "reg/a:2"}, part("b")])
    eventually(lambda: main(tenant, "a")["image"] == "reg/a:2", timeout_s=AT_ONCE_S)
    tenant.wait_ready("back")
    assert tenant.deployments("a")[0]["spec"]["replicas"] == 2
    assert pod_spec(tenant, "a")["enableServiceLinks"] is True
    assert writers(tenant) == {NEWER}
    assert tenant.condition("back", "Progressing")["reason"] == "UpToDate"

    tenant.edit("back", components=[part("b")])
    eventually(lambda: not tenant.deployments("a"), timeout_s=AT_ONCE_S)
    tenant.delete("back")
    eventually(lambda: not tenant.children(), timeout_s=AT_ONCE_S)


def test_what_a_rollback_holds_back_is_a_condition_an_event_and_a_count_until_the_newer_operator_is_back(
    tenant: Tenant, start: Start, ids: str
) -> None:
    begun_by_the_newer(tenant, start, ids, "held")
    tenant.edit("held", components=[part("a", args=["new"]) | {"image": "reg/a:2"}, part("b")])
    found = tenant.wait("held", "Progressing", "False", reason="NewerVersion")
    assert found["message"].startswith(
        f"1 template was written by operator {NEWER}, which is newer than this one ({__version__})"
    )
    assert (main(tenant, "a")["image"], "args" in main(tenant, "a")) == ("reg/a:2", False)
    eventually(lambda: [item for item in tenant.listed("events.k8s.io/events") if item["reason"] == "NewerVersion"])
    tenant.wait_ready("held")
    eventually(
        lambda: "1 template was written by" in tenant.cp.kubectl("get", "ra", "-n", tenant.namespace, "-o", "wide")
    )
    assert " 2/2 (1 held) " in tenant.cp.kubectl("get", "ra", "held", "-n", tenant.namespace)

    start(NEWER)
    eventually(lambda: main(tenant, "a").get("args") == ["new"])
    tenant.wait("held", "Progressing", "False", reason="UpToDate")
    managers = [
        (entry["manager"], entry["operation"])
        for entry in tenant.deployments("a")[0]["metadata"]["managedFields"]
        if entry["manager"] == "robotapp-operator"
    ]
    assert managers == [("robotapp-operator", "Apply")], "an amendment's own record would outlive what it names"


def test_an_approval_has_the_older_operator_write_its_own_templates(tenant: Tenant, start: Start, ids: str) -> None:
    begun_by_the_newer(tenant, start, ids, "mine")
    tenant.edit("mine", components=[part("a", args=["new"]), part("b")])
    tenant.wait("mine", "Progressing", "False", reason="NewerVersion")
    tenant.cp.kubectl("annotate", "ra", "mine", "-n", tenant.namespace, f"robotics.io/approve-update={__version__}")
    eventually(lambda: writers(tenant) == {__version__})
    assert main(tenant, "a")["args"] == ["new"]
    assert pod_spec(tenant, "a")["enableServiceLinks"] is False
    tenant.wait("mine", "Progressing", "False", reason="UpToDate")
    tenant.wait_ready("mine")
