"""Components that end, on a control plane with the operator and our scheduler: they run once, and what they held is given back."""

from datetime import UTC, datetime
from typing import Any

import pytest

from campaigns.operating.sweep import Report, count_live_pods
from campaigns.rigs.live import Tenant, eventually, part
from campaigns.storm.recorder import Recorder
from robotapp_api.model.names import Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import Device, edge
from robotapp_testbed.machines.telemetry import SimulatedTelemetry
from robotapp_testbed.machines.topology import Topology, apply, remove
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.usefixtures("operator")


@pytest.fixture
def runs(installed_plane: ControlPlane, namespace: str, scheduler: Process) -> Tenant:
    """A namespace whose pods our scheduler binds; pods of Jobs end with 0 as soon as they run."""
    assert scheduler.running
    return Tenant(installed_plane, namespace)


@pytest.fixture
def unplaced(installed_plane: ControlPlane, namespace: str) -> Tenant:
    """A namespace in which nobody binds pods."""
    return Tenant(installed_plane, namespace)


def wait_phase(tenant: Tenant, name: str, phase: str) -> dict[str, Any]:
    return eventually(
        lambda: app if (app := tenant.app(name)).get("status", {}).get("phase") == phase else None,
        what=lambda: (tenant.app(name).get("status"), tenant.listed("batch/jobs"), tenant.children()),
    )


def elapsed_s(time: str) -> float:
    return (datetime.now(UTC) - datetime.fromisoformat(time)).total_seconds()


def jobs_of(tenant: Tenant) -> dict[str, dict[str, Any]]:
    return {job["metadata"]["labels"][Label.COMPONENT]: job for job in tenant.listed("batch/jobs")}


def completed_at(job: dict[str, Any]) -> str:
    """When the Job's condition turned to Complete, which may be a second after its `completionTime`."""
    return next(str(item["lastTransitionTime"]) for item in job["status"]["conditions"] if item["type"] == "Complete")


def limit_of(tenant: Tenant, component: str) -> int:
    """The seconds that a component's Job may take, 0 without a Job."""
    limit: int = jobs_of(tenant).get(component, {}).get("spec", {}).get("activeDeadlineSeconds", 0)
    return limit


def domains_of(tenant: Tenant) -> list[dict[str, Any]]:
    return [claim for claim in tenant.claims() if claim["spec"].get("domain")]


def end_pod(tenant: Tenant, component: str, phase: str) -> str:
    """Has the pod of a job end as its kubelet would report it; returns its name."""
    pods = [
        pod
        for pod in tenant.listed("pods")
        if pod["metadata"]["labels"].get(Label.COMPONENT) == component and pod["status"]["phase"] == "Pending"
    ]
    (pod,) = pods
    name = pod["metadata"]["name"]
    path = f"/api/v1/namespaces/{tenant.namespace}/pods/{name}/status"
    state = {"terminated": {"exitCode": 0 if phase == "Succeeded" else 3, "reason": "Error"}}
    status = {"name": component, "image": "x", "imageID": "", "ready": False, "restartCount": 0, "state": state}
    tenant.cp.api.patch(path, {"status": {"phase": phase, "containerStatuses": [status]}})
    return str(name)


def test_jobs_run_in_order_and_nothing_is_left_of_the_instance_but_their_record(runs: Tenant, ids: str) -> None:
    after = [{"component": "calibrate", "status": "Complete"}]
    runs.apply("map", part("calibrate", job={}), part("save", job={}, dependsOn=after), ros2={"pool": ids})
    app = wait_phase(runs, "map", "Completed")
    assert app["status"]["instanceCounts"]["completed"] == 1
    assert app["status"]["summary"]["ready"] == "2/2"
    jobs = jobs_of(runs)
    assert {name: job["status"].get("succeeded") for name, job in jobs.items()} == {"calibrate": 1, "save": 1}
    assert jobs["calibrate"]["status"]["completionTime"] <= jobs["save"]["metadata"]["creationTimestamp"]
    eventually(lambda: not domains_of(runs), what=runs.claims)
    assert runs.deployments() == []
    (instance,) = runs.instances("map")
    assert instance["status"]["completionTime"] == completed_at(jobs["save"])
    eventually(lambda: "Completed" in runs.event_reasons("map"), what=lambda: runs.event_reasons("map"))


