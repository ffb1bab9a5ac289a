"""Which events a new status is worth: only changes of state, with the number, the limit and the next step."""

from collections.abc import Mapping
from datetime import date
from typing import Any, NamedTuple

from robotapp_api.model.distros import DISTROS
from robotapp_api.model.names import Condition, EventReason, Reason
from robotapp_operator.plan.wish import App


class News(NamedTuple):
    reason: EventReason
    note: str
    warning: bool


_REFUSED = frozenset({Reason.DOMAIN_EXHAUSTED, Reason.DOMAIN_TAKEN, Reason.QUOTA_EXCEEDED, Reason.POOL_NOT_FOUND})
_FAILED = frozenset({Reason.FAILED_CREATE, Reason.QUOTA_REFUSED, Reason.IMAGE_PULL, Reason.CRASH_LOOP})


def news_of(before: Mapping[str, Any], after: Mapping[str, Any], *, new_domains: Mapping[str, int]) -> list[News]:
    """Compare two statuses of one app. `new_domains`: instance -> id that was claimed since."""
    old, new = _reasons(before), _reasons(after)
    news = [
        News(EventReason.DOMAIN_ALLOCATED, f"{f'robot {robot}: ' if robot else ''}domain {number}", warning=False)
        for robot, number in sorted(new_domains.items())
    ]

    def turned(kind: Condition) -> tuple[str, str, str] | None:
        """(status, reason, message) when the condition says something else than before."""
        now = new.get(kind.value)
        then = old.get(kind.value)
        return now if now and (then is None or then[:2] != now[:2]) else None

    accepted = turned(Condition.ACCEPTED)
    if accepted and accepted[0] == "False":
        news.append(News(EventReason.INVALID_SPEC, accepted[2], warning=True))
    allocated = turned(Condition.ALLOCATED)
    if allocated and allocated[1] in _REFUSED:
        news.append(News(EventReason.DOMAIN_EXHAUSTED, allocated[2], warning=True))
    if allocated and allocated[1] == Reason.CLAIM_CONFLICT:
        news.append(News(EventReason.CLAIM_CONFLICT, allocated[2], warning=True))
    if allocated and allocated[1] == Reason.DEVICE_BUSY:
        news.append(News(EventReason.DEVICE_BUSY, allocated[2], warning=True))
    ready = turned(Condition.READY)
    if ready and ready[1] in _FAILED:
        news.append(News(EventReason.CHILD_FAILED, ready[2], warning=True))
    placed = turned(Condition.PLACED)
    if placed and placed[0] == "True":
        news.append(News(EventReason.PLACED, placed[2], warning=False))
    if placed and placed[1] == Reason.UNSCHEDULABLE:
        news.append(News(EventReason.NODE_REJECTED, placed[2], warning=True))
    budget = turned(Condition.BUDGET_MET)
    if budget and budget[1] == Reason.BUDGET_EXCEEDED:
        news.append(News(EventReason.BUDGET_EXCEEDED, budget[2], warning=True))
    return news


def end_of_life(app: App, before: Mapping[str, Any], today: date) -> News | None:
    """Once per generation: the distribution gets no more security fixes."""
    distro = DISTROS.get(app.distro)
    if distro is None or not distro.is_past_end_of_life(today):
        return None
    if before.get("observedGeneration") == app.generation:
        return None
    text = f"support of {distro.name} ended on {distro.end_of_life}; plan a move to a supported distribution"
    return News(EventReason.EOL_DISTRO, text, warning=True)


def _reasons(status: Mapping[str, Any]) -> dict[str, tuple[str, str, str]]:
    found = status.get("conditions")
    return {
        item["type"]: (item.get("status", ""), item.get("reason", ""), item.get("message", ""))
        for item in (found if isinstance(found, list) else ())
    }
