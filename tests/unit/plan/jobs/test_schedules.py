"""Components with schedule: when their runs are made, kept, skipped and explained."""

import dataclasses
from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
import pytest
from tests.support.factories import VERSION, component, make_app

from robotapp_api.model.names import QUEUE_NAME, Annotation, Reason
from robotapp_operator.plan.diff.attempts import Attempt
from robotapp_operator.plan.diff.diff import Plan, plan, wanted_children
from robotapp_operator.plan.diff.jobs import judge_progress
from robotapp_operator.plan.render.child import JOB, Child
from robotapp_operator.plan.render.devices.ledger import DriverNodes, claiming_components
from robotapp_operator.plan.render.devices.resource_claim import wanted_claims
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job
from robotapp_operator.plan.spec.validate import problems_alone
from robotapp_operator.plan.status.components import ComponentView, job_view, scheduled_view

DOMAIN = Domain(7, "dds.default.c.7")
NIGHTLY = {"cron": "0 2 * * *", "timeZone": "Europe/Athens"}
EVENING = datetime(2026, 11, 29, 20, 0, tzinfo=UTC)
DUE = datetime(2026, 11, 30, 0, 0, tzinfo=UTC)
"""Two o'clock in Athens."""
DAY = timedelta(days=1)
MINUTE = timedelta(minutes=1)
Observed = dict[ChildRef, Any]


def app_of(
    *others: dict[str, Any], schedule: dict[str, Any] = NIGHTLY, spec: dict[str, Any] | None = None, **part: Any
) -> App:
    return make_app(component("backup", job={}, schedule=schedule, **part), *others, **(spec or {}))


def children_of(app: App, observed: Observed, now: datetime, domain: Domain = DOMAIN) -> list[Child]:
    progress = judge_progress(app, observed.values(), now=now)
    running = not app.spec.suspend
    children = wanted_children(
        desired_of(app, ""), domain=domain, parameters={}, running=running, observed=observed, progress=progress
    )
    return children if running else [child for child in children if child.ref in observed]


def plan_of(app: App, observed: Observed, now: datetime, domain: Domain = DOMAIN) -> Plan:
    progress = judge_progress(app, observed.values(), now=now)
    wanted = children_of(app, observed, now, domain)
    planned = plan(app, wanted, observed, version=VERSION, settled={}, progress=progress)
    changes = tuple(change for change in planned.changes if change.child.ref.kind == JOB)
    return Plan(changes, tuple(item for item in planned.deletes if isinstance(item, Job)))


def store(child: Child, app: App, *, verdict: str = "", ended: datetime = DUE + MINUTE, **meta: Any) -> Observed:
    """Returns the Job as the API server has it."""
    body = child.body(app, version=VERSION)
    body["metadata"] |= {
        "uid": f"uid-{child.ref.name}",
        "resourceVersion": "1",
        "creationTimestamp": "2026-11-29T20:00:00Z",
        **meta,
    }
    condition = {
        "type": verdict,
        "status": "True",
        "lastTransitionTime": ended.isoformat(),
        "reason": "BackoffLimitExceeded",
    }
    body["status"] = {"conditions": [condition] if verdict else []}
    return {child.ref: msgspec.convert(body, Job)}


def only_job(app: App, observed: Observed, now: datetime) -> Child:
    (child,) = [child for child in children_of(app, observed, now) if child.component == "backup"]
    return child


def mark(app: App) -> Observed:
    """Returns the only Job of an app that got its schedule in the evening: the mark."""
    return store(only_job(app, {}, EVENING), app)


def first_run(app: App, **status: Any) -> Observed:
    """Returns the Job of the first night, which has taken the place of the mark."""
    return store(only_job(app, mark(app), DUE), app, **status)


def with_annotations(job: Job, annotations: dict[str, str]) -> Job:
    meta = msgspec.structs.replace(job.metadata, annotations={**job.metadata.annotations, **annotations})
    return msgspec.structs.replace(job, metadata=meta)


