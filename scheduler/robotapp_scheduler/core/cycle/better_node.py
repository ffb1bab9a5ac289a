"""Better nodes for the pods of running components whose budget is exceeded: which node, and when it is proposed.

The search (`better_node`) takes the pod off its node in a dry run, with the rest of the app where it is, and places it as a
waiting pod would be: by all filters, the order of `runsOn` and all scores. So a pod that is evicted for the sake of the proposal
finds a place. Whether anything is moved is the operator's decision (`robotapp_api.values.placement.better_node`). During a search the nodes
proposed to other pods count as if these pods were there already: else the operator would evict two pods for one free place.

`BudgetWatch` decides what a pod's annotation `robotics.io/better-node` should be. It looks at instances when a time, a pod or the
app has changed, a bounded number per tick, by what is measured, and at those that are late or have a proposal every tick; while
none is and nothing changes there is nothing to do. A node is searched
only for the sake of a connection that has been over its budget for `placement.reschedule.for`: one slow report of another moves
nothing. A bounded number of pods is searched for per tick. Namespaces take turns, in each the pod that waited longest is first, and
pods that the operator would not move anyway come last: however many late components a tenant has, another's waits for a turn per
namespace. The annotation on the pod is the record: what it should be is compared with what the watch shows. So nothing
is written while nothing changes, and a new leader goes on where the last one ended.
"""

import dataclasses
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime, timedelta
from functools import partial
from math import isinf
from typing import Final, NamedTuple

import msgspec

from robotapp_api.model.names import Annotation
from robotapp_api.values.placement.better_node import BetterNode, is_gain, parse_better_node
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.robotics_v1alpha1 import Reschedule
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.dry_run import DryRun
from robotapp_scheduler.core.cycle.re_evaluate import as_waiting
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import Member, member_of
from robotapp_scheduler.core.queue.namespace_turns import NamespaceTurns, TurnQueue
from robotapp_scheduler.core.robotics.app_index import InstanceKey, Link, budget_for_s, is_complete
from robotapp_scheduler.core.robotics.edge_times import (
    Late,
    PlacedComponent,
    Times,
    movable,
    over_budget,
    part_of,
    peer_nodes,
    worst_of,
)
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner

log = logging.getLogger(__name__)

MOVES_WHEN: Final = "BudgetExceeded"
TICK_S: Final = 0.25
"""How often `tick` is called: work comes in small pieces, so that no decision waits for much of it."""
LOOKS: Final = 50
"""Instances looked at per tick, 10 us per component."""
ROUND_S: Final = 60.0
"""How often all instances are looked at: for what no event tells, such as another primary node of a robot."""
FOR_THE_KEPT: Final = 8
"""A tick searches for one component: an attempt over all nodes without caches, 4 ms at 5000 nodes. Of so many searches one is for a pod that the operator would not move, also while others wait."""
SEARCH_S: Final = 10.0
"""Pause between two searches for one component that has a proposal."""
RETRY_S: Final = (0.5, 2.0)
"""The same pause where nothing was found, at first and in the long run: another node may have reported meanwhile, or the app come to rest.
Just after `for` a probe that was slow for once is often all that stands in the way.
"""
RETRY_SHARE: Final = 0.2
"""In between the pause is this share of the time that a search has been due."""
VALID: Final = timedelta(minutes=30)
SKEW: Final = timedelta(minutes=1)
"""An earlier leader's clock may have been ahead by so much."""
RENEW: Final = timedelta(minutes=10)
"""A proposal that still holds is written anew when it expires this soon."""
REST_S: Final = 60.0
"""Pause after a write before the next proposal for the same pod."""
SEEN_S: Final = 5.0
"""Pause after a write before a proposal is withdrawn: until the watch shows what was written."""
SUCCESSOR_S: Final = 60.0
"""The place proposed to a pod that has been evicted is kept so long for its successor."""


# --- Which node -------------------------------------------------------------------------------------------------------


class Proposal(NamedTuple):
    """The times are those of the connection for whose sake it is."""

    node: str
    before_us: float
    after_us: float


def better_node(core: SchedulerCore, part: PlacedComponent, late: Late, *, standing: str = "") -> Proposal | None:
    """The proposal for a component of an instance that is `settled`; None when it has to stay where it is.

    late: the connection for whose sake it may move. standing: the node that was proposed before. It is proposed again as long as it is feasible and better, so that equal
    nodes do not take turns.
    """
    node, kept = _choice(core, part, standing)
    found = _judged(core.cluster, part, late, node) if node else None
    if found is None or not kept or node == standing:
        return found
    return _judged(core.cluster, part, late, standing) or found