def test_a_job_that_has_ended_runs_again_when_it_was_edited_and_not_when_the_operator_was_killed(
    runs: Tenant, ids: str, operator: Process
) -> None:
    runs.apply("once", part("save", job={}), ros2={"pool": ids})
    wait_phase(runs, "once", "Completed")
    first = jobs_of(runs)["save"]["metadata"]["uid"]
    operator.kill()
    operator.restart()
    eventually(lambda: not domains_of(runs), what=runs.claims)
    runs.edit("once", components=[part("save", job={"backoffLimit": 1})])
    eventually(lambda: runs.app("once")["status"].get("observedGeneration") == 2)
    assert jobs_of(runs)["save"]["metadata"]["uid"] == first

    def ran_again() -> bool:
        job = jobs_of(runs).get("save", {"metadata": {"uid": first}})
        return job["metadata"]["uid"] != first and job["status"].get("succeeded") == 1

    runs.edit("once", components=[part("save", job={}, image="reg/save:2")])
    eventually(ran_again, what=lambda: runs.listed("batch/jobs"))
    wait_phase(runs, "once", "Completed")
    eventually(lambda: not domains_of(runs), what=runs.claims)


def test_a_failed_job_fails_its_instance_and_ends_the_components_that_run_on(unplaced: Tenant, ids: str) -> None:
    unplaced.apply(
        "check",
        part("driver"),
        part("test", job={"backoffLimit": 0}),
        ros2={"pool": ids},
        schedulerName="nobody",
        completion={"success": {}},
    )
    eventually(lambda: unplaced.listed("batch/jobs"), what=unplaced.children)
    eventually(
        lambda: [pod for pod in unplaced.listed("pods") if pod["metadata"]["labels"].get(Label.COMPONENT) == "test"]
    )
    end_pod(unplaced, "test", "Failed")
    app = wait_phase(unplaced, "check", "Failed")
    assert app["status"]["instanceCounts"]["failed"] == 1
    ready = unplaced.condition("check", "Ready")
    assert ready["reason"] == "JobFailed"
    assert "last with exit code 3" in ready["message"]
    eventually(lambda: unplaced.deployments() == [], what=unplaced.children)
    eventually(lambda: not domains_of(unplaced), what=unplaced.claims)


def test_jobs_that_are_not_done_at_the_deadline_are_ended(unplaced: Tenant, ids: str) -> None:
    unplaced.apply(
        "late",
        part("driver"),
        part("save", job={}),
        ros2={"pool": ids},
        schedulerName="nobody",
        completion={"deadline": "3s"},
    )
    wait_phase(unplaced, "late", "Failed")
    eventually(lambda: unplaced.deployments() == [], what=unplaced.children)
    eventually(lambda: not domains_of(unplaced), what=unplaced.claims)
    eventually(
        lambda: any(each["type"] == "Failed" for each in jobs_of(unplaced)["save"]["status"].get("conditions", ())),
        what=lambda: jobs_of(unplaced),
    )
    assert unplaced.condition("late", "Ready")["reason"] == "DeadlineExceeded"
    unplaced.edit(
        "late", completion={"deadline": "10m"}, components=[part("driver"), part("save", job={}, args=["again"])]
    )
    eventually(lambda: limit_of(unplaced, "save") > 3, what=lambda: jobs_of(unplaced))
    assert limit_of(unplaced, "save") in range(590, 601)


