"""Instances that start again when a job has failed, and apps that are deleted after their end, with an operator that dies."""

import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from tests.live.operating.fields.test_jobs_live import completed_at, domains_of, end_pod, jobs_of, wait_phase

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_api.model.names import Annotation, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.usefixtures("operator")


@pytest.fixture
def unplaced(installed_plane: ControlPlane, namespace: str) -> Tenant:
    """A namespace in which nobody binds pods: the test ends them as a kubelet would."""
    return Tenant(installed_plane, namespace)


@pytest.fixture
def second_operator(installed_plane: ControlPlane) -> Iterator[Process]:
    """Another operator that works at the same time."""
    process = product.start_operator(installed_plane, name="operator-second", sweep_seconds=1, no_leader_election=True)
    yield process
    process.stop()


def wait_pod(tenant: Tenant, component: str, attempt: str) -> dict[str, Any]:
    """Waits until the one pod of the component that has not ended is of this attempt; returns it."""

    def look() -> dict[str, Any] | None:
        live = [
            pod
            for pod in tenant.listed("pods")
            if pod["metadata"]["labels"].get(Label.COMPONENT) == component
            and pod["status"]["phase"] not in {"Succeeded", "Failed"}
            and "deletionTimestamp" not in pod["metadata"]
        ]
        assert len(live) <= 1, "an instance and component has one live pod"
        marks = [pod["metadata"].get("annotations", {}).get(Annotation.ATTEMPT, "") for pod in live]
        return live[0] if marks == [attempt] else None

    return eventually(look, what=lambda: (tenant.instances("again"), jobs_of(tenant), tenant.listed("pods"))) or {}


def domain_ids(tenant: Tenant) -> list[int]:
    return [claim["spec"]["domain"]["id"] for claim in domains_of(tenant)]


def test_an_instance_that_fails_twice_runs_all_its_jobs_again_and_completes_although_the_operator_dies(
    unplaced: Tenant, ids: str, operator: Process
) -> None:
    after = [{"component": "prepare", "status": "Complete"}]
    unplaced.apply(
        "again",
        part("sim"),
        part("prepare", job={"backoffLimit": 0}),
        part("save", job={"backoffLimit": 0}, dependsOn=after),
        ros2={"pool": ids},
        schedulerName="nobody",
        completion={"maxRestarts": 2},
    )
    held: list[list[int]] = []
    for attempt, verdict in (("", "Failed"), ("1", "Failed"), ("2", "Succeeded")):
        wait_pod(unplaced, "prepare", attempt)
        wait_pod(unplaced, "sim", attempt)
        end_pod(unplaced, "prepare", "Succeeded")
        wait_pod(unplaced, "save", attempt)
        held.append(domain_ids(unplaced))
        if attempt == "1":
            operator.kill()
        end_pod(unplaced, "save", verdict)
        if attempt == "1":
            eventually(lambda: jobs_of(unplaced)["save"]["status"].get("failed"))
            operator.restart()
    wait_phase(unplaced, "again", "Completed")
    (instance,) = unplaced.instances("again")
    restarts = instance["status"]["restarts"]
    assert (restarts["count"], restarts["attempt"]) == (2, 2)
    assert restarts["message"] == "restarted 2 of 2 times: job save failed (BackoffLimitExceeded)"
    assert held[0]
    assert held == [held[0]] * 3, "the domain stays the instance's"
    eventually(lambda: "StartedAgain" in unplaced.event_reasons("again"))
    eventually(lambda: not domains_of(unplaced), what=unplaced.claims)


def test_the_last_failure_ends_the_instance_and_an_edit_begins_to_count_anew(unplaced: Tenant, ids: str) -> None:
    unplaced.apply(
        "again",
        part("save", job={"backoffLimit": 0}),
        ros2={"pool": ids},
        schedulerName="nobody",
        completion={"maxRestarts": 1},
    )
    for attempt in ("", "1"):
        wait_pod(unplaced, "save", attempt)
        end_pod(unplaced, "save", "Failed")
    wait_phase(unplaced, "again", "Failed")
    assert "restarts before: 1" in unplaced.condition("again", "Ready")["message"]
    eventually(lambda: not domains_of(unplaced), what=unplaced.claims)
    unplaced.edit("again", components=[part("save", job={"backoffLimit": 0}, args=["again"])])
    for attempt in ("1", "2"):
        wait_pod(unplaced, "save", attempt)
        end_pod(unplaced, "save", "Failed")
    wait_phase(unplaced, "again", "Failed")


SEEDS = {"parallelism": 4, "parameters": [{"name": "seed", "values": ["1", "2", "3", "4", "5", "6"]}]}


