"""Decides which run of a component with schedule is due, by annotations of its newest Job and by the clock.

Nothing else is remembered. The newest Job stays until its successor is there, so a crash between the two loses no run.
Each due time has a Job of its own name, so none is run twice. Before the first run the newest Job is the mark: it is
suspended, never runs, and has the time since when the schedule counts.
"""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.quantities.times import read_moment, whole_seconds
from robotapp_api.values.schedules.due_times import DueTimes
from robotapp_claims.rules.completion.endings import has_schedule
from robotapp_operator.plan.render.child import JOB, Child
from robotapp_operator.plan.render.deployments import RunTimes
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Job

_LONG_AGO: Final = datetime(2000, 1, 1, tzinfo=UTC)
_TRUE: Final = "true"
_MOST_AHEAD: Final = timedelta(days=1)
"""A record that is further ahead of the clock does not count: the clock was wrong when it was written, or a person wrote it."""


class RunRecord(NamedTuple):
    """The record on the newest Job of a component."""

    settled: datetime
    """Until when every due time has had its run, or gets none any more."""
    is_under_way: bool = False
    """Its run has not ended."""
    is_suspended: bool = False
    """The schedule was suspended, as far as is recorded."""
    is_ahead: bool = False
    """A time is so far ahead of the clock that the schedule begins anew now."""


class RunDecision(NamedTuple):
    """The decision about one moment. Without any of these there is nothing to do."""

    due: datetime | None = None
    """Due time of the run that begins now."""
    settled: datetime | None = None
    """Until when due times are to be recorded as settled, because they get no run."""
    is_suspension_new: bool = False
    """That the schedule is suspended is to be recorded: when it is resumed, nothing is made up for."""


def decide_run(
    due_times: DueTimes,
    record: RunRecord,
    *,
    starting_deadline: timedelta,
    now: datetime,
    may_start: bool,
    is_new: bool,
) -> RunDecision:
    """Returns the run that begins now, or the due times that get none.

    starting_deadline: how late a run may begin. is_new: it is another schedule than that of the record, so that it begins anew.
    """
    if record.is_under_way:
        return RunDecision()  # due times until the run ends are skipped: its end settles them
    if not may_start:
        return RunDecision(is_suspension_new=not record.is_suspended)
    if is_new or record.is_ahead or record.is_suspended:
        return RunDecision(settled=max(now, record.settled))
    return RunDecision(due=due_times.find_last(max(record.settled, now - starting_deadline), now))


class ScheduledRun(NamedTuple):
    """The state of a component with schedule, by its newest Job and the clock."""

    due_times: DueTimes
    job: Job | None = None
    """Its newest Job; None before the first."""
    due_now: datetime | None = None
    """Due time of a run that begins now."""
    settled: datetime | None = None
    """The time to record as `robotics.io/settled-at`: on the newest Job, or on the first one, which never runs."""
    skipped: datetime | None = None
    """The last time that was due while the run of the newest Job went on."""
    missed: datetime | None = None
    """The last time that was due while no run went on, and whose run could not begin in time."""
    is_miss_new: bool = False
    """That a run was missed is to be recorded on the newest Job, and to be reported by an event."""
    next_due: datetime | None = None
    starting_deadline: timedelta = timedelta()
    """How late a run may begin."""
    is_suspension_new: bool = False
    """That the schedule is suspended is to be recorded on the newest Job."""
    late_at: datetime | None = None
    """When its run counts as late unless its pod has a node then; None without a run."""
    is_late: bool = False
    """That time is over."""
    is_ahead: bool = False
    """The due time of the newest Job is so far ahead of the clock that it does not count."""

    @property
    def changes_at(self) -> datetime | None:
        """Returns when this state changes without any event: a run is due, or a due one that could not begin is left out."""
        left_out = None if self.due_now is None else self.due_now + self.starting_deadline
        late_at = None if self.is_late else self.late_at
        return min((time for time in (self.next_due, left_out, late_at) if time is not None), default=None)

    @property
    def why_missed(self) -> str:
        """Returns why the last missed run did not begin, as the end of a sentence."""
        seconds = f"{self.starting_deadline.total_seconds():.0f} s"
        return f"was missed, because it could not begin within {seconds} (schedule.startingDeadlineSeconds)"

    @property
    def is_active(self) -> bool:
        """Returns whether its Job is to run now."""
        return self.due_now is not None or self.is_under_way

    @property
    def is_under_way(self) -> bool:
        """Returns whether the run of the newest Job has not ended."""
        return self.job is not None and may_have_pod(self.job)

    @property
    def current_job(self) -> Job | None:
        """Returns the Job of the run that is wanted now, None where it is still to be made."""
        return None if self.due_now is not None or (self.job is not None and self.job.is_deleting) else self.job

    @property
    def times(self) -> RunTimes:
        """Returns the times to write on the Job that is wanted now."""
        if self.due_now is not None:
            return RunTimes(due=self.due_now)
        if self.job is None:
            return RunTimes(settled=self.settled)
        return RunTimes(due=read_due(self.job), job_name=self.job.metadata.name)