def mark_deleted(observed: Observed) -> Observed:
    """The Jobs while they are deleted in the foreground: their last pods have not ended."""
    return {
        ref: msgspec.structs.replace(
            job, metadata=msgspec.structs.replace(job.metadata, deletion_timestamp="2026-11-30T00:00:30Z")
        )
        for ref, job in observed.items()
    }


def view_of(app: App, observed: Observed, now: datetime) -> ComponentView:
    progress = judge_progress(app, observed.values(), now=now)
    (part,) = [part for part in app.spec.components if part.name == "backup"]
    view = job_view(part, progress.jobs.get("backup"), (), has_schedule=True)
    return scheduled_view(view, progress.runs["backup"], ending=progress.ending, suspended=app.spec.suspend)


def test_a_schedule_that_was_just_added_runs_at_its_next_time_and_not_before() -> None:
    app = app_of()
    (change,) = plan_of(app, {}, EVENING).changes
    assert change.child.spec["suspend"] is True
    assert change.child.annotations[Annotation.SETTLED_AT] == "2026-11-29T20:00:00Z"
    assert Annotation.DUE_AT not in change.child.annotations
    observed = mark(app)
    assert not plan_of(app, observed, EVENING + MINUTE)
    assert judge_progress(app, observed.values(), now=EVENING).runs_change_at == DUE
    assert not plan_of(app, observed, DUE - timedelta(seconds=1))


def test_a_run_gets_a_job_of_its_own_name_and_its_predecessor_goes_when_that_is_there() -> None:
    app = app_of()
    before = mark(app)
    result = plan_of(app, before, DUE)
    assert result.deletes == ()
    (change,) = result.changes
    assert change.over is None
    assert change.child.spec["suspend"] is False
    assert change.child.annotations[Annotation.DUE_AT] == "2026-11-30T00:00:00Z"
    assert change.child.ref not in before
    both = before | store(change.child, app)
    after = plan_of(app, both, DUE + MINUTE)
    assert after.changes == ()
    assert [item.metadata.name for item in after.deletes] == [ref.name for ref in before]


def test_a_run_that_is_being_made_is_not_lost_where_the_operator_dies_in_between() -> None:
    app = app_of()
    ended = first_run(app, verdict="Complete")
    tomorrow = DUE + DAY
    for seconds in (0, 5, 599):
        result = plan_of(app, ended, tomorrow + timedelta(seconds=seconds))
        assert result.deletes == ()
        assert [change.child.annotations[Annotation.DUE_AT] for change in result.changes] == ["2026-12-01T00:00:00Z"]


def test_a_run_that_is_too_late_is_left_out_and_the_next_one_is_made() -> None:
    app = app_of()
    ended = first_run(app, verdict="Complete")
    late = DUE + 3 * DAY + timedelta(seconds=601)
    (change,) = plan_of(app, ended, late).changes
    assert change.records == {Annotation.MISSED_AT: "2026-12-03T00:00:00Z"}
    reported = {ref: with_annotations(job, dict(change.records)) for ref, job in ended.items()}
    assert not plan_of(app, reported, late)
    assert not plan_of(app, reported, late + DAY), (
        "of several that are missed one after the other the first is recorded"
    )
    assert view_of(app, reported, late).message == (
        "run of 2026-11-30 02:00 Europe/Athens succeeded; that of 2026-12-03 02:00 Europe/Athens was missed, because it could not begin within "
        "600 s (schedule.startingDeadlineSeconds); next run 2026-12-04 02:00 Europe/Athens"
    )
    assert judge_progress(app, ended.values(), now=late).runs_change_at == DUE + 4 * DAY
    patient = app_of(schedule={**NIGHTLY, "startingDeadlineSeconds": 86_400})
    (change,) = plan_of(patient, first_run(patient, verdict="Complete"), late).changes
    assert change.child.annotations[Annotation.DUE_AT] == "2026-12-03T00:00:00Z"


