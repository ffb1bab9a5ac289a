"""A job on a schedule, on a control plane with the operator and our scheduler: each due time has one run, whichever
of them is killed.
"""

import secrets
from collections import defaultdict
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import pytest

from campaigns.operating.sweep import Report, count_live_pods
from campaigns.rigs.live import Tenant, eventually, part
from campaigns.storm.recorder import Recorder
from robotapp_api.model.names import Annotation, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.usefixtures("operator")

JOB_NAME = "batch.kubernetes.io/job-name"
EACH_MINUTE = {"cron": "* * * * *", "timeZone": "Europe/Athens"}
A_MINUTE_S = 70.0
"""The longest wait for the next run."""


@pytest.fixture
def runs(installed_plane: ControlPlane, namespace: str, operator: Process) -> Iterator[Tenant]:
    """A namespace whose pods our scheduler binds; pods of Jobs end with 0 as soon as they run."""
    assert operator.running
    scheduler = product.start_scheduler(installed_plane, name=f"scheduler-{secrets.token_hex(3)}", sweep_seconds=1)
    yield Tenant(installed_plane, namespace)
    scheduler.stop()


def due_jobs(tenant: Tenant) -> dict[str, dict[str, Any]]:
    """Returns Jobs by their due time; "" for the mark, which stands before the first run."""
    jobs = tenant.listed("batch/jobs")
    return {job["metadata"]["annotations"].get(Annotation.DUE_AT, ""): job for job in jobs}


def message_of(tenant: Tenant, name: str) -> str:
    (instance,) = tenant.instances(name)
    components = instance["status"].get("components", ())
    return next((str(view.get("message", "")) for view in components if view["name"] == "check"), "")


def test_a_run_is_made_when_it_is_due_and_not_again_by_an_operator_that_starts_anew(
    runs: Tenant, ids: str, operator: Process, installed_plane: ControlPlane
) -> None:
    started = datetime.now(UTC)
    with Recorder(installed_plane) as recorder:
        eventually(lambda: recorder.passed.get("Pod", 0))
        runs.apply("beat", part("driver"), part("check", job={}, schedule=EACH_MINUTE), ros2={"pool": ids})
        first = eventually(lambda: due_jobs(runs), what=runs.children)
        runs.wait_ready("beat")
        if "" in first:  # else the minute has just begun
            assert first[""]["spec"]["suspend"] is True
            eventually(lambda: "next run " in message_of(runs, "beat"), what=lambda: runs.instances("beat"))

        def ended_runs() -> dict[str, dict[str, Any]]:
            jobs = due_jobs(runs)
            return {due: job for due, job in jobs.items() if due and job["status"].get("succeeded") == 1}

        due, job = eventually(
            lambda: next(iter(ended_runs().items()), None), timeout_s=A_MINUTE_S, what=runs.children
        ) or ("", {})
        assert datetime.fromisoformat(due) > started
        assert datetime.fromisoformat(due).second == 0
        operator.kill()
        operator.restart()
        runs.edit("beat", suspend=True)
        eventually(lambda: runs.app("beat")["status"]["phase"] == "Suspended", what=lambda: runs.app("beat")["status"])
        eventually(lambda: "no runs while suspended" in message_of(runs, "beat"), what=lambda: runs.instances("beat"))
        jobs = due_jobs(runs)
        assert "" not in jobs, "the run has taken the place of the mark"
        assert jobs.get(due, job)["metadata"]["uid"] == job["metadata"]["uid"]
        events = [
            event
            for event in recorder.ripe(all_of_them=True)
            if event.obj["metadata"].get("namespace") == runs.namespace
        ]
    checks = [event for event in events if event.obj["metadata"].get("labels", {}).get(Label.COMPONENT) == "check"]
    report = Report(1, 1)
    count_live_pods(checks, report, app="beat")
    assert report.problems == []
    pods: defaultdict[str, set[str]] = defaultdict(set)
    for event in checks:
        pods[event.obj["metadata"]["labels"][JOB_NAME]].add(event.uid)
    assert job["metadata"]["name"] in pods
    assert all(len(uids) == 1 for uids in pods.values()), pods


def test_a_line_that_no_cron_has_is_refused_before_anything_is_made(runs: Tenant, ids: str) -> None:
    never = {"cron": "0 0 30 2 *", "timeZone": "Europe/Athens"}
    runs.apply("never", part("check", job={}, schedule=never), ros2={"pool": ids})
    condition = runs.wait("never", "Accepted", "False")
    assert "schedule.cron" in condition["message"]
    assert runs.listed("batch/jobs") == []
