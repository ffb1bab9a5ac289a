"""An instance that is started again while others want its domain: Jobs, the record of the attempt, operators and a sweeper as a model.

The decisions are the product's own (`rules.completion.endings`, `plan.diff.attempts`). What must hold: no sweep finds the
domain unwanted while the instance is to be started again (EARLY), the count is never exceeded (MANY), and in the end the
instance has ended and has no domain.
"""

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

from campaigns.claims.model.explore import Move
from robotapp_claims.rules.completion.endings import CompletionRules, JobState, find_ending, find_failure
from robotapp_operator.plan.diff.attempts import (
    RESTARTS_FIELD,
    Attempt,
    find_attempt,
    plan_next_attempt,
    render_attempt,
)

CREATED: Final = "2026-01-01T00:00:00Z"
RUN_HASH: Final = "h"
IDLE: Final[tuple[Any, ...]] = ()
_NOW: Final = datetime(2026, 1, 1, tzinfo=UTC)
FREE, RESERVED, DRAINING = range(3)
"""Phases of the claim on the instance's domain."""


class Job(NamedTuple):
    attempt: int
    restarts: int
    verdict: str = ""
    deleting: bool = False
    """Its last pod has not ended yet."""


class State(NamedTuple):
    jobs: tuple[Job | None, ...]
    record: tuple[int, int]
    """(attempt, restarts) in the status of the RobotAppInstance; (0, 0) before there is one."""
    claim: int
    operators: tuple[tuple[Any, ...], ...]
    """Writes that are decided on and not carried out yet."""
    sweeper: tuple[Any, ...]
    """(phase of the claim it has read,) once it has found the claim unused and unwanted."""
    starts: int
    """Jobs that were created, as far as they are counted."""


class RestartRules:
    """The product's rules for an instance whose jobs must all complete."""

    records_first = True

    def __init__(self, names: tuple[str, ...], max_restarts: int) -> None:
        self.names = names
        self.completion = CompletionRules(frozenset(names), max_restarts=max_restarts)

    def has_ended(self, jobs: Mapping[str, JobState]) -> bool:
        return find_ending(self.completion, jobs, now=_NOW) is not None

    def has_ended_for_the_sweep(self, jobs: Mapping[str, JobState]) -> bool:
        return self.has_ended(jobs)


class EndsWithAFailure(RestartRules):
    """JM1: the sweep takes a failed job for the end, as it was before there were restarts."""

    def has_ended_for_the_sweep(self, jobs: Mapping[str, JobState]) -> bool:
        return find_ending(self.completion._replace(max_restarts=0), jobs, now=_NOW) is not None


class EveryAttemptCounts(RestartRules):
    """JM2: jobs of earlier attempts count as well."""

    def has_ended_for_the_sweep(self, jobs: Mapping[str, JobState]) -> bool:
        return self.has_ended({name: job._replace(attempt=0) for name, job in jobs.items()})


class NothingRecorded(RestartRules):
    """JM3: jobs are replaced without a record."""

    records_first = False


