"""Decides which instances of a sweep may run now, by their Jobs and by the domains that the sweep holds."""

from collections.abc import Collection, Iterable
from datetime import UTC, datetime
from typing import Final, NamedTuple

from robotapp_api.values.sweeps.matrix import choose_admitted
from robotapp_operator.plan.diff.jobs import judge_progress
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Job

LONG_AGO: Final = datetime.min.replace(tzinfo=UTC)


def find_end_of_turn(app: App, jobs: Iterable[Job]) -> datetime | None:
    """Returns since when an instance gives its turn to another, which is in the future where its deadline ends it; None while it runs.

    A job whose time is over runs until it has ended. An instance of which all jobs have ended, and which waits for its next attempt or
    for another job, ends at its deadline although nothing of it changes then.
    """
    jobs = [job for job in jobs if job.metadata.controller_uid == app.uid]
    if any(job.verdict is None for job in jobs):
        return None
    progress = judge_progress(app, jobs, now=LONG_AGO)
    return LONG_AGO if progress.ending is not None else progress.deadline


class Turns(NamedTuple):
    """The instances of a sweep that may run now, and the domains by which they were counted."""

    admitted: frozenset[str]
    available: int | None = None
    """Domains that the app's namespace may have, without those that are parked; None where its instances need none."""
    parked: int = 0
    """Domains of ended instances that nobody gives back while a node is out of sight, which may take days."""


def plan_turns(
    app: App,
    finished: Collection[str],
    running: Collection[str],
    *,
    holding: Collection[str] = (),
    parked: Collection[str] = (),
    available: int | None = None,
) -> Turns:
    """Returns which instances of a sweep may run now. finished: those whose turn is over. running: instances with Deployments or Jobs.
    holding: instances with a domain. parked: those of which one is parked. available: domains that the app's namespace may have, None
    where its instances need none.
    """

    def count_ended(names: Collection[str]) -> int:
        return sum(name in finished or name not in app.sweep for name in names)

    count = count_ended(parked)
    if available is not None:
        available = max(0, available - count)
    admitted = choose_admitted(
        [*app.sweep],
        parallelism=app.spec.matrix.parallelism if app.spec.matrix else 0,
        begun=frozenset([*running, *holding, *parked]),
        finished=frozenset(finished),
        resting=count_ended(holding),
        available=available,
    )
    return Turns(admitted, available, count)
