"""Gated pods (PreEnqueue), indexed by what may open their gates."""

from collections.abc import Iterator

from robotapp_scheduler.core.events.cluster_event import Change


class GatedPods:
    """Uids of gated pods. Iteration is in order of closing within those that the same changes concern."""

    def __init__(self) -> None:
        self._events: dict[str, Change] = {}
        self._by_events: dict[Change, dict[str, None]] = {}

    def __repr__(self) -> str:
        return f"<GatedPods {len(self)}>"

    def __len__(self) -> int:
        return len(self._events)

    def __contains__(self, uid: str) -> bool:
        return uid in self._events

    def __iter__(self) -> Iterator[str]:
        return iter(self._events)

    def add(self, uid: str, events: Change) -> None:
        self.discard(uid)
        self._events[uid] = events
        self._by_events.setdefault(events, {})[uid] = None

    def discard(self, uid: str) -> None:
        events = self._events.pop(uid, None)
        if events is None:
            return
        alike = self._by_events[events]
        del alike[uid]
        if not alike:
            del self._by_events[events]

    def concerned(self, change: Change) -> list[str]:
        """Those whose gates this change may open."""
        return [uid for events, uids in self._by_events.items() if events & change for uid in uids]
