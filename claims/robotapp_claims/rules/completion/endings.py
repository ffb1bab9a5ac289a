"""Decides by the Jobs of an instance whether it has ended, and needs no pods and no domain, or is to start again.

The operator applies these rules to its caches, and the sweep of claims to what it reads afresh. Therefore they look at
the Jobs alone: an instance whose domain one of the two gives back must not be started again by the other.
"""

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

from robotapp_api.model.names import Annotation, Reason
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.quantities.times import read_moment, whole_seconds
from robotapp_claims.rules.objects import (
    COMPLETE,
    OUT_OF_TIME,
    App,
    Job,
    JobConditionLike,
    find_verdict,
    is_stopped,
)

LONGEST_DEADLINE: Final = timedelta(days=3650)
ANNOTATIONS_READ: Final = (
    Annotation.APP_GENERATION,
    Annotation.ATTEMPT,
    Annotation.RESTARTS,
    Annotation.BEGAN,
    Annotation.DUE_AT,
    Annotation.SETTLED_AT,
)
"""The annotations of a Job that decide about its state."""
_MOST_DIGITS: Final = 9
_CLOCK_DIFFERENCE: Final = timedelta(seconds=5)
"""By the clock of the Job controller a Job may end this much earlier than by that of the operator."""
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


class CompletionRules(NamedTuple):
    """The rules by which an instance of an app ends."""

    jobs: frozenset[str]
    """The jobs that decide it, by the names under which their components run."""
    any_suffices: bool = False
    deadline: timedelta | None = None
    """How long they may take together."""
    generation: int = 0
    """The generation of the app."""
    max_restarts: int = 0
    """How many times all jobs run again when a job has failed."""


class JobState(NamedTuple):
    """The fields of a Job that these rules read. Times are texts, as the API has them."""

    created: str
    generation: int = 0
    """The generation of the app for which it was created."""
    verdict: str = ""
    """Complete or Failed; "" while it may still run."""
    ended: str = ""
    reason: str = ""
    """Why it has failed: the reason that the Job controller wrote, such as BackoffLimitExceeded."""
    started: str = ""
    """Time of its last start; "" before that."""
    suspended: bool = False
    """It waits, because its app is suspended or its queue has not admitted it."""
    attempt: int = 0
    """Number of the attempt to which it belongs: 0 for the first start of the jobs, 1 after the first restart."""
    restarts: int = 0
    """How many of the allowed restarts the instance had used when this Job was created."""
    began: str = ""
    """Since when the deadline of the instance counts, where an earlier attempt has used some of that time."""
    has_schedule: bool = False
    """Its component has a schedule, so that it ends no instance, and is part of no attempt or deadline."""


class Ending(NamedTuple):
    """The end of an instance."""

    reason: Reason
    """Completed, JobFailed or DeadlineExceeded."""
    component: str = ""
    """The job that decided it."""
    time: str = ""

    @property
    def is_success(self) -> bool:
        return self.reason is Reason.COMPLETED


class Failure(NamedTuple):
    """A failed job because of which the instance is to start again, and the reason that the Job controller wrote."""

    component: str
    reason: str = ""


def completion_rules_of(app: App) -> CompletionRules | None:
    """Returns when instances of the app end, None for those that run on: without a job, or with components beside the jobs and no
    `completion`. A component with schedule runs on. One with replicas: 0 counts for nothing.
    """
    spec = app.spec
    components = [component for component in spec.components if component.replicas]
    jobs = [component for component in components if component.ends]
    if spec.completion is None:
        ends = bool(jobs) and len(jobs) == len(components)
        return CompletionRules(frozenset(name for job in jobs for name in job.names)) if ends else None
    success = spec.completion.success
    counting = [job for job in jobs if not success.components or job.name in success.components]
    if not counting:
        return None
    return CompletionRules(
        frozenset(name for job in counting for name in job.names),
        any_suffices=success.operator == "Any",
        deadline=_read_deadline(spec.completion.deadline),
        generation=app.metadata.generation,
        max_restarts=spec.completion.max_restarts,
    )


def _read_deadline(text: str | None) -> timedelta | None:
    if text is None:
        return None
    try:
        return min(timedelta(microseconds=parse_us(text)), LONGEST_DEADLINE)
    except (ValueError, OverflowError):
        return LONGEST_DEADLINE


def read_job_state(job: Job) -> JobState:
    """Returns the state of a Job."""
    return build_job_state(
        job.metadata.annotations,
        job.status.conditions,
        created=job.metadata.creation_timestamp,
        started=job.status.start_time,
        suspended=job.spec.suspend,
    )


def build_job_state(
    annotations: Mapping[str, str],
    conditions: Iterable[JobConditionLike],
    *,
    created: str | None,
    started: str | None,
    suspended: bool,
) -> JobState:
    """Returns the state of a Job with these fields, however they were decoded. suspended: `spec.suspend`."""
    conditions = tuple(conditions)
    verdict = find_verdict(conditions)
    began = annotations.get(Annotation.BEGAN, "")
    return JobState(
        created=created or "",
        generation=read_number(annotations, Annotation.APP_GENERATION),
        verdict=verdict.type if verdict else "",
        ended=(verdict.last_transition_time or "") if verdict else "",
        reason=verdict.reason if verdict else "",
        started=started or "",
        suspended=suspended or is_stopped(conditions),
        attempt=read_number(annotations, Annotation.ATTEMPT),
        restarts=read_number(annotations, Annotation.RESTARTS),
        began=began if read_moment(began) else "",
        has_schedule=has_schedule(annotations),
    )


def has_schedule(annotations: Mapping[str, str]) -> bool:
    """Returns whether the Job with these annotations belongs to a component with schedule."""
    return Annotation.DUE_AT in annotations or Annotation.SETTLED_AT in annotations


