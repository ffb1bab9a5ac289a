"""What a user is told of components that end: of each job, and of the app when its instances have ended."""

import dataclasses
from typing import Any

import msgspec
import pytest
from tests.support.factories import component, make_app, make_deployment, make_pod
from tests.unit.plan.status.test_status import UP, condition, instance, message, status_of

from robotapp_api.model.names import Condition, EventReason, Label, Phase, Reason
from robotapp_claims.rules.completion.endings import Ending
from robotapp_operator.plan.diff.attempts import Attempt
from robotapp_operator.plan.spec.desired import find_deletion_time
from robotapp_operator.plan.spec.objects import Job, Pod
from robotapp_operator.plan.status.components import ComponentView, component_view, job_view
from robotapp_operator.plan.status.events import events_between

PART = make_app(component("save", job={})).spec.components[0]
DONE = dataclasses.replace(UP, name="save", is_job=True, completed=True, nodes=())
AT = "2026-01-01T00:00:30Z"
COMPLETED = Ending(Reason.COMPLETED, "save", AT)
FAILED = Ending(Reason.JOB_FAILED, "save", AT)
BROKEN = dataclasses.replace(
    DONE, ready=False, completed=False, reason=Reason.JOB_FAILED, message="BackoffLimitExceeded"
)
SPEC = {"components": [component("save", job={})]}


def job(verdict: str = "", **condition: str) -> Job:
    conditions = [{"type": verdict, "status": "True", "lastTransitionTime": AT, **condition}] if verdict else []
    body = {
        "metadata": {"name": "map-save", "labels": {Label.APP.value: "map"}},
        "spec": {},
        "status": {"conditions": conditions},
    }
    return msgspec.convert(body, Job)


def ended_pod(code: int, *, phase: str = "Failed", words: str = "") -> Pod:
    state = {"terminated": {"exitCode": code, "reason": "Error", "message": words}}
    return make_pod(f"p{code}", status={"phase": phase, "containerStatuses": [{"name": "save", "state": state}]})


def view(given: Job | None, *pods: Pod, **options: Any) -> ComponentView:
    return job_view(PART, given, pods, **options)


def test_a_job_that_has_completed_is_ready_wants_no_node_and_says_when() -> None:
    shown_view = view(job("Complete"), ended_pod(0, phase="Succeeded"))
    assert (shown_view.ready, shown_view.completed, shown_view.bound, shown_view.nodes, shown_view.badness) == (
        True,
        True,
        True,
        (),
        0,
    )
    assert shown_view.message == f"completed at {AT}"


def test_a_job_that_has_failed_shows_its_last_exit_its_log_and_how_it_runs_again() -> None:
    shown_view = view(
        job("Failed", reason="BackoffLimitExceeded", message="too many attempts"), ended_pod(3, words="no map")
    )
    assert shown_view.reason is Reason.JOB_FAILED
    assert "BackoffLimitExceeded: too many attempts, last with exit code 3 (Error): no map" in shown_view.message
    assert "kubectl logs job/map-save" in shown_view.message
    assert "kubectl robotapp runs map --failed runs it again" in shown_view.message


def test_a_job_that_was_ended_with_its_instance_has_not_failed_by_itself() -> None:
    shown_view = view(job("Failed", reason="DeadlineExceeded"), ending=COMPLETED)
    assert (shown_view.reason, shown_view.message) == (None, "ended with its instance (Completed)")


def test_a_running_job_is_ready_with_its_pod_and_counts_failed_attempts() -> None:
    running = make_pod(node="edge-1", status={"conditions": [{"type": "Ready", "status": "True"}]})
    shown_view = view(job(), running, ended_pod(3))
    assert (shown_view.ready, shown_view.bound, shown_view.nodes, shown_view.restarts) == (True, True, ("edge-1",), 1)
    waiting = view(job(), make_pod(node="edge-1"), ended_pod(3))
    assert (waiting.ready, waiting.message) == (False, "1 of 1 attempts failed, last with exit code 3 (Error)")