def plan_runs(app: App, observed: Iterable[object], *, now: datetime, has_ended: bool) -> Mapping[str, ScheduledRun]:
    """Returns the state of each component with schedule, by name. has_ended: their instance has, so no run begins."""
    if not app.due_times or app.spec.matrix is not None:  # a sweep has no schedules (the schema refuses them)
        return {}
    newest: dict[str, Job] = {}
    for item in observed:
        if isinstance(item, Job) and is_of_schedule(item) and item.metadata.controller_uid == app.uid:
            name = item.metadata.labels.get(Label.COMPONENT, "")
            newest[name] = max(newest.get(name, item), item, key=lambda job: _sort_by_run(job, now))
    return {name: _plan_run(app, name, newest.get(name), now=now, has_ended=has_ended) for name in app.due_times}


def _plan_run(app: App, name: str, job: Job | None, *, now: datetime, has_ended: bool) -> ScheduledRun:
    due_times = app.due_times[name]
    component = next(part for part in app.spec.components if part.name == name)
    if job is None:
        return ScheduledRun(due_times, settled=now, next_due=due_times.find_next(now))
    record = _read_record(job, now)
    next_due = due_times.find_next(max(now, record.settled))
    if has_ended or component.schedule is None:
        return ScheduledRun(due_times, job, next_due=next_due)
    starting_deadline = timedelta(seconds=component.schedule.starting_deadline_seconds)
    decision = decide_run(
        due_times,
        record,
        starting_deadline=starting_deadline,
        now=now,
        may_start=not app.spec.suspend and component.replicas > 0,
        is_new=job.metadata.annotations.get(Annotation.SCHEDULE_HASH) != app.schedule_hashes[name],
    )
    # Since a suspension the run began anew.
    began = read_moment(job.state.started or job.state.created) if record.is_under_way else None
    late_at = began + starting_deadline if began is not None else None
    skipped_due = (
        due_times.find_last(max(record.settled, now - starting_deadline), now) if record.is_under_way else None
    )
    is_idle = not record.is_under_way and decision == RunDecision() and not record.is_suspended
    missed_due = due_times.find_last(record.settled, now - starting_deadline) if is_idle else None
    reported_due = read_moment(job.metadata.annotations.get(Annotation.MISSED_AT, ""))
    return ScheduledRun(
        due_times,
        job,
        due_now=decision.due,
        settled=decision.settled,
        skipped=skipped_due,
        next_due=next_due,
        starting_deadline=starting_deadline,
        missed=missed_due,
        is_miss_new=missed_due is not None and (reported_due is None or reported_due <= record.settled),
        is_suspension_new=decision.is_suspension_new,
        late_at=late_at,
        is_late=late_at is not None and late_at <= now,
        is_ahead=(read_due(job) or now) > now + _MOST_AHEAD,
    )


def is_of_schedule(job: Job) -> bool:
    """Returns whether a Job belongs to a component with schedule: as one of its runs, or as the mark."""
    return has_schedule(job.metadata.annotations)


def is_run(child: Child) -> bool:
    """Returns whether the child is a Job that is to run, and no mark."""
    return child.ref.kind == JOB and not (Annotation.SETTLED_AT in child.annotations and child.spec["suspend"])


def may_have_pod(job: Job) -> bool:
    """Returns whether a Job may have a pod, or get one: it has not ended, and is no mark. Its pod may still end where it is suspended."""
    is_mark = is_of_schedule(job) and Annotation.DUE_AT not in job.metadata.annotations and job.is_suspended
    return job.verdict is None and not is_mark


def _sort_by_run(job: Job, now: datetime) -> tuple[bool, datetime]:
    """Returns what the newest Job of a component has the largest of: no other is made while a run goes on."""
    due = read_due(job)
    return may_have_pod(job), due if due is not None and due <= now + _MOST_AHEAD else _LONG_AGO


def read_due(job: Job) -> datetime | None:
    """Returns the due time for which a Job was made; None for the mark."""
    return read_moment(job.metadata.annotations.get(Annotation.DUE_AT, ""))


def _read_record(job: Job, now: datetime) -> RunRecord:
    settled_until = read_moment(job.metadata.annotations.get(Annotation.SETTLED_AT, ""))
    times = [time for time in (read_due(job), settled_until, read_moment(job.state.ended)) if time is not None]
    past = [time for time in times if time <= now + _MOST_AHEAD]
    return RunRecord(
        max(past, default=_LONG_AGO),
        may_have_pod(job),
        is_suspended=is_recorded_as_suspended(job),
        # What was settled later than a wrong time was written counts; the wrong time stays on the Job.
        is_ahead=len(past) < len(times) and settled_until not in past,
    )


def is_recorded_as_suspended(job: Job) -> bool:
    """Returns whether the schedule was suspended when this Job of it was looked at last."""
    return job.metadata.annotations.get(Annotation.SCHEDULE_SUSPENDED) == _TRUE


def list_run_records(run: ScheduledRun | None, job: Job, schedule_hash: str) -> dict[str, str]:
    """Returns the annotations to write on a Job of a component with schedule, {} for none. schedule_hash: that of the present spec."""
    if run is None or run.job is not job:
        return {}
    if run.is_suspension_new:
        return {Annotation.SCHEDULE_SUSPENDED.value: _TRUE}
    if run.is_miss_new and run.missed is not None:
        return {Annotation.MISSED_AT.value: whole_seconds(run.missed)}
    if run.settled is None:
        return {}
    records = {Annotation.SCHEDULE_HASH.value: schedule_hash, Annotation.SETTLED_AT.value: whole_seconds(run.settled)}
    return records | ({Annotation.SCHEDULE_SUSPENDED.value: "false"} if is_recorded_as_suspended(job) else {})
