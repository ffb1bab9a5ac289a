"""`placement.fallback`: until when the budgets of an app with `enforce: Preferred` are required.

Decided from the age of the pods that wait, so a scheduler that starts anew decides the same.
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from math import inf
from typing import Final

from robotapp_api.values.quantities.duration import parse_us
from robotapp_scheduler.core.api.robotics_v1alpha1 import Fallback
from robotapp_scheduler.core.pods.pod_info import Member
from robotapp_scheduler.core.robotics.app_index import App, AppIndex

RELAX: Final = "RelaxPreferred"
EARLIEST: Final = datetime.min.replace(tzinfo=UTC)
LATEST: Final = datetime.max.replace(tzinfo=UTC)
"""Also the end of a time that has none."""
MOST_AHEAD: Final = timedelta(minutes=1)
"""The API server's clock may be so far ahead of ours. A pod that was made later than that would be held until our clock is there."""


def relaxes_after_s(fallback: Fallback | None) -> float:
    """How long pods wait for places that meet all Preferred budgets; infinite without the step that gives them up.

    The first step begins after `after`, and every further one after as long again.
    """
    if fallback is None:
        return 0.0
    if RELAX not in fallback.steps:
        return inf
    try:
        after_us = parse_us(fallback.after)
    except ValueError:  # stored before the schema had a pattern for it
        after_us = parse_us(Fallback().after)
    return (fallback.steps.index(RELAX) + 1) * after_us / 1_000_000


def held_until(app: App, instance: str, apps: AppIndex, now: Callable[[], datetime]) -> datetime | None:
    """Until when the Preferred budgets of an instance are required, LATEST = for ever; None when they are a cost.

    The time counts from the youngest pod that is not bound: the app waits as a whole, and a pod that replaces another waits anew.
    """
    after_s = relaxes_after_s(app.source.spec.placement.fallback)
    if after_s == 0.0 or not _prefers(app):
        return None
    if after_s == inf:
        return LATEST
    since = _waiting_since(app, instance, apps)
    if since - now() > MOST_AHEAD:
        since = EARLIEST
    until = since + timedelta(seconds=min(after_s, (LATEST - since).total_seconds()))
    return until if now() < until else None


def _prefers(app: App) -> bool:
    """Has an edge of the app a Preferred budget?"""
    return any(not link.required and link.budget_us is not None for links in app.links.values() for link in links)


def _waiting_since(app: App, instance: str, apps: AppIndex) -> datetime:
    """When the youngest pod of the instance that is not bound was made; EARLIEST where that is not known."""
    made = [
        replica.pod.metadata.creation_timestamp or ""
        for name in app.components
        for replica in apps.replicas(Member(app.uid, instance, name), name)
        if not replica.pod.spec.node_name and replica.pod.metadata.deletion_timestamp is None
    ]
    try:
        found = datetime.fromisoformat(max(made, default=""))  # RFC 3339 texts of one zone sort by time
    except ValueError:
        return EARLIEST
    return found if found.tzinfo is not None else EARLIEST