def test_a_job_that_is_not_made_yet_waits_and_one_that_is_not_needed_any_more_was_not_started() -> None:
    assert view(None, wait="waits until a is Complete (dependsOn)").message == "waits until a is Complete (dependsOn)"
    assert view(None, ending=FAILED).message == "was not started, because the instance has ended (JobFailed)"


def test_a_program_without_job_that_ends_with_0_is_told_the_cure_at_once() -> None:
    part = make_app(component("driver")).spec.components[0]
    shown_view = component_view(part, make_deployment(), [ended_pod(0, phase="Running")])
    assert shown_view.reason is Reason.PROGRAM_ENDED
    assert shown_view.message.endswith("write job: {} in it if it is to end")


def test_an_app_whose_instances_have_completed_is_completed_with_counts_time_and_event() -> None:
    running = status_of(instance(dataclasses.replace(DONE, completed=False)), app=SPEC)
    status = status_of(instance(DONE, ending=COMPLETED, needs_domain=False, domain=None), app=SPEC)
    assert status["phase"] == Phase.COMPLETED
    assert (status["instanceCounts"]["completed"], status["instanceCounts"]["failed"]) == (1, 0)
    assert condition(status, Condition.READY) == ("False", Reason.COMPLETED)
    assert message(status, Condition.READY) == f"1 of 1 instance has completed at {AT}"
    assert condition(status, Condition.PLACED) == ("Unknown", Reason.COMPLETED)
    assert status["summary"]["ready"] == "1/1"
    assert status["troubled"] == []
    reasons = [event.reason for event in events_between(running, status, new_domains={})]
    assert EventReason.COMPLETED in reasons


def test_an_app_whose_jobs_have_failed_is_failed_with_the_reason() -> None:
    status = status_of(instance(BROKEN, ending=FAILED, needs_domain=False, domain=None), app=SPEC)
    assert status["phase"] == Phase.FAILED
    assert status["instanceCounts"]["failed"] == 1
    assert condition(status, Condition.READY) == ("False", Reason.JOB_FAILED)
    assert message(status, Condition.READY) == "1 of 1 instance has failed; save: BackoffLimitExceeded"
    assert [each["reason"] for each in status["troubled"]] == [Reason.JOB_FAILED]


def test_a_deadline_that_has_passed_names_its_field() -> None:
    ending = Ending(Reason.DEADLINE_EXCEEDED, time=AT)
    late = instance(BROKEN, ending=ending, needs_domain=False, domain=None, app_name="map")
    told = message(status_of(late, app=SPEC), Condition.READY)
    assert "(spec.completion.deadline)" in told
    assert "kubectl robotapp runs map --failed" in told


@pytest.mark.parametrize(
    ("others", "phase"),
    [
        ([UP], Phase.RUNNING),
        ([dataclasses.replace(UP, ready=False)], Phase.PLACING),
    ],
)
def test_while_an_instance_runs_the_completed_ones_do_not_decide(others: list[ComponentView], phase: Phase) -> None:
    ended = instance(DONE, robot="a", ending=COMPLETED, needs_domain=False, domain=None)
    status = status_of(ended, instance(*others, robot="b"), app=SPEC)
    assert status["phase"] == phase
    assert status["instanceCounts"]["completed"] == 1


def test_a_failed_instance_beside_one_that_runs_degrades_the_app() -> None:
    ended = instance(BROKEN, robot="a", ending=FAILED, needs_domain=False, domain=None)
    assert status_of(ended, instance(robot="b"), app=SPEC)["phase"] == Phase.DEGRADED


def test_an_app_whose_driver_waits_for_a_job_that_has_failed_is_degraded() -> None:
    waits = dataclasses.replace(UP, ready=False, exists=False, bound=False, waits=True, message="waits for save")
    failed = dataclasses.replace(BROKEN, bound=False)
    status = status_of(instance(failed, waits), app=SPEC)
    assert status["phase"] == Phase.DEGRADED
    assert condition(status, Condition.READY) == ("False", Reason.JOB_FAILED)


