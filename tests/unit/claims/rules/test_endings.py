"""When an instance has ended: by its jobs' verdicts, by completion, and by its deadline."""

from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
import pytest
from tests.support.claims import objects as make

from robotapp_api.model.names import Annotation, Reason
from robotapp_claims.rules.completion.endings import (
    CompletionRules,
    JobState,
    build_job_state,
    completion_rules_of,
    find_beginning,
    find_deadline,
    find_ending,
    find_failure,
    read_job_state,
)
from robotapp_claims.rules.objects import App, JobCondition, JobSpec
from robotapp_claims.rules.usage import owner_as_used, usage_of

START = "2026-01-01T00:00:00Z"
NOW = datetime(2026, 1, 1, 0, 1, tzinfo=UTC)
RUNNING = JobState(START)
COMPLETE = JobState(START, verdict="Complete", ended="2026-01-01T00:00:30Z")
FAILED = JobState(START, verdict="Failed", ended="2026-01-01T00:00:40Z")


def rules_of(*components: dict[str, Any], **spec: Any) -> CompletionRules | None:
    body = {"metadata": {"name": "a"}, "spec": {"components": components, **spec}}
    return completion_rules_of(msgspec.convert(body, App))


def reason_of(rules: CompletionRules, **jobs: JobState) -> Reason | None:
    ending = find_ending(rules, jobs, now=NOW)
    return ending.reason if ending else None


def test_an_app_of_jobs_alone_ends_with_them_and_one_with_others_runs_on_unless_completion_is_written() -> None:
    job, driver = {"name": "save", "job": {}}, {"name": "driver"}
    assert rules_of(job) == CompletionRules(frozenset({"save"}))
    assert rules_of(driver) is None
    assert rules_of(job, driver) is None
    assert rules_of(job, driver, completion={}) == CompletionRules(frozenset({"save"}))
    assert rules_of(job, {**driver, "replicas": 0}) == CompletionRules(frozenset({"save"}))


def test_a_component_with_schedule_runs_on_and_has_no_part_in_the_end_nor_in_the_deadline() -> None:
    job, nightly = {"name": "save", "job": {}}, {"name": "upload", "job": {}, "schedule": {"cron": "@daily"}}
    assert rules_of(nightly) is None
    assert rules_of(job, nightly) is None
    rules = rules_of(job, nightly, completion={"deadline": "1h"})
    assert rules is not None
    assert rules.jobs == {"save"}
    waiting = JobState("2020-01-01T00:00:00Z", suspended=True, has_schedule=True)
    assert find_deadline(rules, {"save": RUNNING, "upload": waiting}) == datetime(2026, 1, 1, 1, tzinfo=UTC)
    assert find_deadline(rules, {"upload": waiting}) is None


def test_success_names_jobs_and_each_replica_with_an_ordinal_is_one() -> None:
    run = {"name": "run", "job": {}, "replicas": 2, "replicaIdentity": "Ordinal"}
    success = {"operator": "Any", "components": ["run"]}
    found = rules_of(run, {"name": "save", "job": {}}, completion={"success": success, "deadline": "1h"})
    assert found == CompletionRules(frozenset({"run-0", "run-1"}), any_suffices=True, deadline=timedelta(hours=1))


@pytest.mark.parametrize(
    ("first", "second", "all_of_them", "any_of_them"),
    [
        (None, None, None, None),
        (RUNNING, COMPLETE, None, Reason.COMPLETED),
        (COMPLETE, COMPLETE, Reason.COMPLETED, Reason.COMPLETED),
        (FAILED, RUNNING, Reason.JOB_FAILED, None),
        (FAILED, None, Reason.JOB_FAILED, None),
        (FAILED, COMPLETE, Reason.JOB_FAILED, Reason.COMPLETED),
        (FAILED, FAILED, Reason.JOB_FAILED, Reason.JOB_FAILED),
    ],
)
def test_all_or_any_of_the_jobs_decide(
    first: JobState | None, second: JobState | None, all_of_them: Reason | None, any_of_them: Reason | None
) -> None:
    jobs = {name: job for name, job in (("a", first), ("b", second)) if job is not None}
    both = frozenset({"a", "b"})
    assert reason_of(CompletionRules(both), **jobs) == all_of_them
    assert reason_of(CompletionRules(both, any_suffices=True), **jobs) == any_of_them


