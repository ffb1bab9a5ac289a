"""Which events a new status is worth: only changes of state, with the number, the limit and the next step."""

from collections.abc import Collection, Mapping
from datetime import date
from typing import Any, Final, NamedTuple

from robotapp_api.model.distros import DISTROS
from robotapp_api.model.names import Condition, EventReason, Reason
from robotapp_operator.plan.spec.desired import App


class PendingEvent(NamedTuple):
    reason: EventReason
    note: str
    warning: bool


NOT_ACCEPTED: Final = frozenset(
    {
        Reason.INVALID_SPEC,
        Reason.TOO_LARGE,
        Reason.UNKNOWN_DISTRO,
        Reason.HOST_ACCESS_OFF,
        Reason.NO_MATCHING_ROBOT,
    }
)
NOT_ALLOCATED: Final = frozenset(
    {
        Reason.DOMAIN_EXHAUSTED,
        Reason.DOMAIN_TAKEN,
        Reason.QUOTA_EXCEEDED,
        Reason.POOL_OVERLAPS,
        Reason.POOL_NOT_FOUND,
        Reason.CLAIM_CONFLICT,
        Reason.DEVICE_BUSY,
        Reason.DEVICE_LOST,
    }
)
_ALLOCATED: Final = Condition.ALLOCATED.value
_FAILED = frozenset(
    {Reason.FAILED_CREATE, Reason.QUOTA_REFUSED, Reason.IMAGE_PULL, Reason.CRASH_LOOP, Reason.PROGRAM_ENDED}
)


class _Turn(NamedTuple):
    """A condition that has turned to this status, or to one of these reasons, is worth an event with its message.

    `event` None: the event has the condition's own reason.
    """

    kind: Condition
    event: EventReason | None = None
    warning: bool = True
    status: str = ""
    reasons: frozenset[Reason] = frozenset()


TURNS = (
    _Turn(Condition.ACCEPTED, reasons=NOT_ACCEPTED),
    _Turn(Condition.ALLOCATED, reasons=NOT_ALLOCATED),
    _Turn(Condition.READY, EventReason.CHILD_FAILED, reasons=_FAILED),
    _Turn(Condition.READY, reasons=frozenset({Reason.ROBOT_NOT_READY, Reason.ROBOT_OFFLINE})),
    _Turn(Condition.READY, warning=False, reasons=frozenset({Reason.COMPLETED})),
    _Turn(Condition.READY, reasons=frozenset({Reason.JOB_FAILED, Reason.DEADLINE_EXCEEDED})),
    _Turn(Condition.PLACED, warning=False, status="True"),
    _Turn(Condition.PLACED, EventReason.NODE_REJECTED, reasons=frozenset({Reason.UNSCHEDULABLE})),
    _Turn(Condition.PROGRESSING, reasons=frozenset({Reason.NEWER_VERSION})),
    _Turn(Condition.BUDGET_MET, reasons=frozenset({Reason.BUDGET_EXCEEDED})),
    _Turn(Condition.STALLED, reasons=frozenset({Reason.RESTART_NEEDED})),
)


def name_instance_kind(app: App | None) -> str:
    """Returns what an instance with a name is: the app on a robot, or a run of a sweep."""
    return "run" if app is not None and app.spec.matrix is not None else "robot"


def events_between(
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    *,
    new_domains: Mapping[str, int],
    there: Collection[str] = (),
    kind: str = "robot",
) -> list[PendingEvent]:
    """Compares two statuses of one app. new_domains: instance -> id that was claimed since; there: its devices that are present;
    kind: what an instance with a name is, see `name_instance_kind`.
    """
    events = [
        PendingEvent(
            EventReason.DOMAIN_ALLOCATED, f"{f'{kind} {name}: ' if name else ''}domain {number}", warning=False
        )
        for name, number in sorted(new_domains.items())
    ]
    turned = _turned(_reasons(before), _reasons(after))
    was, (status, _, message) = _reasons(before).get(_ALLOCATED, ("", "", "")), turned.get(_ALLOCATED, ("", "", ""))
    # Without one of those that were lost the pod moved to another node, or the app needs it no more.
    back = [device for device in there if f"{device} " in was[2]] if was[1] == Reason.DEVICE_LOST else []
    if back and status == "True":
        events.append(PendingEvent(EventReason.DEVICE_RETURNED, f"{back[0]} is back: {message}", warning=False))
    elif status == "True" != was[0] and _holds_all_devices(after):
        events.append(PendingEvent(EventReason.DEVICE_CLAIMED, message, warning=False))
    for turn in TURNS:
        status, reason, message = turned.get(turn.kind.value, ("", "", ""))
        if status and (status == turn.status or reason in turn.reasons):
            events.append(PendingEvent(turn.event or EventReason(reason), message, turn.warning))
    return events


def _holds_all_devices(status: Mapping[str, Any]) -> bool:
    """Whether the app wants devices and holds them: a suspended one is allocated, too, and holds none."""
    held, _, wanted = (status.get("summary") or {}).get("devices", "").partition("/")
    return bool(wanted) and held == wanted


def _turned(
    old: Mapping[str, tuple[str, str, str]], new: Mapping[str, tuple[str, str, str]]
) -> dict[str, tuple[str, str, str]]:
    """Conditions with another status or reason than before."""
    return {kind: now for kind, now in new.items() if old.get(kind, ())[:2] != now[:2]}


def end_of_life(app: App, before: Mapping[str, Any], today: date) -> PendingEvent | None:
    """Once per generation: the distribution gets no more security fixes."""
    distro = DISTROS.get(app.distro)
    if distro is None or not distro.is_past_end_of_life(today):
        return None
    if before.get("observedGeneration") == app.generation:
        return None
    text = f"support of {distro.name} ended on {distro.end_of_life}; plan a move to a supported distribution"
    return PendingEvent(EventReason.EOL_DISTRO, text, warning=True)


def _reasons(status: Mapping[str, Any]) -> dict[str, tuple[str, str, str]]:
    found = status.get("conditions")
    return {
        item["type"]: (item.get("status", ""), item.get("reason", ""), item.get("message", ""))
        for item in (found if isinstance(found, list) else ())
    }