def read_number(annotations: Mapping[str, str], key: Annotation) -> int:
    """Returns the number in an annotation; 0 without one, and for anything else, which people may write there."""
    text = annotations.get(key, "")
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= _MOST_DIGITS else 0


def find_ending(rules: CompletionRules, jobs: Mapping[str, JobState], *, now: datetime) -> Ending | None:
    """Returns the end of the instance, None while it runs or is to be started again.

    jobs: by component, those that are created.
    """
    outcome = _find_outcome(rules, jobs, now=now)
    return outcome if isinstance(outcome, Ending) else None


def find_failure(rules: CompletionRules, jobs: Mapping[str, JobState], *, now: datetime) -> Failure | None:
    """Returns the failure because of which all jobs of the instance are to run again, None without one."""
    outcome = _find_outcome(rules, jobs, now=now)
    return outcome if isinstance(outcome, Failure) else None


def _find_outcome(rules: CompletionRules, jobs: Mapping[str, JobState], *, now: datetime) -> Ending | Failure | None:
    """Returns the decision of the jobs of the latest attempt. Those of an earlier one are about to be replaced."""
    jobs = select_latest(jobs)
    counting = {name: jobs[name] for name in sorted(rules.jobs & jobs.keys())}
    completions = {name: job.ended for name, job in counting.items() if job.verdict == COMPLETE}
    failures = {name: job.ended for name, job in counting.items() if job.verdict not in ("", COMPLETE)}
    if completions and (rules.any_suffices or completions.keys() == rules.jobs):
        chosen = (min if rules.any_suffices else max)(completions, key=lambda name: completions[name])
        return Ending(Reason.COMPLETED, chosen, completions[chosen])
    end = find_deadline(rules, jobs)
    if failures and (not rules.any_suffices or failures.keys() == rules.jobs):
        first = min(failures, key=lambda name: failures[name])
        if end is not None and _ran_out_of_time(jobs[first], end):
            return _end_by_deadline(end)
        if count_restarts(jobs) >= rules.max_restarts:
            return Ending(Reason.JOB_FAILED, first, failures[first])
        if end is None or now < end:
            return Failure(first, jobs[first].reason)
    return None if end is None or now < end else _end_by_deadline(end)


def select_latest(jobs: Mapping[str, JobState]) -> dict[str, JobState]:
    """Returns the jobs of the latest attempt by component, without those of schedules."""
    counting = {name: job for name, job in jobs.items() if not job.has_schedule}
    latest = max((job.attempt for job in counting.values()), default=0)
    return {name: job for name, job in counting.items() if job.attempt == latest}


def count_restarts(jobs: Mapping[str, JobState]) -> int:
    """Returns how many of the allowed restarts are used: the smallest count of a job, because an edited one begins
    at 0 for all.
    """
    return min((job.restarts for job in select_latest(jobs).values()), default=0)


def _end_by_deadline(end: datetime) -> Ending:
    return Ending(Reason.DEADLINE_EXCEEDED, time=whole_seconds(end))


def _ran_out_of_time(job: JobState, end: datetime) -> bool:
    """Returns whether the job was ended because the instance's time was over: by the limit in the Job itself, or by
    the operator.
    """
    return job.reason == OUT_OF_TIME and _parse_time(job.ended) + _CLOCK_DIFFERENCE >= end


def find_deadline(rules: CompletionRules, jobs: Mapping[str, JobState], *, began: str = "") -> datetime | None:
    """Returns when the instance's time is over; None without a deadline or a job, and while a job is suspended or waits
    in a queue.

    An edit of the app begins it anew with the next job that is made: the jobs before may have taken longer than the
    deadline. began: since when it counts while all jobs are about to run again and none is there.
    """
    if rules.deadline is None:
        return None
    jobs = {name: job for name, job in jobs.items() if not job.has_schedule}
    if not jobs:
        return _parse_time(began) + rules.deadline if began else None
    newest = _list_newest(jobs)
    is_edited = rules.generation > newest[0].generation and not rules.jobs <= jobs.keys()
    if is_edited or any(job.suspended and not job.verdict for job in newest):
        return None
    return _compute_beginning(newest) + rules.deadline


def find_beginning(jobs: Mapping[str, JobState]) -> str:
    """Returns since when the deadline counts for the next attempt: since the first job, without the time in which
    jobs waited.
    """
    newest = _list_newest(jobs)
    return whole_seconds(_compute_beginning(newest)) if newest else ""


def _list_newest(jobs: Mapping[str, JobState]) -> list[JobState]:
    """Returns the jobs that were made for the newest generation of the app."""
    latest = max((job.generation for job in jobs.values()), default=0)
    return [job for job in jobs.values() if job.generation == latest]


def _compute_beginning(jobs: Sequence[JobState]) -> datetime:
    # A job began when it was created, or in an earlier attempt. A later time in the annotation was not written by us.
    first = min(min(_parse_time(job.created), _parse_time(job.began or job.created)) for job in jobs)
    return first + _measure_waits(jobs)


def _measure_waits(jobs: Iterable[JobState]) -> timedelta:
    """Returns how long jobs have waited between their creation and their last start, counting the time once in which several waited."""
    total, until = timedelta(), datetime.min.replace(tzinfo=UTC)
    for created, started in sorted((_parse_time(job.created), _parse_time(job.started or job.created)) for job in jobs):
        total += max(timedelta(), started - max(created, until))
        until = max(until, started)
    return total


def _parse_time(text: str) -> datetime:
    """Returns a time in the status of a Job; the epoch for none, and for one with which nothing can be computed (the year 9999)."""
    return read_moment(text) or _EPOCH
