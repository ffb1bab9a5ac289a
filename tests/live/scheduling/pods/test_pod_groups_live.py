"""PodGroups on a real API server: none while one is missing, all when there is room, and the rest after a crash."""

import re
import secrets
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.support.proxy import FaultProxy, drop

from campaigns.rigs.stage import Json, Stage, nodes, pod
from campaigns.rigs.twin import THEIRS, kube_scheduler, scraped
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.pods.pod_group_index import POD_GROUP_LABEL, WORKLOADS
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.control_plane.product import install, start_scheduler
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines.nodes import SimulatedNode, edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live
GROUP = "scheduling.x-k8s.io"
CRDS = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions"
CRD: Json = {
    "apiVersion": "apiextensions.k8s.io/v1",
    "kind": "CustomResourceDefinition",
    "metadata": {
        "name": f"podgroups.{GROUP}",
        "annotations": {"api-approved.kubernetes.io": "unapproved, a test"},
    },
    "spec": {
        "group": GROUP,
        "scope": "Namespaced",
        "names": {"plural": "podgroups", "singular": "podgroup", "kind": "PodGroup", "listKind": "PodGroupList"},
        "versions": [
            {
                "name": "v1alpha1",
                "served": True,
                "storage": True,
                "schema": {"openAPIV3Schema": {"type": "object", "x-kubernetes-preserve-unknown-fields": True}},
            }
        ],
    },
}


@pytest.fixture
def proxied(installed_plane: ControlPlane) -> Iterator[tuple[Process, FaultProxy]]:
    """The only scheduler, behind a proxy; it starts before the CRD is there."""
    with FaultProxy() as proxy:
        route = proxy.route("scheduler", installed_plane.kubeconfig("scheduler"))
        name = f"scheduler-{secrets.token_hex(3)}"
        process = start_scheduler(installed_plane, name=name, kubeconfig=route.kubeconfig, sweep_seconds=1)
        yield process, proxy
        process.stop()


@pytest.fixture
def served(proxied: tuple[Process, FaultProxy], installed_plane: ControlPlane) -> Iterator[tuple[Process, FaultProxy]]:
    """The CRD comes after the scheduler has started, and goes after the test."""
    api = installed_plane.api
    api.create(CRDS, CRD)
    Stage.wait(lambda: _served(installed_plane), what=lambda: "the CRD is not served")
    yield proxied
    api.delete(f"{CRDS}/podgroups.{GROUP}")
    Stage.wait(lambda: not _served(installed_plane), what=lambda: "the CRD is still served")


def _served(cp: ControlPlane) -> bool:
    try:
        cp.api.get(f"/apis/{GROUP}/v1alpha1/podgroups")
    except ApiStatusError:
        return False
    return True


def create_group(stage: Stage, name: str, needed: Any) -> None:
    path = f"/apis/{GROUP}/v1alpha1/namespaces/{stage.namespace}/podgroups"
    body = {"apiVersion": f"{GROUP}/v1alpha1", "kind": "PodGroup", "metadata": {"name": name}}
    stage.cp.api.create(path, {**body, "spec": {"minMember": needed}})


def members(stage: Stage, group: str, count: int, **spec: Any) -> list[str]:
    """Pods of which each takes a node of `whole` to itself; they name the group by label, or in `spec`."""
    names = [f"{group}-{i}" for i in range(count)]
    labels = {} if spec else {POD_GROUP_LABEL: group}
    where = {"test/whole": stage.namespace}
    for name in names:
        stage.create_pod(pod(name, requests={"cpu": "3"}, labels=labels, nodeSelector=where, **spec))
    return names


def whole(stage: Stage, *numbers: int) -> list[SimulatedNode]:
    return [edge(f"{stage.namespace}-{i}", cpu="4", labels={"test/whole": stage.namespace}) for i in numbers]


def wait_told(stage: Stage, names: list[str], wanted: dict[str, int]) -> None:
    """Wait until so many of them say each of these. What they said before all of it was known does not count."""

    def told() -> list[Json]:
        return [stage.refusal(name) for name in names]

    def heard() -> bool:
        found = [each["message"] for each in told() if each.get("reason") == "Unschedulable"]
        return all(sum(text in each for each in found) == count for text, count in wanted.items())

    stage.wait(heard, what=lambda: str(told()))


@pytest.mark.usefixtures("served")
def test_five_where_four_fit_get_no_node_and_all_of_them_once_there_is_room(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, *whole(stage, 0, 1, 2, 3)):
        names = members(stage, "five", 5)
        create_group(stage, "five", 5)
        wait_told(stage, names, {"minCount (5) cannot be satisfied: 4 scheduled": 4, "Insufficient cpu": 5})
        assert [stage.node_of(name) for name in names] == [""] * 5
        with nodes(installed_plane, *whole(stage, 4)):
            assert len({stage.wait_bound(name) for name in names}) == 5


@pytest.mark.usefixtures("served")
def test_a_group_that_waits_for_room_is_placed_as_soon_as_it_asks_for_less(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, *whole(stage, 0, 1)):
        create_group(stage, "three", 3)
        names = members(stage, "three", 3)
        for name in names:
            stage.wait_refused(name, reason="Unschedulable")
        path = f"/apis/{GROUP}/v1alpha1/namespaces/{stage.namespace}/podgroups/three"
        installed_plane.api.patch(path, {"spec": {"minMember": 2}})
        stage.wait(
            lambda: sum(bool(stage.node_of(name)) for name in names) == 2,
            what=lambda: str([stage.refusal(name) for name in names]),
        )


