"""Instances that are started again when a job has failed: which attempt is theirs, what is recorded, and which Jobs are replaced."""

from typing import Any

import msgspec
import pytest
from tests.support.factories import VERSION, component, make_app
from tests.unit.plan.jobs.test_jobs import DOMAIN, NOW, Observed, stored

from robotapp_api.model.names import Annotation
from robotapp_operator.plan.diff.attempts import Attempt, read_attempt, render_attempt
from robotapp_operator.plan.diff.diff import Plan, plan, wanted_children
from robotapp_operator.plan.diff.jobs import Progress, judge_progress
from robotapp_operator.plan.render.child import DEPLOYMENT, JOB, Child
from robotapp_operator.plan.spec.desired import App, desired_of
from robotapp_operator.plan.spec.objects import Deployment, pod_annotations

AT = "2026-01-01T00:00:30Z"


def app_of(*parts: dict[str, Any], max_restarts: int = 2, **completion: Any) -> App:
    parts = parts or (component("calibrate", job={}), component("save", job={}))
    return make_app(*parts, completion={"maxRestarts": max_restarts, **completion})


def job(app: App, name: str, *, verdict: str = "", attempt: int = 0, restarts: int = 0, began: str = "") -> Observed:
    observed = stored(app, name=name, verdict=verdict)
    ((ref, item),) = observed.items()
    marks = Attempt(attempt, restarts, began=began).annotations
    item.metadata.annotations.update(marks)
    return {ref: item}


def progress_of(app: App, observed: Observed, status: dict[str, Any] | None = None) -> Progress:
    return judge_progress(app, observed.values(), now=NOW, status=status or {})


def record(app: App, number: int, restarts: int, **more: Any) -> dict[str, Any]:
    """Returns the status of a RobotAppInstance with the record."""
    return {"restarts": render_attempt(Attempt(number, restarts, app.all_runs_hash)), **more}


def plan_of(app: App, observed: Observed, status: dict[str, Any]) -> Plan:
    progress = progress_of(app, observed, status)
    wanted = wanted_children(
        desired_of(app, ""), domain=DOMAIN, parameters={}, running=True, observed=observed, progress=progress
    )
    return plan(app, wanted, observed, version=VERSION, settled={}, progress=progress)


def names(items: Any) -> list[str]:
    return sorted(item.metadata.labels["robotics.io/component"] for item in items)


def jobs_in(result: Plan) -> dict[str, Child]:
    """Returns the Jobs that are written, by component."""
    return {change.child.component: change.child for change in result.changes if change.child.ref.kind == JOB}


def test_a_failure_asks_for_the_next_attempt_and_nothing_is_replaced_before_it_is_recorded() -> None:
    app = app_of()
    observed = job(app, "calibrate", verdict="Complete") | job(app, "save", verdict="Failed")
    following = progress_of(app, observed).next_attempt
    assert following is not None
    assert (following.number, following.restarts, following.began) == (1, 1, "2026-01-01T00:00:00Z")
    assert following.message == "restarted 1 of 2 times: job save failed"
    result = plan_of(app, observed, {})
    assert (result.deletes, jobs_in(result)) == ((), {})


def test_a_suspended_app_is_not_started_again_until_it_is_resumed() -> None:
    parts = component("calibrate", job={}), component("save", job={})
    suspended = make_app(*parts, completion={"maxRestarts": 2}, suspend=True)
    observed = job(suspended, "calibrate", verdict="Complete") | job(suspended, "save", verdict="Failed")
    progress = progress_of(suspended, observed)
    assert (progress.next_attempt, progress.ending) == (None, None)
    assert not plan_of(suspended, observed, {}).deletes
    assert progress_of(app_of(*parts), observed).next_attempt is not None