def settled(core: SchedulerCore, part: PlacedComponent) -> bool:
    """Is the instance at rest and in reach? All pods of it are bound and stay, and no node at issue is lost."""
    app, cluster = part.app, core.cluster
    if not app.observed or app.problems or part.pod.spec.scheduler_name not in core.scheduler_names:
        return False
    for name, component in app.components.items():
        replicas = cluster.apps.replicas(part.member, name)
        if not is_complete(component, len(replicas)):
            return False
        for replica in replicas:
            meta = replica.pod.metadata
            if not replica.node or meta.deletion_timestamp is not None or cluster.is_assumed(meta.uid):
                return False
    peers = {link.peer: link for link in part.budgeted}.values()
    others = {node for link in peers for node in peer_nodes(link, part.member, cluster)}
    return not any(core.groups.lost(node) for node in (part.node, *others))


def _choice(core: SchedulerCore, part: PlacedComponent, standing: str) -> tuple[str, bool]:
    """The node that the scheduler would take ("" = none), and whether the node that was proposed before is still feasible."""
    cluster = core.cluster
    with as_waiting(cluster, part.pod, anew=True) as pod:
        info = cluster.pod_info(pod)
        # Without caches: neither they nor the counters of decisions notice.
        runner = ProfileRunner(core.runner(info.scheduler_name).profile, cluster, caching=False)
        record, evaluation = core.consider(info, runner)
    node = record.node or ""
    row = cluster.nodes.row_of.get(standing)
    if row is None or evaluation is None or not evaluation.has(row):
        return node, False
    (position,) = evaluation.positions(slice(row, row + 1))
    return node, bool(evaluation.reason[position] == 0)


def _judged(cluster: Cache, part: PlacedComponent, late: Late, node: str) -> Proposal | None:
    """The proposal of a node; None when it is no gain, or another connection would be over its budget there."""
    if node == part.node:
        return None
    measured = Times(part, cluster, cluster.rtt.measured_us)
    estimated = Times(part, cluster, lambda one, other, of: cluster.rtt.between(one, other, of)[0])
    # While probes of the connection get no answer, only a measured time shows that it works from the other node.
    after_us = (measured if isinf(late.us) else estimated).at(late.link, node)
    budget_us = late.link.budget_us or 0
    if after_us is None or not is_gain(before_us=late.us, after_us=after_us, budget_us=budget_us):
        return None
    for link in part.budgeted:
        if link != late.link and _is_worse(link, measured.at(link, part.node), estimated.at(link, node)):
            return None
    return Proposal(node, late.us, after_us)


def _is_worse(link: Link, here_us: float | None, there_us: float | None) -> bool:
    """Would the connection leave its budget there, or be further from it? One of which less is known there counts, too."""
    if there_us is None:
        return here_us is not None
    if there_us <= (link.budget_us or 0):
        return False
    return here_us is None or here_us <= (link.budget_us or 0) or there_us > here_us


@dataclasses.dataclass(slots=True)
class Place:
    """A node that was proposed to a pod. `gone_s`: since when the pod has been gone, while the node is kept for its successor."""

    pod: Pod
    node: str
    gone_s: float | None = None


@contextmanager
def places_taken(cluster: Cache, places: Iterable[Place]) -> Iterator[None]:
    """The cluster with pods that may come at these places; afterwards all is as before."""
    with DryRun(cluster, preemption=False) as dry_run:
        for place in places:
            pod = place.pod
            # With a name of its own, or the running pod could not be found by its name afterwards.
            meta = msgspec.structs.replace(pod.metadata, uid=f"{pod.metadata.uid}/successor", name="successor")
            spec = msgspec.structs.replace(pod.spec, node_name="")
            coming = msgspec.structs.replace(pod, metadata=meta, spec=spec)
            dry_run.put(cluster.record(cluster.pod_info(coming), place.node))
        yield


def why_kept(reschedule: Reschedule) -> str:
    """Why the operator would move no component of such an app; "" where it would."""
    if reschedule.when != MOVES_WHEN:
        return f"placement.reschedule.when is not {MOVES_WHEN}"
    return "" if reschedule.max_per_day else "placement.reschedule.maxPerDay is 0"