def test_an_ending_names_the_job_that_decided_it_and_when() -> None:
    later = COMPLETE._replace(ended="2026-01-01T00:00:50Z")
    jobs = {"a": COMPLETE, "b": later}
    both = find_ending(CompletionRules(frozenset(jobs)), jobs, now=NOW)
    first = find_ending(CompletionRules(frozenset(jobs), any_suffices=True), jobs, now=NOW)
    assert both is not None
    assert first is not None
    assert (both.component, both.time, both.is_success) == ("b", later.ended, True)
    assert (first.component, first.time) == ("a", COMPLETE.ended)


def test_the_deadline_runs_from_the_first_job_of_the_newest_generation() -> None:
    rules = CompletionRules(frozenset({"a", "b"}), deadline=timedelta(seconds=60))
    old, new = COMPLETE._replace(generation=1), JobState("2026-01-01T00:00:30Z", generation=2)
    assert find_deadline(rules, {}) is None
    assert reason_of(rules, a=RUNNING) is Reason.DEADLINE_EXCEEDED
    assert reason_of(rules, a=old, b=new) is None
    assert find_deadline(rules, {"a": old, "b": new}) == datetime(2026, 1, 1, 0, 1, 30, tzinfo=UTC)


OUT_OF_TIME = FAILED._replace(ended="2026-01-01T00:00:59Z", reason="DeadlineExceeded")
SIXTY_SECONDS = CompletionRules(frozenset({"a", "b"}), deadline=timedelta(seconds=60), generation=1)


def test_the_reason_stays_when_the_jobs_have_been_ended_by_the_deadline() -> None:
    assert reason_of(SIXTY_SECONDS, a=COMPLETE, b=OUT_OF_TIME) is Reason.DEADLINE_EXCEEDED
    earlier = OUT_OF_TIME._replace(ended="2026-01-01T00:00:30Z")
    assert reason_of(SIXTY_SECONDS, a=COMPLETE, b=earlier) is Reason.JOB_FAILED
    assert (
        reason_of(SIXTY_SECONDS, a=COMPLETE, b=OUT_OF_TIME._replace(reason="BackoffLimitExceeded")) is Reason.JOB_FAILED
    )
    assert reason_of(SIXTY_SECONDS._replace(deadline=None), a=COMPLETE, b=OUT_OF_TIME) is Reason.JOB_FAILED


def test_an_edit_of_the_app_runs_a_job_again_whose_deadline_was_over() -> None:
    """The Job with the other template is deleted, and the one that has completed stays."""
    old = COMPLETE._replace(generation=1)
    assert reason_of(SIXTY_SECONDS, a=old) is Reason.DEADLINE_EXCEEDED
    assert reason_of(SIXTY_SECONDS._replace(generation=2), a=old) is None
    later = JobState("2026-01-01T00:00:30Z", generation=2)
    assert find_deadline(SIXTY_SECONDS._replace(generation=2), {"a": old, "b": later}) == datetime(
        2026, 1, 1, 0, 1, 30, tzinfo=UTC
    )
    assert reason_of(SIXTY_SECONDS._replace(generation=2), a=old, b=old) is Reason.COMPLETED


TWICE = CompletionRules(frozenset({"a", "b"}), max_restarts=2)
"""A failure of one of them starts both again, two times at most."""
AGAIN = RUNNING._replace(attempt=1, restarts=1)


def test_an_instance_that_is_to_be_started_again_has_not_ended() -> None:
    jobs = {"a": COMPLETE, "b": FAILED._replace(reason="BackoffLimitExceeded")}
    assert find_ending(TWICE, jobs, now=NOW) is None
    assert find_failure(TWICE, jobs, now=NOW) == ("b", "BackoffLimitExceeded")
    assert find_failure(TWICE._replace(max_restarts=0), jobs, now=NOW) is None
    assert find_failure(TWICE, {"a": COMPLETE, "b": RUNNING}, now=NOW) is None
    assert find_failure(TWICE, {}, now=NOW) is None