def test_when_it_is_recorded_all_jobs_are_replaced_also_those_that_have_completed() -> None:
    app = app_of()
    observed = job(app, "calibrate", verdict="Complete") | job(app, "save", verdict="Failed")
    result = plan_of(app, observed, record(app, 1, 1))
    assert names(result.deletes) == ["calibrate", "save"]
    assert jobs_in(result) == {}
    created = jobs_in(plan_of(app, {}, record(app, 1, 1)))
    marks = {name: child.annotations[Annotation.ATTEMPT] for name, child in created.items()}
    assert marks == {"calibrate": "1", "save": "1"}


def test_a_job_that_is_being_deleted_is_waited_for() -> None:
    app = app_of(component("save", job={}))
    observed = job(app, "save", verdict="Failed")
    ((ref, item),) = observed.items()
    deleted_job = stored(app, verdict="Failed", deletionTimestamp=AT)[ref]
    result = plan_of(app, {ref: deleted_job}, record(app, 1, 1))
    assert (result.deletes, jobs_in(result)) == ((), {})
    assert names(plan_of(app, {ref: item}, record(app, 1, 1)).deletes) == ["save"]


def test_components_that_run_on_start_anew_with_each_attempt_and_not_before_the_first_restart() -> None:
    app = app_of(component("driver"), component("save", job={}))
    assert marks_of_deployments(app, {}) == [None]
    assert marks_of_deployments(app, record(app, 3, 1)) == ["3"]


@pytest.mark.parametrize("jobs_left", [True, False], ids=["as before", "edited or not there"])
def test_components_that_run_on_do_not_start_anew_when_nothing_is_started_again_any_more(jobs_left: bool) -> None:
    before = app_of(component("driver"), component("save", job={}))
    observed = job(before, "save", attempt=1, restarts=1) if jobs_left else {}
    status = record(before, 1, 1)
    for completion in ({"completion": {"maxRestarts": 0}}, {}):
        edited = make_app(component("driver"), component("save", job={}, args=["again"]), **completion)
        after = make_app(component("driver"), component("save", job={}), **completion)
        assert marks_of_deployments(after, status, observed) == ["1"]
        assert marks_of_deployments(edited, status, observed) == ["1"]
        assert progress_of(edited, {}, status).attempt.number == 1, (
            "the edited job has it as well, so it is not replaced"
        )
        assert not plan_of(after, observed, status).deletes
    assert marks_of_deployments(make_app(component("driver")), status, observed) == ["1"]
    assert render_attempt(progress_of(make_app(component("driver")), {}, status).attempt) == {"count": 0, "attempt": 1}


def marks_of_deployments(app: App, status: dict[str, Any], observed: Observed | None = None) -> list[str | None]:
    """The attempts in the templates of components that run on."""
    changes = plan_of(app, observed or {}, status).changes
    children = [change.child for change in changes if change.child.ref.kind == DEPLOYMENT and change.child.component]
    return [pod_annotations(child.spec).get(Annotation.ATTEMPT) for child in children]


def test_the_jobs_alone_decide_when_no_restart_is_left() -> None:
    app = app_of(component("save", job={}), max_restarts=1)
    last = job(app, "save", verdict="Failed", attempt=1, restarts=1)
    for status in ({}, record(app, 1, 1), record(app, 1, 0), record(app, 5, 0)):
        progress = progress_of(app, last, status)
        assert progress.ending is not None
        assert progress.next_attempt is None
        assert not plan_of(app, last, status).deletes


def test_an_instance_that_had_ended_begins_to_count_anew_when_somebody_deletes_its_job() -> None:
    app = app_of(component("save", job={}), max_restarts=1)
    assert progress_of(app, {}, record(app, 1, 1, completionTime=AT)).attempt == Attempt(1, 0, app.all_runs_hash)
    assert progress_of(app, {}, record(app, 1, 1)).attempt.restarts == 1