def test_what_is_due_while_a_run_goes_on_is_skipped_and_not_made_up_for() -> None:
    app = app_of(schedule={"cron": "*/5 * * * *"})
    observed = store(only_job(app, mark(app), DUE), app)
    assert not plan_of(app, observed, DUE + 7 * MINUTE)
    text = view_of(app, observed, DUE + 7 * MINUTE).message
    assert text == (
        "run of 2026-11-30 00:00 UTC is under way; that of 2026-11-30 00:05 UTC was skipped, because this one has not ended; next run 2026-11-30 00:10 UTC"
    )
    ended = store(only_job(app, mark(app), DUE), app, verdict="Complete", ended=DUE + 8 * MINUTE)
    assert not plan_of(app, ended, DUE + 9 * MINUTE)
    (change,) = plan_of(app, ended, DUE + 10 * MINUTE).changes
    assert change.child.annotations[Annotation.DUE_AT] == "2026-11-30T00:10:00Z"


def test_an_edit_of_the_program_that_is_seen_after_a_due_time_takes_no_run_away() -> None:
    before, after = app_of(), app_of(args=["--all"])
    for observed in (mark(before), first_run(before, verdict="Complete")):
        due = DUE if observed.keys() == mark(before).keys() else DUE + DAY
        assert not plan_of(after, observed, due - MINUTE)
        (change,) = plan_of(after, observed, due + timedelta(seconds=5)).changes
        assert change.over is None
        assert change.child.spec["template"]["spec"]["containers"][0]["args"] == ["--all"]


def test_another_schedule_begins_with_its_next_time_and_leaves_a_run_that_goes_on_alone() -> None:
    before, after = app_of(), app_of(schedule={"cron": "30 1 * * *"})
    now = DUE + timedelta(hours=1, minutes=31)  # a minute after the new line was due
    running = first_run(before)
    assert not plan_of(after, running, now)
    ended = first_run(before, verdict="Complete")
    (change,) = plan_of(after, ended, now).changes
    assert change.records == {
        Annotation.SCHEDULE_HASH.value: after.schedule_hashes["backup"],
        Annotation.SETTLED_AT.value: "2026-11-30T01:31:00Z",
    }
    assert change.amended is None
    (job,) = ended.values()
    annotations = {**job.metadata.annotations, **change.records}
    settled = {
        ref: msgspec.structs.replace(job, metadata=msgspec.structs.replace(job.metadata, annotations=annotations))
        for ref in ended
    }
    assert not plan_of(after, settled, now + MINUTE)
    (run,) = plan_of(after, settled, now + DAY).changes
    assert run.child.annotations[Annotation.DUE_AT] == "2026-12-01T01:30:00Z"


@pytest.mark.parametrize("fields", [{"spec": {"suspend": True}}, {"replicas": 0}], ids=["app", "component"])
def test_what_is_due_while_suspended_is_skipped(fields: dict[str, Any]) -> None:
    app, stopped = app_of(component("driver")), app_of(component("driver"), **fields)
    ended = first_run(app, verdict="Complete")
    (change,) = plan_of(stopped, ended, DUE + 2 * MINUTE).changes
    assert change.records == {Annotation.SCHEDULE_SUSPENDED: "true"}
    assert "no runs while suspended" in view_of(stopped, ended, DUE + DAY).message
    suspended = {ref: with_annotations(job, dict(change.records)) for ref, job in ended.items()}
    for minutes in range(10):
        assert not plan_of(stopped, suspended, DUE + DAY + minutes * MINUTE), "what is due costs no request"
    (change,) = plan_of(app, suspended, DUE + DAY + 5 * MINUTE).changes
    assert change.over is not None
    assert change.records[Annotation.SETTLED_AT] == "2026-12-01T00:05:00Z"
    resumed = {ref: with_annotations(job, dict(change.records)) for ref, job in suspended.items()}
    assert not plan_of(app, resumed, DUE + DAY + 6 * MINUTE)
    assert [one.over for one in plan_of(app, resumed, DUE + 2 * DAY).changes] == [None]