class RestartModel:
    """An instance, the programs that look after it and the sweep. operators: how many write side by side. counts: whether starts
    are counted, which makes states many.
    """

    def __init__(
        self,
        *,
        rules: type[RestartRules] = RestartRules,
        jobs: int = 2,
        max_restarts: int = 1,
        operators: int = 1,
        counts: bool = True,
    ) -> None:
        self.names = tuple("abc"[:jobs])
        self.rules = rules(self.names, max_restarts)
        self.operators = operators
        self.counts = counts

    def start(self) -> State:
        return State((None,) * len(self.names), (0, 0), FREE, (IDLE,) * self.operators, IDLE, 0)

    def moves(self, s: State) -> Iterator[Move]:
        yield from self._cluster(s)
        for k, write in enumerate(s.operators):
            if write == IDLE:
                for choice in self._decide(s):
                    yield f"O decides {choice}", True, s._replace(operators=_put(s.operators, k, choice))
            else:
                idle = s._replace(operators=_put(s.operators, k, IDLE))
                yield "O dies", False, idle
                yield f"O writes {write}", True, self._write(idle, write)
        yield from self._sweep(s)

    def broken(self, s: State) -> str:
        limit = self.rules.completion.max_restarts
        if s.record[0] > limit or any(job is not None and job.attempt > limit for job in s.jobs):
            return "MANY: another attempt than those that are allowed"
        if self.counts and s.starts > (limit + 1) * len(self.names):
            return "MANY: more jobs than the attempts have"
        return ""

    def settled(self, s: State) -> bool:
        busy = any(s.operators) or bool(s.sweeper) or any(job is not None and job.deleting for job in s.jobs)
        return not busy and s.claim == FREE and self.rules.has_ended(self._states(s))

    def _states(self, s: State) -> dict[str, JobState]:
        """Returns what operator and sweep read of the Jobs: both leave out those that are being deleted."""
        return {
            name: JobState(CREATED, verdict=job.verdict, ended=CREATED, attempt=job.attempt, restarts=job.restarts)
            for name, job in zip(self.names, s.jobs, strict=True)
            if job is not None and not job.deleting
        }

    def _cluster(self, s: State) -> Iterator[Move]:
        """Jobs run while the instance has its domain, and go when their last pod has ended."""
        for i, job in enumerate(s.jobs):
            if job is None:
                continue
            if job.deleting:
                yield f"job {i} is gone", True, s._replace(jobs=_put(s.jobs, i, None))
            elif not job.verdict and s.claim == RESERVED:
                for verdict in ("Complete", "Failed"):
                    jobs = _put(s.jobs, i, job._replace(verdict=verdict))
                    yield f"job {i} of attempt {job.attempt}: {verdict}", True, s._replace(jobs=jobs)

    def _decide(self, s: State) -> Iterator[tuple[Any, ...]]:
        """Yields what an operator may write next, by all that it reads now."""
        rules, states = self.rules.completion, self._states(s)
        ending = find_ending(rules, states, now=_NOW)
        if ending is not None:
            return
        record = render_attempt(Attempt(*s.record, RUN_HASH))
        attempt = find_attempt(states, {RESTARTS_FIELD: record}, run_hash=RUN_HASH, ending=ending)
        present = {name: job for name, job in states.items() if job.attempt >= attempt.number}
        failure = find_failure(rules, present, now=_NOW)
        if failure is not None:
            next_attempt = plan_next_attempt(present, attempt, failure, max_restarts=rules.max_restarts)
            if self.rules.records_first:
                yield ("record", s.record, (next_attempt.number, next_attempt.restarts))
                return
            attempt = next_attempt
        for i, job in enumerate(s.jobs):
            if job is not None and not job.deleting and job.attempt < attempt.number:
                yield ("delete", i, job.attempt)
            elif job is None and s.claim != RESERVED:
                yield ("claim",)
            elif job is None:
                yield ("create", i, attempt.number, attempt.restarts)

    def _write(self, s: State, write: tuple[Any, ...]) -> State:
        """Carries a write out on what is there by then; one whose condition no longer holds is refused."""
        verb, *values = write
        if verb == "record":
            before, after = values
            return s._replace(record=after) if s.record == before else s
        if verb == "claim":  # made, or taken back from a sweep, whose next write is refused then
            return s._replace(claim=RESERVED, sweeper=IDLE)
        i = values[0]
        job = s.jobs[i]
        if verb == "delete":
            is_same = job is not None and job.attempt == values[1]
            return s._replace(jobs=_put(s.jobs, i, job._replace(deleting=True))) if job and is_same else s
        if job is not None:
            return s
        new_job = Job(values[1], values[2])
        return s._replace(jobs=_put(s.jobs, i, new_job), starts=s.starts + int(self.counts))

    def _sweep(self, s: State) -> Iterator[Move]:
        """Reads the claim, then the Jobs; drains, and after a rest deletes, a claim that is unused and unwanted."""
        states = self._states(s)
        is_used = any(job is not None and not job.verdict for job in s.jobs)
        if s.sweeper == IDLE:
            if s.claim != FREE and not is_used and self.rules.has_ended_for_the_sweep(states):
                early = "" if self.rules.has_ended(states) else "!EARLY: "
                yield f"{early}S finds the claim unwanted", True, s._replace(sweeper=(s.claim,))
            elif s.claim == DRAINING:
                yield "S restores the claim", True, s._replace(claim=RESERVED)
            return
        yield "S dies", False, s._replace(sweeper=IDLE)
        (phase,) = s.sweeper
        if phase != s.claim:
            yield "S refused", True, s._replace(sweeper=IDLE)
            return
        next_phase = DRAINING if phase == RESERVED else FREE
        yield f"S writes the claim: {next_phase}", True, s._replace(claim=next_phase, sweeper=IDLE)


def _put(items: tuple[Any, ...], index: int, value: Any) -> tuple[Any, ...]:
    return (*items[:index], value, *items[index + 1 :])