def test_a_job_of_an_earlier_attempt_decides_nothing() -> None:
    assert reason_of(TWICE, a=COMPLETE, b=COMPLETE._replace(attempt=1, restarts=1)) is None
    assert reason_of(TWICE._replace(any_suffices=True), a=COMPLETE, b=AGAIN) is None
    assert find_failure(TWICE, {"a": FAILED, "b": AGAIN}, now=NOW) is None
    both = COMPLETE._replace(attempt=1, restarts=1)
    assert reason_of(TWICE, a=both, b=both) is Reason.COMPLETED


def test_the_last_allowed_attempt_ends_the_instance_and_a_job_that_was_edited_begins_to_count_anew() -> None:
    last = FAILED._replace(attempt=2, restarts=2)
    assert reason_of(TWICE, a=last, b=COMPLETE._replace(attempt=2, restarts=2)) is Reason.JOB_FAILED
    edited = FAILED._replace(attempt=2, restarts=0)
    assert find_failure(TWICE, {"a": edited, "b": last._replace(verdict="Complete")}, now=NOW) == ("a", "")


def test_the_deadline_counts_over_all_attempts_without_the_time_in_which_jobs_waited() -> None:
    rules = SIXTY_SECONDS._replace(max_restarts=3)
    waited = FAILED._replace(generation=1, started="2026-01-01T00:00:20Z")
    began = find_beginning({"a": waited})
    assert began == "2026-01-01T00:00:20Z"
    again = JobState("2026-01-01T00:00:50Z", generation=1, attempt=1, restarts=1, began=began)
    end = datetime(2026, 1, 1, 0, 1, 20, tzinfo=UTC)
    assert find_deadline(rules, {"a": again}) == find_deadline(rules, {}, began=began) == end
    late = FAILED._replace(generation=1, created="2026-01-01T00:00:50Z", attempt=1, restarts=1, began=START)
    assert find_failure(rules, {"a": late}, now=NOW) is None
    assert reason_of(rules, a=late) is Reason.DEADLINE_EXCEEDED
    assert reason_of(rules, a=OUT_OF_TIME._replace(generation=1)) is Reason.DEADLINE_EXCEEDED


@pytest.mark.parametrize("text", ["", "-1", "x", "9" * 5000, "٣", "1e3"])
def test_what_people_write_into_the_annotations_of_a_job_is_no_number(text: str) -> None:
    annotations = {str(key): text for key in (Annotation.ATTEMPT, Annotation.RESTARTS, Annotation.APP_GENERATION)}
    state = build_job_state(annotations, (), created=START, started=None, suspended=False)
    assert (state.attempt, state.restarts, state.generation) == (0, 0, 0)


@pytest.mark.parametrize("text", ["soon", "2026-01-01T00:00:00", "0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59Z"])
def test_what_people_write_as_the_beginning_of_a_job_does_not_count(text: str) -> None:
    state = build_job_state({str(Annotation.BEGAN): text}, (), created=START, started=None, suspended=False)
    assert find_beginning({"a": state}) == START
    later = state._replace(began="2026-01-01T00:00:30Z")
    assert find_beginning({"a": later}) == START


@pytest.mark.parametrize("time", ["9999-12-31T23:59:59Z", "0001-01-01T00:00:00Z", "2026-01-01T00:00:60Z"])
def test_no_time_in_the_status_of_a_job_stops_the_rule(time: str) -> None:
    rules = CompletionRules(frozenset({"save"}), deadline=timedelta(days=3650), max_restarts=1)
    ended = FAILED._replace(ended=time, started=time, reason="DeadlineExceeded")
    assert find_failure(rules, {"save": ended}, now=NOW) is not None
    assert find_deadline(rules, {"save": RUNNING._replace(started=time)}) is not None


def test_time_in_which_jobs_are_suspended_or_wait_in_a_queue_does_not_count() -> None:
    rules = SIXTY_SECONDS._replace(generation=0)
    assert reason_of(rules, a=RUNNING) is Reason.DEADLINE_EXCEEDED
    assert reason_of(rules, a=RUNNING._replace(suspended=True)) is None
    begun = RUNNING._replace(started="2026-01-01T00:00:20Z")
    overlapping = JobState("2026-01-01T00:00:10Z", started="2026-01-01T00:00:25Z")
    assert find_deadline(rules, {"a": begun}) == datetime(2026, 1, 1, 0, 1, 20, tzinfo=UTC)
    assert find_deadline(rules, {"a": begun, "b": overlapping}) == datetime(2026, 1, 1, 0, 1, 25, tzinfo=UTC)