def test_a_run_that_goes_on_is_suspended_with_its_app_and_goes_on_with_it() -> None:
    app, stopped = app_of(), app_of(spec={"suspend": True})
    running = first_run(app)
    (change,) = plan_of(stopped, running, DUE + MINUTE).changes
    assert change.amended is not None
    assert change.amended["suspend"] is True
    text = "run of 2026-11-30 02:00 Europe/Athens is suspended; no runs while suspended"
    assert view_of(stopped, running, DUE + MINUTE).message == text


def test_each_time_of_a_message_has_its_zone() -> None:
    app = app_of()
    text = "run of 2026-11-30 02:00 Europe/Athens begins; next run 2026-12-01 02:00 Europe/Athens"
    assert view_of(app, mark(app), DUE).message == text


def test_a_component_without_replicas_has_no_runs() -> None:
    app = app_of(component("driver"), replicas=0)
    assert view_of(app, mark(app), EVENING).message == "no runs while suspended"


def test_a_job_that_becomes_one_with_schedule_and_back_is_replaced() -> None:
    plain, scheduled = make_app(component("backup", job={}), component("driver")), app_of(component("driver"))
    job = store(only_job(plain, {}, EVENING), plain, verdict="Complete")
    result = plan_of(scheduled, job, EVENING)
    assert [item.metadata.name for item in result.deletes] == [ref.name for ref in job]
    back = plan_of(plain, first_run(scheduled, verdict="Complete"), DUE + MINUTE)
    assert len(back.deletes) == 1
    assert [Annotation.DUE_AT in change.child.annotations for change in back.changes] == [False]


def test_where_a_schedule_is_removed_the_job_is_made_when_the_last_pod_of_the_run_has_ended() -> None:
    plain, running = make_app(component("backup", job={})), first_run(app_of())
    planned = plan_of(plain, running, DUE + MINUTE)
    assert planned.deletes == tuple(running.values())
    assert planned.changes == ()
    assert not plan_of(plain, mark_deleted(running), DUE + 2 * MINUTE)
    assert [change.over for change in plan_of(plain, {}, DUE + 3 * MINUTE).changes] == [None]


def test_the_first_run_of_a_new_schedule_waits_for_the_last_pod_of_the_job_before() -> None:
    plain, scheduled = make_app(component("backup", job={})), app_of()
    running = store(only_job(plain, {}, EVENING), plain)
    planned = plan_of(scheduled, running, EVENING)
    assert planned.deletes == tuple(running.values())
    assert planned.changes == ()
    (before,) = mark_deleted(running).values()
    assert not plan_of(scheduled, {ChildRef(JOB, "before"): before} | mark(scheduled), DUE)
    assert [change.over for change in plan_of(scheduled, mark(scheduled), DUE + MINUTE).changes] == [None]


@pytest.mark.parametrize("text", ["2026-11-29T21:00:00Z", "2026-12-01T00:00:00Z", "tonight", ""])
def test_a_run_whose_due_time_somebody_has_overwritten_stays_the_only_one_of_its_component(text: str) -> None:
    app, stopped = app_of(), app_of(spec={"suspend": True})
    ((ref, job),) = first_run(app).items()
    running = {ref: with_annotations(job, {Annotation.DUE_AT: text})}
    assert not plan_of(app, running, DUE + MINUTE)
    assert not plan_of(app, running, DUE + DAY + MINUTE)
    (change,) = plan_of(stopped, running, DUE + MINUTE).changes
    assert change.child.ref == ref
    assert change.amended is not None
    assert change.amended["suspend"] is True


