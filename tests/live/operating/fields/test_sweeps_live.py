"""A sweep on a control plane with the operator and our scheduler: a few instances at a time, each in a domain of its own, and nothing left."""

import json

import pytest
from tests.live.operating.fields.sweep_views import jobs_of, phases_of, run_command

from campaigns.operating.sweep import Report, count_live_pods
from campaigns.rigs.live import Tenant, eventually, part
from campaigns.storm.history import Judge
from campaigns.storm.recorder import Recorder
from robotapp_api.model.names import QUEUE_NAME
from robotapp_testbed import ControlPlane
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.usefixtures("operator")

SPEEDS, SEEDS = ("0.5", "1.0", "1.5", "2.0"), ("1", "2", "3")
PARALLELISM = 3
MATRIX = {
    "parameters": [{"name": "speed", "values": list(SPEEDS)}, {"name": "seed", "values": list(SEEDS)}],
    "parallelism": PARALLELISM,
}
RESULTS = {"name": "results", "mountPath": "/results", "subPathExpr": "$(ROBOTAPP_APP)/$(ROBOTAPP_INSTANCE)"}
SIM = {
    "job": {},
    "args": ["--speed", "$(MATRIX_SPEED)"],
    "volumeMounts": [RESULTS],
    "template": {"spec": {"volumes": [{"name": "results", "emptyDir": {}}]}},
}


@pytest.fixture
def runs(installed_plane: ControlPlane, namespace: str, scheduler: Process) -> Tenant:
    """A namespace whose pods our scheduler binds; pods of Jobs end with 0 as soon as they run."""
    assert scheduler.running
    return Tenant(installed_plane, namespace)


def test_twelve_instances_three_at_a_time_all_complete_and_give_their_domains_back(
    installed_plane: ControlPlane, runs: Tenant, ids: str
) -> None:
    with Recorder(installed_plane) as recorder:
        eventually(lambda: recorder.passed.get("Pod", 0))
        runs.apply("sweep", part("sim", **SIM), matrix=MATRIX, ros2={"pool": ids})
        eventually(
            lambda: phases_of(runs, "sweep") == ["Completed"] * 12,
            timeout_s=180.0,
            what=lambda: (phases_of(runs, "sweep"), runs.app("sweep")["status"]),
        )
        eventually(lambda: not runs.claims(), what=runs.claims)
        events = recorder.ripe(all_of_them=True)
        assert not recorder.problems
    report = Report(12, PARALLELISM)
    mine = [event for event in events if event.obj["metadata"].get("namespace") in (runs.namespace, "")]
    count_live_pods((event for event in mine if event.kind == "Pod"), report, app="sweep")
    assert report.problems == []
    assert report.pods == 12
    assert 1 <= report.most_at_once <= PARALLELISM
    judge = Judge(namespaces=[runs.namespace])
    judge.hear(events)
    assert judge.verdict.broken == []
    app = runs.app("sweep")
    assert app["status"]["phase"] == "Completed"
    assert app["status"]["instanceCounts"] | {"desired": 12, "completed": 12} == app["status"]["instanceCounts"]

    listed = [line.split() for line in run_command(runs, "runs", "sweep").splitlines()]
    assert len(listed) == 13
    assert {tuple(line[1:3]) for line in listed[1:]} == {
        (f"speed={speed}", f"seed={seed}") for speed in SPEEDS for seed in SEEDS
    }
    assert all(line[3] == "Completed" and line[-1] == "0" for line in listed[1:])
    provenance = json.loads(run_command(runs, "runs", "sweep", "-o", "json"))
    assert all(run["jobs"][0]["specHash"] and run["jobs"][0]["pods"][0]["node"] for run in provenance)
    assert "no failed job" in run_command(runs, "runs", "sweep", "--failed")


def test_a_further_value_runs_alone_and_a_run_whose_job_is_deleted_runs_again(runs: Tenant, ids: str) -> None:
    small = {"parameters": [{"name": "seed", "values": ["1", "2"]}]}
    runs.apply("grow", part("sim", job={}), matrix=small, ros2={"pool": ids})
    eventually(lambda: phases_of(runs, "grow") == ["Completed"] * 2, what=lambda: runs.app("grow")["status"])
    first = {name: job["metadata"]["uid"] for name, job in jobs_of(runs).items()}
    runs.edit("grow", matrix={"parameters": [{"name": "seed", "values": ["0", "1", "2"]}]})
    eventually(lambda: phases_of(runs, "grow") == ["Completed"] * 3, what=lambda: runs.app("grow")["status"])
    assert {name: job["metadata"]["uid"] for name, job in jobs_of(runs).items() if name in first} == first
    again = next(iter(first))
    job = jobs_of(runs)[again]["metadata"]["name"]
    runs.cp.kubectl("delete", "job", job, "-n", runs.namespace)
    eventually(
        lambda: jobs_of(runs).get(again, {}).get("status", {}).get("succeeded") == 1,
        what=lambda: runs.listed("batch/jobs"),
    )
    eventually(lambda: not runs.claims(), what=runs.claims)


def test_jobs_of_a_queue_wait_suspended_and_run_when_they_are_resumed_by_somebody_else(runs: Tenant, ids: str) -> None:
    body = runs.apply("queued", part("sim", job={}), matrix=MATRIX, ros2={"pool": ids}, suspend=True)
    path = f"/apis/robotics.io/v1alpha1/namespaces/{runs.namespace}/robotapps/{body['metadata']['name']}"
    runs.cp.api.patch(path, {"metadata": {"labels": {QUEUE_NAME: "nightly"}}, "spec": {"suspend": False}})
    eventually(lambda: len(jobs_of(runs)) == PARALLELISM, what=lambda: runs.listed("batch/jobs"))
    jobs = jobs_of(runs)
    assert all(job["spec"]["suspend"] and job["metadata"]["labels"][QUEUE_NAME] == "nightly" for job in jobs.values())
    name, job = next(iter(jobs.items()))
    place = f"/apis/batch/v1/namespaces/{runs.namespace}/jobs/{job['metadata']['name']}"
    runs.cp.api.patch(place, {"spec": {"suspend": False}})  # as kueue does when it admits the Job
    eventually(lambda: jobs_of(runs)[name]["status"].get("succeeded") == 1, what=lambda: jobs_of(runs)[name])
    eventually(lambda: len(jobs_of(runs)) == PARALLELISM + 1, what=lambda: runs.listed("batch/jobs"))