def test_a_job_that_was_resumed_and_is_not_started_yet_counts_as_suspended() -> None:
    job = make.job(7)
    stopped = msgspec.structs.replace(
        job.status, conditions=(JobCondition(type="Suspended", status="True"),), start_time=START
    )
    state = read_job_state(msgspec.structs.replace(job, status=stopped))
    assert (state.suspended, state.started) == (True, START)
    assert read_job_state(msgspec.structs.replace(job, spec=JobSpec(suspend=True))).suspended
    assert not read_job_state(job).suspended


def test_a_deadline_of_any_length_is_read() -> None:
    found = rules_of({"name": "save", "job": {}}, completion={"deadline": "999999h999999h999999h"})
    assert found is not None
    assert found.deadline is not None
    assert find_ending(found, {"save": RUNNING}, now=NOW) is None


def test_a_job_uses_its_domain_until_it_has_ended_and_is_known_afterwards() -> None:
    claim = make.domain_claim(7, make.app_holder("uid-1"))
    running, ended = make.job(7, of=make.labels("uid-1")), make.job(7, of=make.labels("uid-1"), verdict="Failed")
    assert usage_of(jobs=[running]).uses(claim, app_exists=True)
    assert not usage_of(jobs=[running]).uses(claim, app_exists=False)
    usage = usage_of(jobs=[ended])
    assert not usage.uses(claim, app_exists=True)
    assert list(usage.jobs.values()) == [{"save": read_job_state(ended)}]
    assert usage.named_by_instance("team", "uid-1") == {"": frozenset()}


def test_a_job_that_only_claims_to_be_an_apps_counts_for_nothing() -> None:
    forged = msgspec.structs.replace(
        make.job(7), metadata=msgspec.structs.replace(make.job(7).metadata, owner_references=())
    )
    usage = usage_of(jobs=[forged])
    assert not usage.jobs
    assert not usage.owned


def test_a_sweep_reads_the_attempt_of_a_job_and_not_of_one_that_is_being_deleted() -> None:
    job = make.job(7, of=make.labels("uid-1"), verdict="Failed")
    marks = {str(Annotation.ATTEMPT): "2", str(Annotation.RESTARTS): "1", str(Annotation.BEGAN): START}
    meta = msgspec.structs.replace(job.metadata, annotations={**job.metadata.annotations, **marks})
    marked = owner_as_used(msgspec.structs.replace(job, metadata=meta))
    ((state,),) = (states.values() for states in usage_of(jobs=[marked]).jobs.values())
    assert (state.attempt, state.restarts, state.began) == (2, 1, START)
    going = msgspec.structs.replace(job, metadata=msgspec.structs.replace(meta, deletion_timestamp=START))
    usage = usage_of(jobs=[going])
    assert list(usage.jobs.values()) == [{}]
    assert usage.named_by_instance("team", "uid-1") == {"": frozenset()}


@pytest.mark.parametrize("record", [Annotation.DUE_AT, Annotation.SETTLED_AT])
def test_the_sweep_leaves_runs_of_a_schedule_out_as_the_operator_does(record: Annotation) -> None:
    rules = CompletionRules(frozenset({"save"}), deadline=timedelta(hours=1), max_restarts=2)
    failed = make.job(7, verdict="Failed", created="2026-01-01T12:00:00Z")
    run = make.job(7, component="upload", verdict="Complete", created="2026-01-01T02:00:00Z")
    run.metadata.annotations[record.value] = "2026-01-01T02:00:00Z"
    (whole,) = usage_of(jobs=[failed, run]).jobs.values()
    (kept,) = usage_of(jobs=map(owner_as_used, [failed, run])).jobs.values()
    assert kept == whole
    assert kept["upload"].has_schedule
    assert find_ending(rules, kept, now=datetime(2026, 1, 1, 12, 5, tzinfo=UTC)) is None, "a restart is owed"