# --- When it is proposed ----------------------------------------------------------------------------------------------


class AnnotationWrite(NamedTuple):
    """The annotation of this pod is to be `better`; None removes it."""

    pod: Pod
    better: BetterNode | None


@dataclasses.dataclass(slots=True)
class WatchedPod:
    """A pod whose budget is exceeded, or that has a proposal. Times are monotonic seconds."""

    member: Member
    met_s: float
    """From when all budgets have been met, while they are."""
    late_s: dict[Link, float] = dataclasses.field(default_factory=dict)
    """From when each connection has been over its budget, of those that are."""
    for_s: float = 0.0
    """How long it must be so before it counts. A link that is cut for a moment is no reason to move either."""
    search_s: float = 0.0
    """No search before."""
    written_s: float = float("-inf")
    neighbours: int = 0
    """Pods on the proposed node when it was searched last."""

    def note(self, late: Iterable[Link], now_s: float) -> None:
        """These connections are over their budgets now, and no others."""
        if self.late_s:
            self.met_s = now_s
        self.late_s = {link: self.late_s.get(link, now_s) for link in late}

    def is_met(self, now_s: float) -> bool:
        """Have all budgets been met for long enough?"""
        return not self.late_s and now_s - self.met_s >= self.for_s

    def lasting(self, now_s: float) -> frozenset[Link]:
        """Connections that have been over their budgets for long enough."""
        return frozenset(link for link, since_s in self.late_s.items() if now_s - since_s >= self.for_s)

    def retry_s(self, now_s: float) -> float:
        """Pause after a search that found nothing, or whose result could not be written."""
        due_s = now_s - self.for_s - min(self.late_s.values(), default=now_s)
        least_s, most_s = RETRY_S
        return min(max(least_s, RETRY_SHARE * due_s), most_s)


