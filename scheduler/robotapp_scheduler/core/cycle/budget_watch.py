"""Watches the budgets of running components, and decides what their pods' annotation `robotics.io/better-node` should be.

Instances are looked at when a time, a pod or the app has changed, a bounded number per tick, by what is measured; while nothing
changes there is nothing to do. Only for a pod whose budget has been exceeded for
`placement.reschedule.for` a node is searched, and of these a bounded number per tick, the one that waited longest first.
The annotation on the pod is the record: what it should be is compared with what the watch shows. So nothing is written
while nothing changes, and a new leader goes on where the last one ended.
"""

import dataclasses
import itertools
import logging
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta
from functools import partial
from typing import Final, NamedTuple

from robotapp_api.model.names import Annotation
from robotapp_api.values.better_node import BetterNode, parse_better_node
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.better_node import Proposal, better_node, settled
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import Member
from robotapp_scheduler.core.robotics.app_index import InstanceKey, budget_for_s
from robotapp_scheduler.core.robotics.edge_times import Part, movable, part_of, worst_late

log = logging.getLogger(__name__)

TICK_S: Final = 0.25
"""How often `tick` is called: work comes in small pieces, so that no decision waits for much of it."""
LOOKS: Final = 50
"""Instances looked at per tick, 10 us per component."""
ROUND_S: Final = 60.0
"""How often all instances are looked at: for what no event tells, such as another primary node of a robot."""
SEARCHES: Final = 1
"""Components for which a node is searched per tick: an attempt over all nodes without caches, 4 ms at 5000 nodes."""
SEARCH_S: Final = 10.0
"""Pause between two searches for one component."""
VALID: Final = timedelta(minutes=30)
RENEW: Final = timedelta(minutes=10)
"""A proposal that still holds is written anew when it expires this soon."""
REST_S: Final = 60.0
"""Pause after a write before the next proposal for the same pod."""
SEEN_S: Final = 5.0
"""Pause after a write before a proposal is withdrawn: until the watch shows what was written."""


class AnnotationWrite(NamedTuple):
    """The annotation of this pod is to be `better`; None removes it."""

    pod: Pod
    better: BetterNode | None


@dataclasses.dataclass(slots=True)
class WatchedPod:
    """A pod whose budget is exceeded, or that has a proposal. Times are monotonic seconds."""

    member: Member
    late: bool
    since_s: float
    """From when a budget has been exceeded (late), or all have been met."""
    for_s: float = 0.0
    """How long it must be so before it counts. A link that is cut for a moment is no reason to move either."""
    search_s: float = 0.0
    """No search before."""
    written_s: float = float("-inf")

    def counts(self, now_s: float) -> bool:
        """Has it been so for long enough?"""
        return now_s - self.since_s >= self.for_s