def test_nothing_of_a_schedule_is_kept_where_the_instance_or_the_component_is_gone() -> None:
    app, without = app_of(component("driver")), make_app(component("driver"))
    observed = first_run(app, verdict="Complete")
    progress = judge_progress(app, observed.values(), now=DUE)
    assert plan(app, [], observed, version=VERSION, settled={}, progress=progress).deletes == tuple(observed.values())
    assert plan_of(without, observed, DUE + MINUTE).deletes == tuple(observed.values())


def test_another_domain_replaces_a_run_that_goes_on_and_none_that_has_ended() -> None:
    app, other = app_of(), Domain(8, "dds.default.c.8")
    assert plan_of(app, first_run(app), DUE + MINUTE, other).deletes
    assert not plan_of(app, first_run(app, verdict="Complete"), DUE + 2 * MINUTE, other)


def test_a_run_waits_for_what_it_depends_on_and_its_record_stays() -> None:
    app = app_of(component("db"), dependsOn=[{"component": "db"}])
    before = mark(app)
    assert not plan_of(app, before, DUE)
    assert judge_progress(app, before.values(), now=DUE).runs_change_at == DUE + 10 * MINUTE
    (change,) = plan_of(app, before, DUE + 11 * MINUTE).changes
    assert change.records == {Annotation.MISSED_AT: "2026-11-30T00:00:00Z"}
    assert view_of(app, before, DUE + 11 * MINUTE).message.startswith(
        "run of 2026-11-30 02:00 Europe/Athens was missed"
    )
    ready = make_deployment(app, "db")
    (change,) = plan_of(app, before | ready, DUE + MINUTE).changes
    assert change.child.annotations[Annotation.DUE_AT] == "2026-11-30T00:00:00Z"


def make_deployment(app: App, name: str) -> Observed:
    (child,) = [child for child in children_of(app, {}, EVENING) if child.component == name]
    body = child.body(app, version=VERSION)
    body["metadata"] |= {"uid": name, "resourceVersion": "1", "generation": 1}
    body["status"] = {"observedGeneration": 1, "replicas": 1, "readyReplicas": 1, "updatedReplicas": 1}
    return {child.ref: msgspec.convert(body, Deployment)}


def test_a_run_has_the_claim_of_its_devices_and_between_runs_there_is_none() -> None:
    app = app_of(devices=[{"name": "lidar", "type": "serial"}])
    before, ended = mark(app), first_run(app, verdict="Complete")

    def claims_at(observed: Observed, now: datetime) -> list[str]:
        progress = judge_progress(app, observed.values(), now=now)
        children = wanted_children(
            desired_of(app, ""),
            domain=DOMAIN,
            parameters={},
            running=True,
            observed=observed,
            progress=progress,
            claiming={"backup"},
        )
        return [claim.name for claim in wanted_claims(app, children)]

    assert claims_at(before, EVENING) == []
    assert claims_at(ended, DUE + 2 * MINUTE) == []
    assert claims_at(before, DUE) == claims_at(ended, DUE + DAY) == [desired_of(app, "").name_of("backup")]


def test_a_run_that_goes_on_keeps_the_ledger_of_its_template_and_the_next_one_chooses_anew() -> None:
    app = app_of(devices=[{"name": "lidar", "type": "serial"}])
    drivers = DriverNodes({"edge-1"}, {"edge-1": {}})
    without_claim = first_run(app)
    assert claiming_components(desired_of(app, ""), without_claim, drivers, placed=()) == frozenset()
    ended = first_run(app, verdict="Complete")
    assert claiming_components(desired_of(app, ""), ended, drivers, placed=()) == {"backup"}


def test_an_instance_runs_on_with_a_schedule_and_ends_by_its_other_jobs_where_completion_is_written() -> None:
    parts = component("migrate", job={})
    assert app_of(parts).completion_rules is None
    assert app_of().completion_rules is None
    app = app_of(parts, spec={"completion": {}})
    rules = app.completion_rules
    assert rules is not None
    assert rules.jobs == {"migrate"}
    migrated = {
        ref: job
        for child in children_of(app, {}, EVENING)
        if child.component == "migrate"
        for ref, job in store(child, app, verdict="Complete").items()
    }
    observed = migrated | mark(app)
    result = plan_of(app, observed, DUE)
    assert [item.metadata.labels["robotics.io/component"] for item in result.deletes] == ["backup"]
    assert result.changes == ()