def test_the_time_of_a_suspended_app_does_not_count_for_its_deadline(unplaced: Tenant, ids: str) -> None:
    unplaced.apply(
        "paused", part("save", job={}), ros2={"pool": ids}, schedulerName="nobody", completion={"deadline": "15s"}
    )
    eventually(lambda: unplaced.listed("pods"), what=unplaced.children)
    unplaced.edit("paused", suspend=True)
    wait_phase(unplaced, "paused", "Suspended")
    created = jobs_of(unplaced)["save"]["metadata"]["creationTimestamp"]
    eventually(lambda: elapsed_s(created) > 18, what=unplaced.children)
    assert not unplaced.listed("pods")
    unplaced.edit("paused", suspend=False)
    eventually(lambda: unplaced.listed("pods"), what=unplaced.children)
    wait_phase(unplaced, "paused", "Failed")
    assert unplaced.condition("paused", "Ready")["reason"] == "DeadlineExceeded"


def test_a_suspended_app_suspends_its_jobs_and_goes_on_with_them(unplaced: Tenant, ids: str) -> None:
    unplaced.apply("work", part("save", job={}), ros2={"pool": ids}, schedulerName="nobody")
    eventually(lambda: unplaced.listed("pods"), what=unplaced.children)
    (job,) = unplaced.listed("batch/jobs")
    unplaced.edit("work", suspend=True)
    eventually(lambda: not unplaced.listed("pods"), what=unplaced.children)
    wait_phase(unplaced, "work", "Suspended")
    unplaced.edit("work", suspend=False)
    eventually(lambda: unplaced.listed("pods"), what=unplaced.children)
    assert [each["metadata"]["uid"] for each in unplaced.listed("batch/jobs")] == [job["metadata"]["uid"]]


def test_a_job_that_is_edited_while_it_runs_never_has_two_pods_and_ends_once(
    runs: Tenant, ids: str, operator: Process, installed_plane: ControlPlane
) -> None:
    """Pods of this instance wait for a node without which none ends; every edit finds one that has not ended."""
    waiting = {"template": {"spec": {"nodeSelector": {"example.com/free": "true"}}}, "job": {}}
    runs.apply("edited", part("save", **waiting), ros2={"pool": ids})
    with Recorder(installed_plane) as recorder:
        eventually(lambda: recorder.passed.get("Pod", 0))
        for number in range(3):
            eventually(lambda: runs.listed("pods"), what=runs.children)
            before = {job["metadata"]["uid"] for job in runs.listed("batch/jobs")}
            if number == 1:
                operator.kill()
            runs.edit("edited", components=[part("save", **{**waiting, "image": f"reg/save:{number + 2}"})])
            if number == 1:
                operator.restart()
            eventually(
                lambda before=before: (
                    {job["metadata"]["uid"] for job in runs.listed("batch/jobs")}.isdisjoint(before)
                    and runs.listed("batch/jobs")
                ),
                what=lambda: runs.listed("batch/jobs"),
            )
        runs.edit("edited", components=[part("save", job={}, image="reg/save:9")])
        wait_phase(runs, "edited", "Completed")
        events = recorder.ripe(all_of_them=True)
    report = Report(1, 1)
    mine = [event for event in events if event.obj["metadata"].get("namespace") == runs.namespace]
    count_live_pods(mine, report, app="edited")
    assert report.problems == []
    assert report.pods == 1
    eventually(lambda: not domains_of(runs), what=runs.claims)


def test_a_job_has_its_device_for_itself_and_gives_it_back_when_it_has_ended(
    runs: Tenant, ids: str, installed_plane: ControlPlane
) -> None:
    machines = Topology([edge("bus-of-jobs", devices=[Device(id="can-can0", type="can", interface="can0")])])
    apply(installed_plane, machines)
    try:
        with SimulatedTelemetry(installed_plane, machines):
            device = {"name": "bus", "type": "can"}
            runs.apply("calibrate", part("calibrate", job={}, devices=[device]), ros2={"pool": ids})
            wait_phase(runs, "calibrate", "Completed")
            (pod,) = runs.listed("pods")
            assert pod["spec"]["nodeName"] == "bus-of-jobs"
            eventually(lambda: not runs.claims(), what=runs.claims)
    finally:
        remove(installed_plane, machines)
