"""Which instances of a sweep run, and Jobs that kueue suspends and resumes."""

from typing import Any

import msgspec
from tests.support.factories import UID, component, make_app

from robotapp_api.model.names import QUEUE_NAME
from robotapp_operator.plan.diff.diff import plan, still_running, wanted_children
from robotapp_operator.plan.diff.jobs import judge_progress
from robotapp_operator.plan.diff.turns import LONG_AGO, find_end_of_turn, plan_turns
from robotapp_operator.plan.render.deployments import component_jobs
from robotapp_operator.plan.render.devices.resource_claim import wanted_claims
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import Job
from robotapp_operator.plan.spec.record import parse_record

MATRIX = {"parameters": [{"name": "seed", "values": ["1", "2", "3", "4"]}], "parallelism": 2}


def sweep(*, queue: str = "", **spec: Any) -> App:
    app = make_app(component("sim", job={}), matrix=MATRIX, **spec)
    object.__setattr__(app, "queue", queue)
    return app


def job_of(app: App, instance: str, *, verdict: str = "", **spec: Any) -> Job:
    """The Job as it was made for an instance, with another spec and a condition of its end."""
    (child,) = wanted_children(desired_of(app, instance), domain=Domain(7), parameters={}, running=True)
    conditions = [{"type": verdict, "status": "True", "lastTransitionTime": "2026-01-01T00:00:00Z"}] if verdict else []
    metadata = {
        "name": child.ref.name,
        "namespace": "default",
        "uid": f"job-{instance}",
        "labels": child.labels,
        "annotations": child.annotations,
        "ownerReferences": [{"kind": "RobotApp", "uid": UID, "controller": True}],
    }
    body = {"metadata": metadata, "spec": {**child.spec, **spec}, "status": {"conditions": conditions}}
    return msgspec.convert(body, Job)


def admitted(app: App, jobs: dict[str, list[Job]]) -> frozenset[str]:
    """The instances that may run with these Jobs."""
    finished = {name for name, items in jobs.items() if find_end_of_turn(app, items) == LONG_AGO}
    return plan_turns(app, finished, jobs).admitted


def test_the_next_instances_begin_when_others_have_ended_and_not_before() -> None:
    app = sweep()
    first, second, third, fourth = app.sweep
    assert admitted(app, {}) == {first, second}
    running = {name: [job_of(app, name)] for name in (first, second)}
    assert admitted(app, running) == {first, second}
    ended = {**running, second: [job_of(app, second, verdict="Complete")]}
    assert admitted(app, ended) == {first, third}
    failed = {**ended, first: [job_of(app, first, verdict="Failed")]}
    assert admitted(app, failed) == {third, fourth}


def test_a_job_of_another_spec_has_ended_nothing() -> None:
    app = sweep()
    first, second, third, _ = app.sweep
    other = make_app(component("sim", job={}, args=["other"]), matrix=MATRIX)
    jobs = {first: [job_of(other, first, verdict="Complete")]}
    assert admitted(app, jobs) == {first, second}
    assert third not in admitted(app, jobs)


def test_the_label_of_the_app_is_that_of_its_jobs_which_wait_for_kueue() -> None:
    app = sweep(queue="nightly")
    job = job_of(app, next(iter(app.sweep)))
    assert job.metadata.labels[QUEUE_NAME] == "nightly"
    assert job.spec["suspend"] is True


def test_what_kueue_has_decided_is_not_undone() -> None:
    app = sweep(queue="nightly")
    instance = next(iter(app.sweep))
    for suspended in (True, False):
        job = job_of(app, instance, suspend=suspended)
        assert not changes(app, instance, job)


def test_without_a_queue_a_job_that_somebody_suspended_runs_again() -> None:
    app = sweep()
    instance = next(iter(app.sweep))
    (change,) = changes(app, instance, job_of(app, instance, suspend=True))
    assert change["suspend"] is False


def test_a_suspended_app_deletes_the_jobs_that_kueue_would_resume() -> None:
    app = sweep(queue="nightly")
    instance = next(iter(app.sweep))
    job = job_of(app, instance, suspend=False)
    assert not wanted_children(desired_of(app, instance), domain=Domain(7), parameters={}, running=False)
    observed = {next(iter(refs(app, instance))): job}
    result = plan(app, [], observed, version="1", settled={}, progress=judge(app, job))
    assert list(result.deletes) == [job]


def test_a_job_in_a_queue_has_the_claim_of_its_devices_until_it_has_ended() -> None:
    app = make_app(component("sim", job={}, devices=[{"name": "bus", "type": "can"}]))
    object.__setattr__(app, "queue", "nightly")
    options: dict[str, Any] = {"domain": Domain(7), "parameters": {}, "running": True, "claiming": {"sim"}}
    children = wanted_children(desired_of(app, ""), **options)
    assert [claim.name for claim in wanted_claims(app, children)] == [children[0].ref.name]
    (ended,) = component_jobs(desired_of(app, ""), idle={"sim"}, **options)
    assert wanted_claims(app, [ended]) == []


def test_a_job_whose_app_left_the_queue_is_deleted_when_it_must_not_run() -> None:
    """kueue goes on with a Job that has its label."""
    app = sweep()
    instance = next(iter(app.sweep))
    queued = job_of(sweep(queue="nightly"), instance, suspend=False)
    (ref,) = refs(app, instance)
    for running in (True, False):
        wanted = wanted_children(desired_of(app, instance), domain=Domain(7), parameters={}, running=running)
        result = plan(app, wanted, {ref: queued}, version="1", settled={}, progress=judge(app, queued))
        assert list(result.deletes) == ([] if running else [queued])
        assert not result.changes


def test_an_app_that_is_suspended_and_wrong_stops_a_job_that_kueue_would_resume() -> None:
    app = sweep(queue="nightly")
    instance = next(iter(app.sweep))
    (ref,) = refs(app, instance)
    assert still_running(UID, {ref: job_of(app, instance, suspend=True)})
    assert not still_running(UID, {ref: job_of(app, instance, suspend=True, verdict="Complete")})
    assert not still_running(UID, {ref: job_of(sweep(), instance, suspend=True)})


def test_the_queue_is_read_from_the_label_of_the_app() -> None:
    body = {
        "metadata": {"name": "a", "namespace": "n", "uid": "u", "generation": 1, "labels": {QUEUE_NAME: "nightly"}},
        "spec": {"ros": {"distro": "humble"}, "components": [component("sim", job={})]},
    }
    record = parse_record(body)
    assert record.app is not None
    assert record.app.queue == "nightly"
    body["metadata"]["labels"] = {}
    later = parse_record(body, known=record)
    assert later.app is not None
    assert later.app.queue == ""
    assert later.spec_version != record.spec_version


def refs(app: App, instance: str) -> Any:
    return [
        child.ref for child in wanted_children(desired_of(app, instance), domain=Domain(7), parameters={}, running=True)
    ]


def judge(app: App, job: Job) -> Any:
    from datetime import UTC, datetime

    return judge_progress(app, [job], now=datetime(2026, 1, 1, tzinfo=UTC))


def changes(app: App, instance: str, job: Job) -> list[dict[str, Any]]:
    """The specs that would be written over the Job."""
    wanted = wanted_children(desired_of(app, instance), domain=Domain(7), parameters={}, running=True)
    result = plan(app, wanted, {wanted[0].ref: job}, version="1", settled={}, progress=judge(app, job))
    assert not result.deletes
    return [dict(change.amended or {}) for change in result.changes]