def test_a_group_with_words_for_numbers_is_named_on_its_pods_at_once_and_placed_when_it_was_mended(
    installed_plane: ControlPlane, stage: Stage, served: tuple[Process, FaultProxy]
) -> None:
    with nodes(installed_plane, *whole(stage, 0, 1)):
        names = members(stage, "two", 2)
        began_s = time.monotonic()
        create_group(stage, "two", "three")
        wrong = 'PodGroup two cannot be planned: field spec.minMember: "three" is not valid; allowed: a whole number'
        for name in names:
            stage.wait_refused(name, reason="WaitingForGroup", saying=wrong)
            assert stage.wait_event(name, reason="FailedScheduling")["note"].startswith(wrong)
        assert time.monotonic() - began_s < 45, "a group that lacks pods says so after a minute"
        log = served[0].log_path.read_text()
        assert "Traceback" not in log
        assert "podgroups" not in "".join(line for line in log.splitlines() if "ERROR" in line)
        path = f"/apis/{GROUP}/v1alpha1/namespaces/{stage.namespace}/podgroups/two"
        installed_plane.api.patch(path, {"spec": {"minMember": 2}})
        assert len({stage.wait_bound(name) for name in names}) == 2


def test_after_a_kill_between_its_bindings_the_rest_of_a_group_follows(
    installed_plane: ControlPlane, stage: Stage, served: tuple[Process, FaultProxy]
) -> None:
    process, proxy = served
    with nodes(installed_plane, *whole(stage, 0, 1, 2, 3, 4)):
        create_group(stage, "five", 5)
        proxy.add(drop(), verbs="create", path="/binding$", skip=2, times=None)
        names = members(stage, "five", 5)

        def bound() -> int:
            return sum(1 for name in names if stage.node_of(name))

        stage.wait(lambda: bound() == 2, what=lambda: f"{bound()} are bound")
        process.kill()
        proxy.clear()
        assert bound() == 2
        process.start()
        assert len({stage.wait_bound(name) for name in names}) == 5


def wait_condition(stage: Stage, path: str, status: str, reason: str) -> None:
    def said() -> list[Json]:
        return list((stage.cp.api.get(path).get("status") or {}).get("conditions") or [])

    wanted = ("PodGroupInitiallyScheduled", status, reason)
    stage.wait(
        lambda: wanted in [(each["type"], each["status"], each["reason"]) for each in said()], what=lambda: str(said())
    )


@pytest.fixture(scope="module")
def workload_plane() -> Iterator[ControlPlane]:
    """An API server that serves PodGroups itself, which a default one does not."""
    flags = ["--feature-gates=GenericWorkload=true", "--runtime-config=scheduling.k8s.io/v1beta1=true"]
    with ControlPlane(extra_args={"kube-apiserver": flags}) as plane:
        install(plane)
        yield plane


def test_the_api_servers_own_pod_groups_are_placed_whole_or_not_at_all(workload_plane: ControlPlane) -> None:
    process = start_scheduler(workload_plane, sweep_seconds=1)
    with created(workload_plane, f"test-{secrets.token_hex(3)}") as namespace:
        stage = Stage(workload_plane, namespace)
        with nodes(workload_plane, *whole(stage, 0, 1)):
            names = members(stage, "three", 3, schedulingGroup={"podGroupName": "three"})
            path = f"/apis/{WORKLOADS}/v1beta1/namespaces/{namespace}/podgroups"
            policy = {"gang": {"minCount": 3}}
            stage.cp.api.create(path, {"metadata": {"name": "three"}, "spec": {"schedulingPolicy": policy}})
            wait_told(stage, names, {"minCount (3) cannot be satisfied: 2 scheduled": 2})
            assert [stage.node_of(name) for name in names] == [""] * 3
            wait_condition(stage, f"{path}/three", "False", "Unschedulable")
            with nodes(workload_plane, *whole(stage, 2)):
                assert len({stage.wait_bound(name) for name in names}) == 3
                wait_condition(stage, f"{path}/three", "True", "Scheduled")
    process.stop()


def queues(url: str) -> dict[str, float]:
    """Pending pods by queue, those that are tried again and again left out."""
    found = re.findall(r'^scheduler_pending_pods\{queue="(\w+)"\} (\S+)', scraped(url), re.MULTILINE)
    return {queue: float(count) for queue, count in found if queue not in {"active", "backoff", "unschedulable"}}


def wait_queues(stage: Stage, url: str) -> None:
    wanted = {"gated": 1.0, "incomplete": 2.0, "pending": 0.0}
    stage.wait(lambda: queues(url) == wanted, what=lambda: f"{url}: {queues(url)}")


def test_pods_without_their_group_and_groups_without_their_pods_are_counted_as_kube_scheduler_counts_them(
    workload_plane: ControlPlane, tmp_path: Path
) -> None:
    ours = start_scheduler(workload_plane, sweep_seconds=1, insecure_explain=True)
    with (
        created(workload_plane, f"test-{secrets.token_hex(3)}") as namespace,
        kube_scheduler(workload_plane, tmp_path, "--feature-gates=GenericWorkload=true") as theirs,
    ):
        stage = Stage(workload_plane, namespace)
        path = f"/apis/{WORKLOADS}/v1beta1/namespaces/{namespace}/podgroups"
        for scheduler in (SCHEDULER_NAME, THEIRS):
            few = f"few-{scheduler}"
            stage.cp.api.create(
                path, {"metadata": {"name": few}, "spec": {"schedulingPolicy": {"gang": {"minCount": 3}}}}
            )
            for name, group in (("a", "none"), ("b", "none"), ("c", few)):
                stage.create_pod(
                    pod(f"{name}-{scheduler}", scheduler=scheduler, schedulingGroup={"podGroupName": group})
                )
        wait_queues(stage, theirs)
        wait_queues(stage, ours.health_url)
    ours.stop()