def test_an_app_with_ttl_has_its_end_and_when_it_is_deleted_and_one_that_runs_or_is_suspended_has_not() -> None:
    app = SPEC | {"completion": {"ttl": "1h"}}
    ended = instance(DONE, ending=COMPLETED, needs_domain=False, domain=None)
    status = status_of(ended, app=app)
    assert status["completionTime"] == AT
    text = "1 of 1 instance has completed at 2026-01-01T00:00:30Z; it is deleted at 2026-01-01T01:00:30Z (spec.completion.ttl)"
    assert message(status, Condition.READY) == text
    failed = status_of(instance(BROKEN, ending=FAILED, needs_domain=False, domain=None), app=app)
    assert message(failed, Condition.READY).endswith("it is deleted at 2026-01-01T01:00:30Z (spec.completion.ttl)")
    assert "completionTime" not in status_of(instance(DONE), app=app)
    assert "completionTime" not in status_of(ended, app=app | {"suspend": True})
    assert status_of(ended, app=SPEC)["completionTime"] == AT


@pytest.mark.parametrize("end", ["9999-12-31T23:59:59Z", "2026-01-01T00:00:60Z", "2026-01-01t00:00:00z", "soon"])
def test_an_end_that_is_no_usable_moment_has_no_time_of_deletion(end: str) -> None:
    app = make_app(component("save", job={}), completion={"ttl": "1h"})
    assert find_deletion_time(app, end) is None
    ended = instance(DONE, ending=COMPLETED._replace(time=end), needs_domain=False, domain=None)
    assert "it is deleted" not in message(status_of(ended, app=SPEC | {"completion": {"ttl": "1h"}}), Condition.READY)


def test_the_end_of_an_app_is_that_of_its_last_instance() -> None:
    first = instance(DONE, robot="a", ending=COMPLETED, needs_domain=False, domain=None)
    later = COMPLETED._replace(time="2026-01-01T00:09:00Z")
    second = instance(DONE, robot="b", ending=later, needs_domain=False, domain=None)
    assert status_of(first, second, app=SPEC)["completionTime"] == later.time
    assert "completionTime" not in status_of(first, instance(robot="b"), app=SPEC)


AGAIN = Attempt(1, 1, message="restarted 1 of 3 times: job save failed (BackoffLimitExceeded)")


def test_a_job_that_is_to_run_again_has_not_failed_for_good_and_its_successor_has_why() -> None:
    for given in (job("Failed", reason="BackoffLimitExceeded"), None, job()):
        component_status = view(given, attempt=AGAIN)
        assert (component_status.reason, component_status.message) == (None, AGAIN.message)
    assert view(job("Complete"), attempt=AGAIN).message == f"completed at {AT}"
    running = make_pod(node="edge-1", status={"conditions": [{"type": "Ready", "status": "True"}]})
    assert view(job(), running, attempt=AGAIN).message == ""


def test_an_instance_that_starts_again_is_starting_and_no_event_reports_a_failure() -> None:
    waits = view(None, attempt=AGAIN)
    status = status_of(instance(waits, attempt=AGAIN), app=SPEC)
    assert status["phase"] == Phase.PENDING
    assert AGAIN.message in message(status, Condition.READY)
    events = events_between(status_of(instance(DONE), app=SPEC), status, new_domains={})
    assert EventReason.JOB_FAILED not in [event.reason for event in events]


def test_an_instance_that_has_failed_for_good_has_how_often_it_was_started_again() -> None:
    ended = instance(BROKEN, ending=FAILED, needs_domain=False, domain=None, attempt=AGAIN)
    text = message(status_of(ended, app=SPEC), Condition.READY)
    assert text == "1 of 1 instance has failed; save: BackoffLimitExceeded; restarts before: 1"
