"""Pods that were popped and are neither bound nor back in the queue, and the events that arrive meanwhile."""

from collections.abc import Iterator
from typing import Any, Final

from robotapp_scheduler.core.events.cluster_event import Change, Event

MOST_LOGGED: Final = 4096
OFTEN: Final = 256
"""With more events than this the log is shortened, so that it keeps few objects alive."""


class InFlightPod:
    """One pod in flight; `seen` is filled by `InFlightPods.land`."""

    __slots__ = ("activated", "deleted", "folded", "own", "pod", "seen", "since")

    def __init__(self, pod: Any, since: int) -> None:
        self.pod = pod
        self.since = since
        """Index in the log of the first event after its pop."""
        self.folded = 0
        """Kinds of change of the events that were dropped from the log, as a plain int."""
        self.own: list[Event] = []
        """Events about the pod itself."""
        self.seen: list[Event] = []
        """All events since its pop."""
        self.activated = False
        self.deleted = False


class InFlightPods:
    """All pods in flight by uid. Noting a change appends one entry, however many pods are in flight."""

    def __init__(self) -> None:
        self._flying: dict[str, InFlightPod] = {}
        self._log: list[tuple[Event, str]] = []
        """(event, uid of the pod it does not concern) since the first pod now in flight was popped."""
        self._most = min(OFTEN, MOST_LOGGED)
        """With more events than this `note` shortens the log."""

    def __repr__(self) -> str:
        return f"InFlightPods({len(self._flying)} in flight)"

    def __contains__(self, uid: str) -> bool:
        return uid in self._flying

    def __iter__(self) -> Iterator[str]:
        return iter(self._flying)

    def get(self, uid: str) -> InFlightPod | None:
        """The entry of a pod in flight, None for any other pod."""
        return self._flying.get(uid)

    def start(self, uid: str, pod: Any) -> None:
        """The pod was popped."""
        self._flying[uid] = InFlightPod(pod, len(self._log))

    def note(self, event: Event, *, but: str) -> None:
        """Add an event for all pods in flight but the one with the uid `but`."""
        if self._flying:
            self._log.append((event, but))
            if len(self._log) > self._most:
                self._shorten()
                self._most = min(MOST_LOGGED, max(OFTEN, 2 * len(self._log)))

    def note_own(self, uid: str, event: Event) -> None:
        """The pod itself changed while it was in flight."""
        self._flying[uid].own.append(event)

    def end(self, uid: str) -> InFlightPod | None:
        """The pod got a node: its events are no longer needed."""
        flight = self._flying.pop(uid, None)
        if not self._flying:
            self._log.clear()
        return flight

    def land(self, uid: str) -> InFlightPod | None:
        """The pod goes back into the queue: returns it with all events since its pop."""
        flight = self._flying.get(uid)
        if flight is not None:
            folded = [Event("", Change(flight.folded))] if flight.folded else []
            flight.seen = [*folded, *self._seen(uid, flight), *flight.own]
            self.end(uid)
        return flight

    def _seen(self, uid: str, flight: InFlightPod) -> list[Event]:
        return [event for event, but in self._log[flight.since :] if but != uid]

    def _shorten(self) -> None:
        """Drop events from before all pods now in flight; if that is not enough, keep only kinds of change (`folded`)."""
        past = next(iter(self._flying.values())).since  # they are in the order of their start
        if past > len(self._log) // 2:
            del self._log[:past]
            for flight in self._flying.values():
                flight.since -= past
        elif len(self._log) > MOST_LOGGED:
            self._fold()

    def _fold(self) -> None:
        """Replace the log by kinds of change per pod; from the newest event back, so that each event is visited once."""
        at, common = len(self._log), 0
        others: dict[str, int] = {}
        """Uid → kinds of change that concern all pods but this one."""
        for uid, flight in sorted(self._flying.items(), key=lambda item: item[1].since, reverse=True):
            for event, but in reversed(self._log[flight.since : at]):
                if but:
                    others[but] = others.get(but, 0) | int(event.change)
                else:
                    common |= int(event.change)
            at = flight.since
            flight.folded |= common
            for but, changes in others.items():
                if but != uid:
                    flight.folded |= changes
            flight.since = 0
        self._log.clear()