def test_the_time_of_runs_is_no_part_of_the_deadline() -> None:
    spec = {"completion": {"deadline": "1h"}}
    app = app_of(component("migrate", job={}), spec=spec)
    (child,) = [child for child in children_of(app, {}, EVENING) if child.component == "migrate"]
    observed = store(child, app) | mark(app)
    assert judge_progress(app, observed.values(), now=EVENING).deadline == EVENING + timedelta(hours=1)


@pytest.mark.parametrize(
    ("verdict", "ready", "text"),
    [
        ("Complete", True, "run of 2026-11-30 02:00 Europe/Athens succeeded; next run 2026-12-01 02:00 Europe/Athens"),
        (
            "Failed",
            False,
            "run of 2026-11-30 02:00 Europe/Athens failed; next run 2026-12-01 02:00 Europe/Athens; BackoffLimitExceeded",
        ),
        ("", True, "run of 2026-11-30 02:00 Europe/Athens is under way; next run 2026-12-01 02:00 Europe/Athens"),
    ],
)
def test_the_message_has_the_last_run_and_the_next(verdict: str, ready: bool, text: str) -> None:
    app = app_of()
    view = view_of(app, first_run(app, verdict=verdict), DUE + 2 * MINUTE)
    assert view.message.startswith(text)
    assert view.message == view_of(app, first_run(app, verdict=verdict), DUE + 3 * MINUTE).message
    assert view.ready is ready
    assert view.reason is (None if ready else Reason.JOB_FAILED)
    assert not view.completed
    assert "runs the job again" not in view.message


def test_a_run_that_finds_no_node_makes_the_component_not_ready_when_it_is_late() -> None:
    app = app_of()
    running = first_run(app, creationTimestamp="2026-11-30T00:00:00Z")
    assert judge_progress(app, running.values(), now=DUE + MINUTE).runs_change_at == DUE + 10 * MINUTE
    assert judge_progress(app, running.values(), now=DUE + 10 * MINUTE).runs_change_at == DUE + DAY
    for minutes, is_ready in ((9, True), (10, False)):
        view = unscheduled_view(app, running, DUE + minutes * MINUTE)
        assert (view.ready, view.bound) == (is_ready, is_ready)
        assert view.reason is (None if is_ready else Reason.UNSCHEDULABLE)
        assert "no node has a GPU" in view.message
    text = unscheduled_view(app, running, DUE + DAY).message
    assert "that of 2026-12-01 02:00 Europe/Athens was skipped, because this one has not ended" in text
    assert view_of(app, running, DUE + DAY).ready, "a run that has a node is not late"


@pytest.mark.parametrize("is_made", [False, True])
def test_a_restart_of_the_other_jobs_is_no_news_about_a_run(is_made: bool) -> None:
    app = app_of()
    observed = first_run(app) if is_made else mark(app)
    progress = judge_progress(app, observed.values(), now=DUE)
    (part,) = app.spec.components
    restart = Attempt(1, 1, message="restarted 1 of 2 times: job save failed")
    view = job_view(part, progress.jobs.get("backup"), (), has_schedule=True, attempt=restart)
    view = scheduled_view(view, progress.runs["backup"], ending=None, suspended=False)
    assert "restarted" not in view.message


def unscheduled_view(app: App, observed: Observed, now: datetime) -> ComponentView:
    progress = judge_progress(app, observed.values(), now=now)
    (part,) = app.spec.components
    view = job_view(part, progress.jobs["backup"], (), has_schedule=True)
    view = dataclasses.replace(view, ready=False, reason=Reason.UNSCHEDULABLE, message="no node has a GPU")
    return scheduled_view(view, progress.runs["backup"], ending=None, suspended=False)


