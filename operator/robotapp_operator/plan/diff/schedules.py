"""Decides which run of a component with schedule is due, by annotations of its newest Job and by the clock.

Nothing else is remembered. The newest Job stays until its successor is there, so a crash between the two loses no run.
Each due time has a Job of its own name, so none is run twice. Before the first run the newest Job is the mark: it is
suspended, never runs, and has the time since when the schedule counts.
"""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.quantities.times import read_moment
from robotapp_api.values.schedules.due_times import DueTimes
from robotapp_claims.rules.completion.endings import has_schedule
from robotapp_operator.plan.render.deployments import RunTimes
from robotapp_operator.plan.spec.desired import App, is_edited
from robotapp_operator.plan.spec.objects import Job

_LONG_AGO: Final = datetime(2000, 1, 1, tzinfo=UTC)


class RunRecord(NamedTuple):
    """The record on the newest Job of a component."""

    settled: datetime
    """Until when every due time has had its run, or gets none any more."""
    is_under_way: bool = False
    """Its run has not ended."""


class RunDecision(NamedTuple):
    """The decision about one moment. Without either time there is nothing to do."""

    due: datetime | None = None
    """Due time of the run that begins now."""
    settled: datetime | None = None
    """Until when due times are to be recorded as settled, because they get no run."""


def decide_run(
    due_times: DueTimes,
    record: RunRecord,
    *,
    starting_deadline: timedelta,
    now: datetime,
    may_start: bool,
    is_edited: bool,
) -> RunDecision:
    """Returns the run that begins now, or the due times that get none.

    starting_deadline: how late a run may begin. is_edited: the component was changed since the record was made, which
    begins the schedule anew.
    """
    if record.is_under_way:
        return RunDecision()  # due times until the run ends are skipped: its end settles them
    if is_edited:
        return RunDecision(settled=max(now, record.settled))
    due = due_times.find_last(max(record.settled, now - starting_deadline), now)
    return RunDecision(due=due) if may_start else RunDecision(settled=due)


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
    next_due: datetime | None = None
    starting_deadline: timedelta = timedelta()
    """How late a run may begin."""

    @property
    def changes_at(self) -> datetime | None:
        """Returns when this state changes without any event: a run is due, or a due one that could not begin is left out."""
        left_out = None if self.due_now is None else self.due_now + self.starting_deadline
        return min((time for time in (self.next_due, left_out) if time is not None), default=None)

    @property
    def is_active(self) -> bool:
        """Returns whether its Job is to run now."""
        return self.due_now is not None or self.is_under_way

    @property
    def is_under_way(self) -> bool:
        """Returns whether the run of the newest Job has not ended."""
        return self.job is not None and read_due(self.job) is not None and self.job.verdict is None

    @property
    def current_job(self) -> Job | None:
        """Returns the Job of the run that is wanted now, None where it is still to be made."""
        return None if self.due_now is not None or (self.job is not None and self.job.is_deleting) else self.job

    @property
    def times(self) -> RunTimes:
        """Returns the times to write on the Job that is wanted now."""
        if self.due_now is not None:
            return RunTimes(due=self.due_now)
        return RunTimes(settled=self.settled) if self.job is None else RunTimes(due=read_due(self.job))


def plan_runs(app: App, observed: Iterable[object], *, now: datetime, has_ended: bool) -> Mapping[str, ScheduledRun]:
    """Returns the state of each component with schedule, by name. has_ended: their instance has, so no run begins."""
    if not app.due_times or app.spec.matrix is not None:  # a sweep has no schedules (the schema refuses them)
        return {}
    newest: dict[str, Job] = {}
    for item in observed:
        if isinstance(item, Job) and is_of_schedule(item) and item.metadata.controller_uid == app.uid:
            name = item.metadata.labels.get(Label.COMPONENT, "")
            newest[name] = max(newest.get(name, item), item, key=lambda job: read_due(job) or _LONG_AGO)
    return {name: _plan_run(app, name, newest.get(name), now=now, has_ended=has_ended) for name in app.due_times}


def _plan_run(app: App, name: str, job: Job | None, *, now: datetime, has_ended: bool) -> ScheduledRun:
    due_times = app.due_times[name]
    component = next(part for part in app.spec.components if part.name == name)
    if job is None:
        return ScheduledRun(due_times, settled=now, next_due=due_times.find_next(now))
    record = _read_record(job)
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
        is_edited=is_edited(app, name, job),
    )
    skipped = due_times.find_last(max(record.settled, now - starting_deadline), now) if record.is_under_way else None
    return ScheduledRun(due_times, job, decision.due, decision.settled, skipped, next_due, starting_deadline)


def is_of_schedule(job: Job) -> bool:
    """Returns whether a Job belongs to a component with schedule: as one of its runs, or as the mark."""
    return has_schedule(job.metadata.annotations)


def read_due(job: Job) -> datetime | None:
    """Returns the due time for which a Job was made; None for the mark."""
    return read_moment(job.metadata.annotations.get(Annotation.DUE_AT, ""))


def _read_record(job: Job) -> RunRecord:
    due, verdict = read_due(job), job.verdict
    times = (due, read_moment(job.metadata.annotations.get(Annotation.SETTLED_AT, "")), read_moment(job.state.ended))
    return RunRecord(
        max((time for time in times if time is not None), default=_LONG_AGO), due is not None and verdict is None
    )
