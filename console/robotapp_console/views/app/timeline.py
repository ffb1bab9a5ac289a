"""Moves of an app's components, newest first, with what led to them as far as the API server still has the events."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from robotapp_api.model.names import EventReason
from robotapp_console.views.texts import parse_timestamp

MOST_ENTRIES: Final = 20
ANSWER_S: Final = 900.0
"""So long after a move its event may come: it is written when the successor is on a node."""
_LEADING: Final = frozenset(
    {
        EventReason.BUDGET_EXCEEDED,
        EventReason.DEVICE_LOST,
        EventReason.DEVICE_RETURNED,
        EventReason.FALLBACK_USED,
        EventReason.NODE_REJECTED,
        EventReason.ROBOT_OFFLINE,
    }
)
"""Reasons for which components move, or cannot."""
_GOOD: Final = frozenset({EventReason.DEVICE_RETURNED, EventReason.RESCHEDULED})


@dataclass(frozen=True, slots=True)
class MoveTime:
    """One move of one component, as its Deployment's record has it."""

    component: str
    at: str


@dataclass(frozen=True, slots=True)
class Entry:
    """One line; `subject` is a component on a robot or a reason, `colour` good, bad or idle."""

    at: str
    subject: str
    text: str
    colour: str


class MovedInstance(Protocol):
    """An instance as far as the timeline needs one."""

    @property
    def name(self) -> str: ...
    @property
    def moves(self) -> tuple[MoveTime, ...]: ...


class EventText(Protocol):
    """A row of an event, its texts clean."""

    @property
    def at(self) -> str: ...
    @property
    def reason(self) -> str: ...
    @property
    def note(self) -> str: ...


def build_timeline(instances: Iterable[MovedInstance], events: Sequence[EventText]) -> tuple[Entry, ...]:
    """Returns moves and what led to them, newest first. A move has the words of its event, or says that there is none any more."""
    unmatched_events = [event for event in events if event.reason == EventReason.RESCHEDULED]
    entries = [
        Entry(event.at, event.reason, event.note, "good" if event.reason in _GOOD else "bad")
        for event in events
        if event.reason in _LEADING
    ]
    moves = [(move, instance.name) for instance in instances for move in instance.moves]
    for move, instance_name in sorted(moves, key=lambda item: (item[0].at, item[0].component), reverse=True):
        subject = f"{move.component} on {instance_name}" if instance_name else move.component
        event = _find_event(move, unmatched_events)
        if event is None:
            entries.append(Entry(move.at, subject, "was evicted to start elsewhere; its event is gone", "idle"))
            continue
        unmatched_events.remove(event)
        entries.append(Entry(move.at, subject, event.note, "good"))
    entries += [Entry(event.at, event.reason, event.note, "good") for event in unmatched_events]
    entries.sort(key=lambda entry: (parse_timestamp(entry.at) or 0.0, entry.subject), reverse=True)
    return tuple(entries[:MOST_ENTRIES])


def _find_event(move: MoveTime, events: Sequence[EventText]) -> EventText | None:
    """Returns the event that was written when the component had its new node: the first one of it after the move."""
    moved_s = parse_timestamp(move.at)
    if moved_s is None:
        return None
    candidates = [
        (event_s, event)
        for event in events
        if event.note.startswith(f"{move.component} ")
        and (event_s := parse_timestamp(event.at)) is not None
        and 0 <= event_s - moved_s <= ANSWER_S
    ]
    return min(candidates, key=lambda candidate: candidate[0], default=(0.0, None))[1]