class BudgetWatch:
    """`tick` every `TICK_S` seconds. `clock`: monotonic seconds; `now`: the time of day, for expiries."""

    def __init__(self, core: SchedulerCore, *, clock: Callable[[], float], now: Callable[[], datetime]) -> None:
        self._core = core
        self._clock = clock
        self._now = now
        self._turn: TurnQueue[InstanceKey] = TurnQueue()
        """Instances that are to be looked at."""
        self._searches = NamespaceTurns()
        self._search_count = 0
        self._round_s = float("-inf")
        """When all instances were last added."""
        self._watched: dict[str, WatchedPod] = {}
        """By pod uid."""
        self._places: dict[str, Place] = {}
        """What is proposed, by pod uid: as written, or as the watch shows it."""

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
        self._look_at(cluster.apps.take_touched(nodes, robots))
        if now_s - self._round_s >= ROUND_S:
            self._round_s = now_s
            self._look_at(cluster.apps.instances())
        self._keep_places()
        self._watched = {uid: watched for uid, watched in self._watched.items() if uid in cluster.placed}
        self._look_at((each.member.app_uid, each.member.instance) for each in self._watched.values())
        return self._turn.pop(LOOKS)

    def _look_at(self, instances: Iterable[InstanceKey]) -> None:
        for instance in instances:
            self._turn.add(self._namespace_of(instance[0]), instance)

    def _namespace_of(self, app_uid: str) -> str:
        app = self._core.cluster.apps.app(app_uid)
        return app.source.metadata.namespace if app is not None else ""

    def failed(self, uid: str) -> None:
        """A write that `tick` gave for this pod has failed: it is decided anew soon, as if there had been none."""
        watched = self._watched.get(uid)
        if watched is not None:
            now_s = self._clock()
            watched.written_s, watched.search_s = float("-inf"), now_s + watched.retry_s(now_s)

    def _keep_places(self) -> None:
        """A place is kept while its proposal stands, and from the pod's end until its successor has a node."""
        for uid, place in list(self._places.items()):
            placed = self._core.cluster.placed.get(uid)
            if self._is_over(place) if placed is None else not self._stands(place, placed.pod):
                del self._places[uid]

    def _is_over(self, place: Place) -> bool:
        """Has the successor of a pod that is gone a node, or did none come?"""
        now_s, member = self._clock(), member_of(place.pod.metadata.labels or {})
        if place.gone_s is None:
            place.gone_s = now_s
        return now_s - place.gone_s >= SUCCESSOR_S or (member is not None and _has_node(self._core.cluster, member))

    def _stands(self, place: Place, pod: Pod) -> bool:
        """Does the pod's annotation propose this node, or was it written a moment ago?"""
        watched = self._watched.get(pod.metadata.uid)
        unseen = watched is not None and self._clock() - watched.written_s < SEEN_S
        return unseen or self._standing_node(pod) == place.node

    def _standing_node(self, pod: Pod) -> str:
        """The node that is proposed; "" also for one that is proposed for longer than this scheduler ever does."""
        standing, now = _standing(pod), self._now()
        return standing.node if standing is not None and now < standing.expires <= now + VALID + SKEW else ""

    def _others(self, uid: str) -> list[Place]:
        """Places that other pods are about to take: the operator moves them there, or their successors are on their way."""
        nodes, placed = self._core.cluster.nodes.row_of, self._core.cluster.placed
        return [
            place
            for other, place in self._places.items()
            if other != uid
            and place.node in nodes
            and (other not in placed or (placed[other].node != place.node and self._moves(place.pod)))
        ]

    def _moves(self, pod: Pod) -> bool:
        """Does the operator move the pod for a proposal? For others it only shows where they would be better off."""
        member = member_of(pod.metadata.labels or {})
        app = self._core.cluster.apps.app(member.app_uid) if member is not None else None
        return app is not None and not why_kept(app.source.spec.placement.reschedule)

    def _components(self, app_uid: str, instance: str) -> Iterator[PlacedComponent]:
        apps = self._core.cluster.apps
        app = apps.app(app_uid)
        if app is None:
            return
        for name in movable(app):
            part = part_of(app, Member(app_uid, instance, name), apps)
            if part is not None:
                yield part

    def _looked_at(self, instance: InstanceKey) -> list[AnnotationWrite]:
        parts = list(self._components(*instance))
        found = [write for part in parts if (write := self._look(part)) is not None]
        return found + self._left_over(instance, {part.pod.metadata.uid for part in parts})

    def _left_over(self, instance: InstanceKey, movable_uids: set[str]) -> list[AnnotationWrite]:
        """Withdraw proposals of pods that may not be moved any more: scaled up, or without a budget."""
        apps, found = self._core.cluster.apps, []
        app = apps.app(instance[0])
        for name in app.components if app is not None else ():
            member = Member(*instance, name)
            for replica in apps.replicas(member, name):
                uid, ending = replica.pod.metadata.uid, replica.pod.metadata.deletion_timestamp is not None
                if uid in movable_uids or ending or uid not in self._core.cluster.placed:
                    continue
                if not _annotated(replica.pod):
                    self._watched.pop(uid, None)
                    continue
                self._watched.setdefault(uid, WatchedPod(member, self._clock()))
                if (write := self._write(replica.pod, None)) is not None:
                    found.append(write)
        return found

    def _searched_for(self, uid: str) -> list[AnnotationWrite]:
        write = self._search(uid)
        return [] if write is None else [write]

    def _look(self, part: PlacedComponent) -> AnnotationWrite | None:
        """Note whether the pod is over budget. Its proposal is withdrawn when all budgets have been met for long enough."""
        uid, now_s = part.pod.metadata.uid, self._clock()
        late = over_budget(part, self._core.cluster, self._core.cluster.rtt.measured_us)
        watched = self._watched.get(uid)
        if watched is None:
            if not late and not _annotated(part.pod):
                return None
            watched = self._watched[uid] = WatchedPod(part.member, now_s)
        if uid not in self._places and (node := self._standing_node(part.pod)):
            self._places[uid] = Place(part.pod, node)  # by an earlier leader
        watched.for_s = budget_for_s(part.app)
        watched.note(late, now_s)
        if not watched.is_met(now_s):
            return None
        if not _annotated(part.pod) and now_s - watched.written_s >= REST_S:
            del self._watched[uid]
            return None
        return self._write(part.pod, None)

    def _due(self) -> list[str]:
        """Pods for which a node is searched now, by turns of their namespaces. What may be moved comes first."""
        now_s = self._clock()
        due = sorted(
            (watched.search_s, uid)
            for uid, watched in self._watched.items()
            if (watched.search_s <= now_s or self._neighbours(uid) > watched.neighbours) and watched.lasting(now_s)
        )
        movable_uids = [uid for _, uid in due if self._moves(self._core.cluster.placed[uid].pod)]
        moved_uids = {*movable_uids}
        kept_uids = [uid for _, uid in due if uid not in moved_uids]
        self._search_count += bool(due)
        first, second = (
            (kept_uids, movable_uids) if self._search_count % FOR_THE_KEPT == 0 else (movable_uids, kept_uids)
        )
        chosen = self._searches.choose(
            (self._namespace_of(self._watched[uid].member.app_uid), uid) for uid in first or second
        )
        return [] if chosen is None else [chosen]

    def _neighbours(self, uid: str) -> int:
        """Pods on the node that is proposed to this pod: with one more of them the place may be gone. 0 without a proposal."""
        place = self._places.get(uid)
        return len(self._core.cluster.pods_on(place.node)) if place is not None else 0

    def _search(self, uid: str) -> AnnotationWrite | None:
        """Without a proposal it is searched again soon, with one the search only confirms it."""
        cluster, watched, now_s = self._core.cluster, self._watched[uid], self._clock()
        watched.search_s, watched.neighbours = now_s + watched.retry_s(now_s), self._neighbours(uid)
        app = cluster.apps.app(watched.member.app_uid)
        part = part_of(app, watched.member, cluster.apps) if app is not None else None
        if part is None or part.pod.metadata.uid != uid:
            return None  # it is on its way out
        if part.member.component not in movable(part.app):
            return self._write(part.pod, None)
        over, lasting = over_budget(part, cluster, cluster.rtt.measured_us), watched.lasting(now_s)
        standing = _standing(part.pod)
        late = _to_be_helped({link: us for link, us in over.items() if link in lasting}, standing)
        if late is None or not settled(self._core, part):
            return None
        with places_taken(cluster, self._others(uid)):
            found = better_node(self._core, part, late, standing=standing.node if standing else "")
        if found is not None or standing is not None:
            watched.search_s = now_s + SEARCH_S
        write = self._write(part.pod, (late.link, found) if found is not None else None)
        watched.neighbours = self._neighbours(uid)
        return write

    def _write(self, pod: Pod, found: tuple[Link, Proposal] | None) -> AnnotationWrite | None:
        """The write that makes the annotation what it should be; None when it is so, or a write was a moment ago."""
        watched, now_s, now = self._watched[pod.metadata.uid], self._clock(), self._now()
        since_s = now_s - watched.written_s
        if found is None:
            if not _annotated(pod) or since_s < SEEN_S:
                return None
            watched.written_s = now_s
            self._places.pop(pod.metadata.uid, None)
            return AnnotationWrite(pod, None)
        link, proposal = found
        standing = _standing(pod)
        holds = (
            standing is not None
            and (standing.node, standing.edge) == (proposal.node, link.edge)
            and RENEW <= standing.expires - now <= VALID + SKEW
        )
        if holds or since_s < REST_S:
            return None
        watched.written_s = now_s
        self._places[pod.metadata.uid] = Place(pod, proposal.node)
        expires = (now + VALID).replace(microsecond=0)
        return AnnotationWrite(
            pod, BetterNode(proposal.node, link.edge, proposal.before_us, proposal.after_us, expires)
        )


def _shielded(instance: InstanceKey, decide: Callable[[], list[AnnotationWrite]]) -> list[AnnotationWrite]:
    """What is decided of one instance; nothing where a bug ends it, of a plugin perhaps: the others have their turn all the same."""
    try:
        return decide()
    except Exception:
        log.exception("looking for better nodes failed: instance %r of the app with uid %s", instance[1], instance[0])
        return []


def _has_node(cluster: Cache, member: Member) -> bool:
    return any(replica.node for replica in cluster.apps.replicas(member, member.component))


def _to_be_helped(late: Mapping[Link, float], standing: BetterNode | None) -> Late | None:
    """For which of these connections a node is searched: that of the standing proposal, else the one that uses most of its budget.

    So two that are late do not take turns.
    """
    about = {link: us for link, us in late.items() if standing is not None and link.edge == standing.edge}
    return worst_of(about or late)


def _annotated(pod: Pod) -> bool:
    return Annotation.BETTER_NODE in (pod.metadata.annotations or {})


def _standing(pod: Pod) -> BetterNode | None:
    """The proposal on the pod; None without one that can be read."""
    try:
        return parse_better_node((pod.metadata.annotations or {}).get(Annotation.BETTER_NODE, ""))
    except ValueError:
        return None
