"""Runs of a moment and components that become jobs, on a control plane: what a sweep leaves to others, and who waits for whose last pod."""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.live.operating.fields.sweep_views import jobs_of, phases_of, run_command

from campaigns.operating.sweep import Report, count_live_pods
from campaigns.rigs.live import Tenant, eventually, part, pool
from campaigns.rigs.twin import THEIRS, kube_scheduler
from campaigns.storm.history import Event
from campaigns.storm.recorder import Recorder
from robotapp_testbed import ControlPlane
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.usefixtures("operator")

RUNS = 10
IDS = 6
HELD = ["example.com/held"]
"""Finalizers of a pod whose programs take their time to end."""


def count_claims(events: list[Event], namespace: str) -> int:
    """Returns how many domains the namespace held at once, those that rest included."""
    held: set[str] = set()
    most = 0
    for event in sorted(events):
        if event.kind != "RobotClaim" or event.obj["spec"]["holder"].get("namespace") != namespace:
            continue
        (held.discard if event.gone else held.add)(event.uid)
        most = max(most, len(held))
    return most


def test_runs_of_a_moment_hold_half_of_the_pool_with_what_rests_and_one_of_them_is_run_again(
    installed_plane: ControlPlane, namespace: str, scheduler: Process
) -> None:
    assert scheduler.running
    runs = Tenant(installed_plane, namespace)
    matrix = {"parameters": [{"name": "seed", "values": [str(number) for number in range(RUNS)]}], "parallelism": 2}
    name = f"pool-{secrets.token_hex(3)}"
    with pool(installed_plane, name, ids=f"1-{IDS}", quarantine_s=2), Recorder(installed_plane) as recorder:
        eventually(lambda: recorder.passed.get("RobotClaim", 0))
        runs.apply("short", part("sim", job={}), matrix=matrix, ros2={"pool": name})
        eventually(
            lambda: phases_of(runs, "short") == ["Completed"] * RUNS,
            timeout_s=120.0,
            what=lambda: (phases_of(runs, "short"), runs.app("short")["status"]),
        )
        eventually(lambda: not runs.claims(), what=runs.claims)
        assert count_claims(recorder.ripe(all_of_them=True), namespace) == IDS // 2
        first, other = list(jobs_of(runs).items())[:2]
        printed = run_command(runs, "restart", "short", "sim", "--robot", first[0])
        assert "1 job runs once more (sim)" in printed

        def ran_again() -> bool:
            job = jobs_of(runs).get(first[0], first[1])
            return job["metadata"]["uid"] != first[1]["metadata"]["uid"] and job["status"].get("succeeded") == 1

        eventually(ran_again, what=lambda: runs.listed("batch/jobs"))
        assert jobs_of(runs)[other[0]]["metadata"]["uid"] == other[1]["metadata"]["uid"]
        eventually(lambda: not runs.claims(), what=runs.claims)


@contextmanager
def held_pod(tenant: Tenant) -> Iterator[str]:
    """Keeps the only pod after its deletion, like one whose program takes long to end. Yields its path."""
    (pod,) = eventually(lambda: tenant.listed("pods"), what=tenant.children)
    path = f"/api/v1/namespaces/{tenant.namespace}/pods/{pod['metadata']['name']}"
    tenant.cp.api.patch(path, {"metadata": {"finalizers": HELD}})
    try:
        yield path
    finally:
        tenant.cp.api.patch(path, {"metadata": {"finalizers": None}})


def wait_until_ending(tenant: Tenant, path: str, *, generation: int) -> None:
    """Waits until the pod is being deleted and the operator has seen the edit that is why."""
    eventually(
        lambda: tenant.cp.api.get(path)["metadata"].get("deletionTimestamp"),
        what=lambda: (tenant.cp.api.get(path), tenant.children()),
    )
    eventually(lambda: tenant.app("turn")["status"].get("observedGeneration") == generation)


def test_a_component_that_becomes_a_job_and_back_never_has_two_live_pods_under_another_scheduler(
    installed_plane: ControlPlane, namespace: str, ids: str, tmp_path: Path
) -> None:
    tenant = Tenant(installed_plane, namespace)
    free, nowhere = {}, {"template": {"spec": {"nodeSelector": {"example.com/free": "true"}}}}
    with kube_scheduler(installed_plane, tmp_path), Recorder(installed_plane) as recorder:
        eventually(lambda: recorder.passed.get("Pod", 0))
        tenant.apply("turn", part("save", **free), schedulerName=THEIRS, ros2={"pool": ids})
        tenant.wait_ready("turn")
        with held_pod(tenant) as path:
            tenant.edit("turn", components=[part("save", job={}, **nowhere)])
            wait_until_ending(tenant, path, generation=2)
            assert not tenant.listed("batch/jobs")
            assert tenant.deployments("save")
        eventually(lambda: tenant.listed("batch/jobs"), what=tenant.children)

        with held_pod(tenant) as path:
            tenant.edit("turn", components=[part("save", **free)])
            wait_until_ending(tenant, path, generation=3)
            assert not tenant.deployments("save")
        tenant.wait_ready("turn")
        assert not tenant.listed("batch/jobs")
        events = recorder.ripe(all_of_them=True)
    report = Report(1, 1)
    mine = [event for event in events if event.obj["metadata"].get("namespace") == namespace and event.kind == "Pod"]
    count_live_pods(mine, report, app="turn")
    assert report.problems == []
    assert report.pods == 2