class BudgetWatch:
    """`tick` every `TICK_S` seconds. `clock`: monotonic seconds; `now`: the time of day, for expiries."""

    def __init__(self, core: SchedulerCore, *, clock: Callable[[], float], now: Callable[[], datetime]) -> None:
        self._core = core
        self._clock = clock
        self._now = now
        self._turn: dict[InstanceKey, None] = {}
        """Instances that are to be looked at, the one that has waited longest first."""
        self._round_s = float("-inf")
        """When all instances were last added."""
        self._watched: dict[str, WatchedPod] = {}
        """By pod uid."""

    def __repr__(self) -> str:
        return f"BudgetWatch({len(self._watched)} pods over budget or with a proposal)"

    def tick(self) -> list[AnnotationWrite]:
        """What is to be written now."""
        found: list[AnnotationWrite] = []
        for instance in self._next():
            found += _shielded(instance, partial(self._looked_at, instance))
        for uid in self._due():
            member = self._watched[uid].member
            found += _shielded((member.app_uid, member.instance), partial(self._searched_for, uid))
        return found

    def _next(self) -> list[InstanceKey]:
        """Those whose turn it is. Pods that are gone are forgotten."""
        cluster, now_s = self._core.cluster, self._clock()
        nodes = cluster.rtt.take_touched()
        robots = {robot for node in nodes if (robot := cluster.nodes.robot_of(node))}
        self._turn |= dict.fromkeys(cluster.apps.take_touched(nodes, robots))
        if now_s - self._round_s >= ROUND_S:
            self._round_s = now_s
            self._turn |= dict.fromkeys(cluster.apps.instances())
        self._watched = {uid: watched for uid, watched in self._watched.items() if uid in cluster.placed}
        self._turn |= dict.fromkeys((each.member.app_uid, each.member.instance) for each in self._watched.values())
        found = list(itertools.islice(self._turn, LOOKS))
        for key in found:
            del self._turn[key]
        return found

    def _parts(self, app_uid: str, instance: str) -> Iterator[Part]:
        apps = self._core.cluster.apps
        app = apps.app(app_uid)
        if app is None:
            return
        for name in movable(app):
            part = part_of(app, Member(app_uid, instance, name), apps)
            if part is not None:
                yield part

    def _looked_at(self, instance: InstanceKey) -> list[AnnotationWrite]:
        return [write for part in self._parts(*instance) if (write := self._look(part)) is not None]

    def _searched_for(self, uid: str) -> list[AnnotationWrite]:
        write = self._search(uid)
        return [] if write is None else [write]

    def _look(self, part: Part) -> AnnotationWrite | None:
        """Note whether the pod is over budget. Its proposal is withdrawn when all budgets have been met for long enough."""
        uid, now_s = part.pod.metadata.uid, self._clock()
        late = worst_late(part, self._core.cluster, self._core.cluster.rtt.measured_us)
        watched = self._watched.get(uid)
        if watched is None:
            if late is None and not _annotated(part.pod):
                return None
            watched = self._watched[uid] = WatchedPod(part.member, late is not None, now_s)
        watched.for_s = budget_for_s(part.app)
        if watched.late != (late is not None):
            watched.late, watched.since_s = late is not None, now_s
        if watched.late or not watched.counts(now_s):
            return None
        if not _annotated(part.pod) and now_s - watched.written_s >= REST_S:
            del self._watched[uid]
            return None
        return self._write(part.pod, None)

    def _due(self) -> list[str]:
        """Pods for which a node is searched now, the one that waited longest first."""
        now_s = self._clock()
        due = [
            (watched.search_s, uid)
            for uid, watched in self._watched.items()
            if watched.late and watched.search_s <= now_s and watched.counts(now_s)
        ]
        return [uid for _, uid in sorted(due)[:SEARCHES]]

    def _search(self, uid: str) -> AnnotationWrite | None:
        cluster, watched = self._core.cluster, self._watched[uid]
        watched.search_s = self._clock() + SEARCH_S
        app = cluster.apps.app(watched.member.app_uid)
        part = part_of(app, watched.member, cluster.apps) if app is not None else None
        if part is None or part.pod.metadata.uid != uid:
            return None  # it is on its way out
        if part.member.component not in movable(part.app):
            return self._write(part.pod, None)
        if worst_late(part, cluster, cluster.rtt.measured_us) is None or not settled(self._core, part):
            return None
        standing = _standing(part.pod)
        return self._write(part.pod, better_node(self._core, part, standing=standing.node if standing else ""))

    def _write(self, pod: Pod, found: Proposal | None) -> AnnotationWrite | None:
        """The write that makes the annotation what it should be; None when it is so, or a write was a moment ago."""
        watched, now_s, now = self._watched[pod.metadata.uid], self._clock(), self._now()
        since_s = now_s - watched.written_s
        if found is None:
            if not _annotated(pod) or since_s < SEEN_S:
                return None
            watched.written_s = now_s
            return AnnotationWrite(pod, None)
        standing = _standing(pod)
        holds = standing is not None and standing.node == found.node and standing.expires - now >= RENEW
        if holds or since_s < REST_S:
            return None
        watched.written_s = now_s
        expires = (now + VALID).replace(microsecond=0)
        return AnnotationWrite(pod, BetterNode(found.node, found.before_us, found.after_us, expires))


def _shielded(instance: InstanceKey, decide: Callable[[], list[AnnotationWrite]]) -> list[AnnotationWrite]:
    """What is decided of one instance; nothing where a bug ends it, of a plugin perhaps: the others have their turn all the same."""
    try:
        return decide()
    except Exception:
        log.exception("looking for better nodes failed: instance %r of the app with uid %s", instance[1], instance[0])
        return []


def _annotated(pod: Pod) -> bool:
    return Annotation.BETTER_NODE in (pod.metadata.annotations or {})


def _standing(pod: Pod) -> BetterNode | None:
    """The proposal on the pod; None without one that can be read."""
    try:
        return parse_better_node((pod.metadata.annotations or {}).get(Annotation.BETTER_NODE, ""))
    except ValueError:
        return None