def end_pending_pods(tenant: Tenant) -> bool:
    """Ends each pod that waits, as a failure before the second restart of its instance; whether the app has completed."""
    pods = tenant.listed("pods")
    live = [pod for pod in pods if pod["status"]["phase"] == "Pending" and "deletionTimestamp" not in pod["metadata"]]
    places = [pod["metadata"]["labels"][Label.INSTANCE] for pod in live]
    assert len(places) == len(set(places)), "an instance and component has one live pod"
    for pod in live:
        is_last = pod["metadata"].get("annotations", {}).get(Annotation.ATTEMPT) == "2"
        path = f"/api/v1/namespaces/{tenant.namespace}/pods/{pod['metadata']['name']}/status"
        with suppress(ApiStatusError):  # it was deleted meanwhile
            tenant.cp.api.patch(path, {"status": {"phase": "Succeeded" if is_last else "Failed"}})
    return bool(tenant.app("sweep").get("status", {}).get("phase") == "Completed")


def test_each_run_of_a_sweep_starts_again_by_itself_while_the_operator_dies_again_and_again(
    unplaced: Tenant, ids: str, operator: Process
) -> None:
    unplaced.apply(
        "sweep",
        part("sim", job={"backoffLimit": 0}),
        matrix=SEEDS,
        ros2={"pool": ids},
        schedulerName="nobody",
        completion={"maxRestarts": 2},
    )
    for _ in range(4):
        until = time.monotonic() + 2.0
        while time.monotonic() < until:
            end_pending_pods(unplaced)
        operator.kill()
        operator.restart()
    eventually(lambda: end_pending_pods(unplaced), what=lambda: (unplaced.app("sweep"), unplaced.listed("batch/jobs")))
    records = [instance["status"].get("restarts", {}) for instance in unplaced.instances("sweep")]
    assert [(record.get("count"), record.get("attempt")) for record in records] == [(2, 2)] * 6
    eventually(lambda: not domains_of(unplaced), what=unplaced.claims)


def test_a_suspended_app_keeps_its_failed_job_and_is_started_again_when_it_is_resumed(
    unplaced: Tenant, ids: str, operator: Process
) -> None:
    unplaced.apply(
        "again",
        part("save", job={"backoffLimit": 0}),
        ros2={"pool": ids},
        schedulerName="nobody",
        completion={"maxRestarts": 1},
    )
    wait_pod(unplaced, "save", "")
    operator.kill()
    end_pod(unplaced, "save", "Failed")
    eventually(lambda: jobs_of(unplaced)["save"]["status"].get("failed"))
    uid = jobs_of(unplaced)["save"]["metadata"]["uid"]
    unplaced.edit("again", suspend=True)
    operator.restart()
    wait_phase(unplaced, "again", "Suspended")
    eventually(lambda: any(item["status"].get("phase") == "Suspended" for item in unplaced.instances("again")))
    assert jobs_of(unplaced)["save"]["metadata"]["uid"] == uid, "its pod and the logs are still there"
    assert "restarts" not in unplaced.instances("again")[0]["status"]
    unplaced.edit("again", suspend=False)
    wait_pod(unplaced, "save", "1")


def test_of_two_operators_that_see_a_failure_one_counts_it(
    unplaced: Tenant, ids: str, second_operator: Process
) -> None:
    assert second_operator.running
    unplaced.apply(
        "again",
        part("save", job={"backoffLimit": 0}),
        ros2={"pool": ids},
        schedulerName="nobody",
        completion={"maxRestarts": 3},
    )
    for attempt in ("", "1", "2"):
        wait_pod(unplaced, "save", attempt)
        end_pod(unplaced, "save", "Failed")
    wait_pod(unplaced, "save", "3")
    (instance,) = unplaced.instances("again")
    assert instance["status"]["restarts"]["count"] == 3


def test_an_app_is_deleted_after_its_end_with_an_event_and_nothing_of_it_is_left(
    unplaced: Tenant, ids: str, operator: Process
) -> None:
    unplaced.apply("brief", part("save", job={}), ros2={"pool": ids}, schedulerName="nobody", completion={"ttl": "5s"})
    eventually(lambda: unplaced.listed("pods"), what=unplaced.children)
    end_pod(unplaced, "save", "Succeeded")
    app = wait_phase(unplaced, "brief", "Completed")
    assert app["status"]["completionTime"] == completed_at(jobs_of(unplaced)["save"])
    assert "it is deleted at" in unplaced.condition("brief", "Ready")["message"]
    operator.kill()
    operator.restart()
    eventually(lambda: not unplaced.apps(), what=unplaced.apps)
    eventually(lambda: not unplaced.listed("batch/jobs"), what=unplaced.children)
    eventually(lambda: not unplaced.claims(), what=unplaced.claims)
    eventually(lambda: "Expired" in unplaced.event_reasons("brief"))


def test_an_app_without_a_job_is_refused_a_ttl_with_what_to_write(unplaced: Tenant) -> None:
    with pytest.raises(ApiStatusError, match=r"about components that end, .*write job: \{\} in one"):
        unplaced.apply("service", part("driver"), completion={"ttl": "5s"})