def test_before_the_first_run_the_component_is_ready_and_says_when_it_is() -> None:
    app = app_of()
    view = view_of(app, mark(app), EVENING)
    assert view.ready
    assert view.bound
    assert view.message == "next run 2026-11-30 02:00 Europe/Athens"


@pytest.mark.parametrize(
    ("schedule", "words"),
    [
        ({"cron": "0 0 30 2 *"}, ("spec.components[0].schedule.cron", "no month that it names has such a day")),
        ({"cron": "99 * * * *"}, ("spec.components[0].schedule.cron", "write 0-59")),
        (
            {"cron": "0 2 * * *", "timeZone": "Europe/Atlantis"},
            ("spec.components[0].schedule.timeZone", "Europe/Athens"),
        ),
        ({"cron": "0 2 * * *", "timeZone": "localtime"}, ("spec.components[0].schedule.timeZone", "on each machine")),
    ],
)
def test_a_line_that_is_never_due_and_a_zone_that_does_not_exist_are_refused(
    schedule: dict[str, Any], words: tuple[str, str]
) -> None:
    app = app_of(schedule=schedule)
    (problem,) = problems_alone(app)
    assert problem.field == words[0]
    assert words[1] in problem.message
    assert judge_progress(app, (), now=EVENING).runs == {}


def test_a_queue_is_refused_beside_a_schedule() -> None:
    (problem,) = problems_alone(dataclasses.replace(app_of(), queue="night"))
    assert problem.field == f'metadata.labels["{QUEUE_NAME}"]'
    assert "do not wait in a queue" in problem.message


def test_a_record_of_a_clock_that_was_years_ahead_does_not_stop_the_schedule() -> None:
    app, far = app_of(), "2031-01-01T00:00:00Z"
    ((ref, before),) = mark(app).items()
    (change,) = plan_of(app, {ref: with_annotations(before, {Annotation.SETTLED_AT: far})}, EVENING + MINUTE).changes
    assert change.records[Annotation.SETTLED_AT] == "2026-11-29T20:01:00Z"
    settled = {ref: with_annotations(before, dict(change.records))}
    assert [one.over for one in plan_of(app, settled, DUE).changes] == [None]
    ((ref, run),) = first_run(app, verdict="Complete").items()
    run = with_annotations(run, {Annotation.DUE_AT: far})
    (change,) = plan_of(app, {ref: run}, DUE + 2 * MINUTE).changes
    assert change.records[Annotation.SETTLED_AT] == "2026-11-30T00:02:00Z"
    ended = {ref: with_annotations(run, dict(change.records))}
    assert not plan_of(app, ended, DUE + 3 * MINUTE)
    assert view_of(app, ended, DUE + 3 * MINUTE).message == (
        "the due time 2031-01-01 02:00 Europe/Athens on its last job is ahead of the clock and does not count; next run 2026-12-01 02:00 Europe/Athens"
    )
    (next_run,) = plan_of(app, ended, DUE + DAY).changes
    both = ended | store(next_run.child, app)
    assert plan_of(app, both, DUE + DAY + MINUTE).deletes == tuple(ended.values())


@pytest.mark.parametrize("text", ["0001-01-01T00:00:00Z", "9999-12-31T23:59:59Z", "2026-11-30T00:00:00", "soon", ""])
def test_a_record_that_is_no_time_ends_no_process(text: str) -> None:
    app = app_of()
    (job,) = first_run(app, verdict="Complete").values()
    annotations = {**job.metadata.annotations, Annotation.DUE_AT: text, Annotation.SETTLED_AT: text}
    broken = msgspec.structs.replace(job, metadata=msgspec.structs.replace(job.metadata, annotations=annotations))
    assert judge_progress(app, [broken], now=DUE + DAY - MINUTE).runs_change_at == DUE + DAY
