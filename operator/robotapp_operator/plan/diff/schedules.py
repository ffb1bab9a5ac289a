"""Runs of components with schedule: which one is due, by the records on the Jobs of the component and the clock.

Nothing else is remembered. The newest Job stays until its successor is there, so that a crash between the two loses no run; and each due
time has a Job of its own name, so that none is run twice.
"""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.schedules.due_times import DueTimes
from robotapp_operator.plan.render.deployments import RunTimes
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Job

_YEARS: Final = range(2000, 3000)
_BEGIN: Final = datetime(2000, 1, 1, tzinfo=UTC)


class RunRecord(NamedTuple):
    """The record on the newest Job of a component. goes: its run has not ended. settled: until when due times had their run, or have none."""

    settled: datetime
    goes: bool = False


class RunDecision(NamedTuple):
    """The run that begins now, and until when due times are to be recorded as settled; None for neither."""

    due: datetime | None = None
    settled: datetime | None = None


def decide_run(
    due_times: DueTimes, record: RunRecord, *, within: timedelta, now: datetime, may_start: bool, is_edited: bool
) -> RunDecision:
    """Returns whether a run is due. within: how late it may begin. is_edited: since the record was made, which begins the schedule anew."""
    if record.goes:
        return RunDecision()  # what becomes due meanwhile is skipped, because the end of the run settles it
    if is_edited:
        return RunDecision(settled=max(now, record.settled))
    due = due_times.find_last(max(record.settled, now - within), now)
    return RunDecision(due=due) if may_start else RunDecision(settled=due)


class ScheduledRun(NamedTuple):
    """The state of a component with schedule."""

    due_times: DueTimes
    job: Job | None = None
    """Its newest Job; None before the first."""
    begins: datetime | None = None
    """Due time of a run that begins now."""
    settled: datetime | None = None
    """What is to be recorded on the newest Job, or on the first one."""
    skipped: datetime | None = None
    """The last time that was due while the run of the newest Job went on."""
    next_due: datetime | None = None
    within: timedelta = timedelta()
    """How late a run may begin."""

    @property
    def changes_at(self) -> datetime | None:
        """Returns when this state is another one without any event: a run is due, or one that cannot begin is left out."""
        left_out = None if self.begins is None else self.begins + self.within
        return min((time for time in (self.next_due, left_out) if time is not None), default=None)

    @property
    def goes(self) -> bool:
        """Returns whether its Job is to run now."""
        return self.begins is not None or self.is_under_way

    @property
    def is_under_way(self) -> bool:
        """Returns whether the run of the newest Job has not ended."""
        return self.job is not None and read_due(self.job) is not None and self.job.verdict is None

    @property
    def current_job(self) -> Job | None:
        """Returns the Job of the run that is wanted now, None where it is still to be made."""
        return None if self.begins is not None or (self.job is not None and self.job.is_deleting) else self.job

    @property
    def times(self) -> RunTimes:
        """Returns the run that is wanted now."""
        if self.begins is not None:
            return RunTimes(due=self.begins)
        return RunTimes(settled=self.settled) if self.job is None else RunTimes(due=read_due(self.job))


def plan_runs(app: App, observed: Iterable[object], *, now: datetime, has_ended: bool) -> Mapping[str, ScheduledRun]:
    """Returns how far the components with schedule are, by name. has_ended: their instance has, so that no run begins."""
    if not app.due_times or app.spec.matrix is not None:  # a sweep has no schedules (the schema refuses them)
        return {}
    newest: dict[str, Job] = {}
    for item in observed:
        if isinstance(item, Job) and is_run(item) and item.metadata.controller_uid == app.uid:
            name = item.metadata.labels.get(Label.COMPONENT, "")
            newest[name] = max(newest.get(name, item), item, key=lambda job: read_due(job) or _BEGIN)
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
    within = timedelta(seconds=component.schedule.starting_deadline_seconds)
    decision = decide_run(
        due_times,
        record,
        within=within,
        now=now,
        may_start=not app.spec.suspend and component.replicas > 0,
        is_edited=job.metadata.annotations.get(Annotation.RUN_HASH) != app.run_hashes[name],
    )
    skipped = due_times.find_last(max(record.settled, now - within), now) if record.goes else None
    return ScheduledRun(due_times, job, decision.due, decision.settled, skipped, next_due, within)


def is_run(job: Job) -> bool:
    """Returns whether a Job is a run of a component with schedule, or marks since when its schedule counts."""
    return not job.metadata.annotations.keys().isdisjoint((Annotation.DUE_AT, Annotation.SETTLED_AT))


def read_due(job: Job) -> datetime | None:
    """Returns for which due time a Job was made; None for the one that only marks since when the schedule counts."""
    return _parse_time(job.metadata.annotations.get(Annotation.DUE_AT, ""))


def _read_record(job: Job) -> RunRecord:
    due, verdict = read_due(job), job.verdict
    times = (due, _parse_time(job.metadata.annotations.get(Annotation.SETTLED_AT, "")), _parse_time(job.state.ended))
    return RunRecord(
        max((time for time in times if time is not None), default=_BEGIN), due is not None and verdict is None
    )


def _parse_time(text: str) -> datetime | None:
    """Returns the time of a record; None for what is none, or not of this millennium, since a user may have changed it."""
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return None
    return time if time.tzinfo is not None and time.year in _YEARS else None
