"""QueueingHint: when the scheduler tries a pod again that a plugin rejected."""

import logging
from collections.abc import Callable, Hashable
from typing import Final, NamedTuple

from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.pods.pod_info import LIVE, PodInfo

log = logging.getLogger(__name__)


_SELF: Final = int(Change.SELF)


class QueueingHint(NamedTuple):
    """Which events may help a pod that one plugin rejected: first by kind of change, then by the plugin's `hint`."""

    plugin: str
    events: Change = Change.ALL
    hint: Callable[[PodInfo, Event], bool] | None = None
    reads: tuple[str, ...] = ()
    """Features of the pod that the result of `hint` depends on."""
    of_each: Callable[[Event], bool] | None = None
    """True for events for which it depends on more than `reads`: then `hint` is called for every pod."""
    serves: Callable[[PodInfo, Event], int | None] | None = None
    """How many of the pods that are equal in `reads` the event can help; None: any number."""

    def key(self, pod: PodInfo) -> Hashable:
        """Key of a pod: `hint` returns the same for pods with equal keys."""
        if self.hint is None:
            return ()
        live = any(name.startswith(LIVE) for name in self.reads)
        return pod.live_features(self.reads) if live else pod.features(self.reads)

    def wants(self, pod: PodInfo, event: Event) -> bool:
        """Whether this event may help the pod. A hint that raises counts as yes: it must not hold a pod back for ever."""
        if not int(event.change) & (int(self.events) | _SELF):
            return False
        if self.hint is None or (event.old is None and event.new is None):
            return True
        try:
            return bool(self.hint(pod, event))
        except Exception:  # a plugin's mistake must not lose a pod; the log has the stack
            log.exception("queueing hint of %s failed for %s on %s", self.plugin, pod.key, event.label)
            return True

    def most(self, pod: PodInfo, event: Event) -> int | None:
        """How many of the pods with this pod's key the event can help; None: any number. Only after `wants` returned True."""
        if self.serves is None or (event.old is None and event.new is None):
            return None
        try:
            return self.serves(pod, event)
        except Exception:  # as in `wants`
            log.exception("%s cannot tell for %s how many %s serves", self.plugin, pod.key, event.label)
            return None
