"""Jobs of an instance: which run the present spec, how far the instance is, and which are changed or replaced.

The template of a Job cannot be changed, so a run with another one is another Job. One that has ended is run again only
after an edit of its component: another version of the operator, another domain or another ConfigMap is no reason. A
component with schedule has a Job for each run (`schedules`); its edits reach the next run.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any, Final, NamedTuple, TypeGuard

import msgspec

from robotapp_api.model.names import QUEUE_NAME, Annotation, Label
from robotapp_claims.rules.completion.endings import Ending, find_deadline, find_ending, find_failure, read_number
from robotapp_claims.rules.objects import Deployment as ClaimsDeployment
from robotapp_operator.plan.diff.attempts import FIRST_ATTEMPT, Attempt, find_attempt, keep_number, plan_next_attempt
from robotapp_operator.plan.diff.newer import binding_rules, is_newer
from robotapp_operator.plan.diff.schedules import ScheduledRun, is_of_schedule, plan_runs
from robotapp_operator.plan.diff.unowned import domain_literals
from robotapp_operator.plan.render.child import Child
from robotapp_operator.plan.render.deployments import RunTimes
from robotapp_operator.plan.spec.desired import App, is_edited
from robotapp_operator.plan.spec.objects import Deployment, Job

_AT_ONCE: Final = 1
"""Deadline in seconds that ends a job whose instance has ended."""
_SUSPEND: Final = "suspend"
_TIME_LIMIT: Final = "activeDeadlineSeconds"
_MUTABLE: Final = (_SUSPEND, "backoffLimit", _TIME_LIMIT)
_ROUNDING_S: Final = 5
"""A limit that differs by less is not written anew: a Job starts a moment after its limit was computed."""


class Progress(NamedTuple):
    """The state of an instance by its Jobs."""

    jobs: Mapping[str, Job] = {}
    """Jobs of the present spec and of the present attempt, by component."""
    ending: Ending | None = None
    """Why the instance has ended, None while it has not."""
    deadline: datetime | None = None
    """The time at which it ends at the latest."""
    limit_s: int | None = None
    """Seconds that a Job which is created now may take, None without a deadline."""
    runs: Mapping[str, ScheduledRun] = {}
    """The state of each component with schedule."""
    attempt: Attempt = FIRST_ATTEMPT
    """The present attempt; Jobs of earlier ones are replaced, but no runs of a schedule."""
    next_attempt: Attempt | None = None
    """The attempt that is to follow, because a job has failed; to be recorded before anything else is done about it."""

    @property
    def idle(self) -> frozenset[str]:
        """Returns the components whose job has ended, or is not due."""
        ended = {name for name, job in self.jobs.items() if job.verdict is not None}
        return frozenset(ended | {name for name, run in self.runs.items() if not run.is_active})

    @property
    def run_times(self) -> Mapping[str, RunTimes]:
        """Returns the times of the run that each component with schedule is to have."""
        return {name: run.times for name, run in self.runs.items()}

    @property
    def runs_change_at(self) -> datetime | None:
        """Returns when the next run is due, or one that cannot begin is left out; None without a schedule."""
        return min((time for run in self.runs.values() if (time := run.changes_at) is not None), default=None)

    def find_change(self, now: datetime) -> datetime | None:
        """Returns when time alone changes the instance: a run is due or left out, or its own time is over. None where nothing does."""
        times = [time for time in (self.runs_change_at, self.deadline) if time is not None and time > now]
        return min(times, default=None) if self.ending is None else None


NO_JOBS: Final = Progress()


def current_jobs(app: App, observed: Iterable[object]) -> dict[str, Job]:
    """Returns the Jobs that run, or have run, what the present spec has, by component, without those of schedules."""
    jobs = (item for item in observed if isinstance(item, Job) and item.metadata.controller_uid == app.uid)
    jobs = (job for job in jobs if not is_of_schedule(job))
    by_component = {job.metadata.labels.get(Label.COMPONENT, ""): job for job in jobs if not job.is_deleting}
    return {name: job for name, job in by_component.items() if name in app.run_hashes and not is_edited(app, name, job)}


def judge_progress(app: App, observed: Iterable[object], *, now: datetime, status: Mapping[str, Any] = {}) -> Progress:
    """Returns the state of an instance by its Jobs. status: that of its RobotAppInstance, with the record of attempts.

    The number of the attempt stays where nothing is started again any more: without it all pods would start anew.
    """
    if not app.has_jobs:
        return NO_JOBS._replace(attempt=keep_number(status))
    observed = tuple(observed)
    jobs, rules = current_jobs(app, observed), app.completion_rules
    states = {name: job.state for name, job in jobs.items()}
    ending = find_ending(rules, states, now=now) if rules is not None else None
    runs = plan_runs(app, observed, now=now, has_ended=ending is not None)
    current_runs = {name: run.current_job for name, run in runs.items() if run.current_job is not None}
    attempt = find_attempt(states, status, run_hash=app.all_runs_hash, ending=ending)
    states = {name: state for name, state in states.items() if state.attempt >= attempt.number}
    present = {name: jobs[name] for name in states} | current_runs
    if rules is None:
        return Progress(present, runs=runs, attempt=attempt)
    failure = find_failure(rules, states, now=now)
    following = None  # a suspended app keeps its Jobs and their logs until it is resumed
    if failure is not None and not app.spec.suspend:
        following = plan_next_attempt(states, attempt, failure, max_restarts=rules.max_restarts)
    deadline = find_deadline(rules, states, began=attempt.began)
    remaining = deadline - now if deadline is not None else rules.deadline
    return Progress(
        present,
        ending,
        deadline,
        limit_s=max(_AT_ONCE, math.ceil(remaining.total_seconds())) if remaining is not None else None,
        runs=runs,
        attempt=attempt,
        next_attempt=following,
    )


def limit_time(child: Child, progress: Progress) -> Child:
    """Returns a new Job that ends by the deadline of its instance, also while no operator runs."""
    if progress.limit_s is None:
        return child
    seconds = min(progress.limit_s, child.spec.get(_TIME_LIMIT, progress.limit_s))
    return dataclasses.replace(child, spec={**child.spec, _TIME_LIMIT: seconds})


def end_at_once(job: Job) -> dict[str, Any]:
    """Returns the spec with which the Job controller ends a job that runs, so that it is on record that it has ended."""
    return {**job.spec, _TIME_LIMIT: _AT_ONCE}


def must_delete(app: App, child: Child, job: Job, progress: Progress) -> bool:
    """Returns whether the job is to be deleted: it waits and could only end by running, although its instance has
    ended; or it must not run, and kueue would resume it, because it still has the label that the app has lost.
    """
    if job.verdict is not None:
        return False
    is_left_in_queue = QUEUE_NAME in job.metadata.labels and not app.queue
    return job.is_suspended if progress.ending is not None else is_left_in_queue and child.spec[_SUSPEND] is True


def is_queued(app: App, job: Job) -> bool:
    """Returns whether kueue decides when the job runs. If the operator wrote `suspend`, it would undo that decision."""
    return bool(app.queue) or QUEUE_NAME in job.metadata.labels


def must_replace(app: App, child: Child, job: Job, *, version: str) -> bool:
    """Returns whether another Job has to take the place of this one.

    A later attempt of the instance replaces it in any case. Otherwise a Job that a newer operator made for this
    generation of the app stays. An edit of the component replaces its Job, whether it has ended or not, but no run of a
    schedule. A Job that has not ended is replaced as well if its pods would never be bound: it names another domain
    than its instance has, or another scheduler or gate.
    """
    annotations = job.metadata.annotations
    if job.state.attempt < read_number(child.annotations, Annotation.ATTEMPT):
        return True
    is_of_newer = is_newer(annotations.get(Annotation.RENDERED_BY, ""), version)
    if is_of_newer and annotations.get(Annotation.APP_GENERATION) == str(app.generation):
        return False
    if is_edited(app, child.component, job) and not (child.component in app.due_times and is_of_schedule(job)):
        return True
    if job.verdict is not None:
        return False
    domains = domain_literals(child.spec)
    return bool(domains and domain_literals(job.spec) - domains) or binding_rules(job.spec) != binding_rules(child.spec)


def amend_job(app: App, child: Child, job: Job, progress: Progress) -> dict[str, Any] | None:
    """Returns the spec with what may change while the job runs, None where nothing differs."""
    wanted = {field: child.spec.get(field) for field in _MUTABLE}
    if is_queued(app, job):
        del wanted[_SUSPEND]
    if app.spec.completion is not None and app.spec.completion.deadline is not None:
        wanted[_TIME_LIMIT] = _find_time_limit(child, job, progress)
    spec = job.spec
    if all(spec.get(field) == value for field, value in wanted.items()):
        return None
    spec |= wanted
    return {field: value for field, value in spec.items() if value is not None}


def _find_time_limit(child: Child, job: Job, progress: Progress) -> int | None:
    """Returns the seconds from the job's start to the deadline of its instance, or its own limit where that is earlier."""
    present: int | None = job.spec.get(_TIME_LIMIT)
    state = job.state
    if progress.deadline is None or not (state.started or state.created):
        return present
    remaining = progress.deadline - datetime.fromisoformat(state.started or state.created)
    seconds = max(_AT_ONCE, math.ceil(remaining.total_seconds()))
    seconds = min(seconds, child.spec.get(_TIME_LIMIT, seconds))
    return present if present is not None and abs(present - seconds) < _ROUNDING_S else seconds


def is_newest_of_schedule(item: object, progress: Progress) -> bool:
    """Returns whether this is the newest Job of a component with schedule, which stays until its successor is there."""
    return any(run.job is item for run in progress.runs.values())


def names_domain(item: object) -> TypeGuard[Deployment | Job]:
    """Returns whether pods may still be made of the object's template, which names a domain."""
    return isinstance(item, Deployment) or (isinstance(item, Job) and item.verdict is None)


def protocol_view(item: Deployment | Job) -> ClaimsDeployment:
    """Returns the Deployment or Job in the form the claim rules read."""
    return msgspec.convert({"metadata": msgspec.to_builtins(item.metadata), "spec": item.spec}, ClaimsDeployment)