def test_an_edit_of_a_job_begins_to_count_anew_and_runs_no_other_job_again() -> None:
    before = app_of()
    after = app_of(component("calibrate", job={}), component("save", job={}, args=["again"]))
    observed = job(before, "calibrate", verdict="Complete", attempt=2, restarts=2)
    observed |= job(before, "save", verdict="Failed", attempt=2, restarts=2)
    status = record(before, 2, 2)
    assert progress_of(after, observed, status).attempt == Attempt(2, 0, after.all_runs_hash)
    assert names(plan_of(after, observed, status).deletes) == ["save"]
    failed = job(after, "save", verdict="Failed", attempt=2, restarts=0)
    again = progress_of(after, observed | failed, status).next_attempt
    assert again is not None
    assert (again.number, again.restarts) == (3, 1)


def test_a_record_that_was_deleted_is_made_anew_of_what_the_jobs_say() -> None:
    app = app_of()
    observed = job(app, "calibrate", attempt=2, restarts=1, began=AT) | job(
        app, "save", attempt=2, restarts=1, began=AT
    )
    assert progress_of(app, observed).attempt == Attempt(2, 1, app.all_runs_hash, AT)


def test_less_restarts_in_the_spec_end_an_instance_that_waits_for_its_next_attempt() -> None:
    app = app_of(component("save", job={}), max_restarts=0)
    failed = job(app, "save", verdict="Failed")
    assert progress_of(app, failed, record(app, 1, 1)).ending is not None
    assert not plan_of(app, failed, record(app, 1, 1)).deletes


def test_a_job_that_waits_for_another_waits_for_it_in_each_attempt() -> None:
    after = [{"component": "calibrate", "status": "Complete"}]
    app = app_of(component("calibrate", job={}), component("save", job={}, dependsOn=after))
    done = job(app, "calibrate", verdict="Complete")
    assert names(plan_of(app, done, record(app, 1, 1)).deletes) == ["calibrate"]
    assert list(jobs_in(plan_of(app, {}, record(app, 1, 1)))) == ["calibrate"]
    again = job(app, "calibrate", verdict="Complete", attempt=1, restarts=1)
    result = plan_of(app, again, record(app, 1, 1))
    assert list(jobs_in(result)) == ["save"]


def test_the_time_of_earlier_attempts_counts_for_the_deadline_of_a_new_job() -> None:
    app = app_of(component("save", job={}), deadline="90s")
    status = {"restarts": render_attempt(Attempt(1, 1, app.all_runs_hash, "2026-01-01T00:00:00Z"))}
    limit = jobs_in(plan_of(app, {}, status))["save"].spec["activeDeadlineSeconds"]
    assert limit == 30


@pytest.mark.parametrize("status", [{}, {"restarts": None}, {"restarts": {}}, {"restarts": {"count": 0, "attempt": 0}}])
def test_an_instance_that_was_never_started_again_has_no_record_and_no_annotation(status: dict[str, Any]) -> None:
    assert read_attempt(status) is None
    app = app_of()
    assert progress_of(app, job(app, "save"), status).attempt.annotations == {}
    assert render_attempt(progress_of(app, {}, status).attempt) is None


@pytest.mark.parametrize("writer", ["9.0.0", "0.0.1"], ids=["newer", "older, held until it is approved"])
def test_templates_that_are_not_written_anew_start_their_pods_anew_all_the_same(writer: str) -> None:
    app = make_app(
        component("driver"),
        component("save", job={}),
        completion={"maxRestarts": 2},
        update={"operator": "OnDemand"},
    )
    (child,) = (
        change.child
        for change in plan_of(app, {}, {}).changes
        if change.child.ref.kind == DEPLOYMENT and change.child.component
    )
    body = child.body(app, version=writer)
    body["metadata"] |= {"uid": "uid-driver", "resourceVersion": "1"}
    body["metadata"]["annotations"][Annotation.CONTENT_HASH.value] = "of its own"
    observed: Observed = {child.ref: msgspec.convert(body, Deployment)}
    (change,) = (change for change in plan_of(app, observed, record(app, 1, 1)).changes if change.over is not None)
    assert change.amended is not None
    assert pod_annotations(change.amended)[Annotation.ATTEMPT] == "1"
