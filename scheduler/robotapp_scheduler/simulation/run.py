"""Places the waiting pods of a dump as the scheduler would, without a cluster: the same core, nothing around it.

What the process does beside deciding is left out, which the report mentions: claims of domains and devices, evictions,
time (nothing expires, back-off is over at once). Ties fall as in the live scheduler, for the same pod uids and nodes.
"""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

import msgspec

from robotapp_scheduler.config.load import SchedulerConfig
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.pods.in_place_resize import held_per_container
from robotapp_scheduler.simulation.dump import MOST_PROBLEMS, Dump
from robotapp_scheduler.simulation.rounds import Rounds
from robotapp_scheduler.watch.routes import routes

_NO_TIME = 0.0
Progress = Callable[[int, int], None]
"""Called with decisions so far and the number of pods that waited at first."""


@dataclass(frozen=True, slots=True)
class Placement:
    """What became of one pod."""

    namespace: str
    name: str
    profile: str
    node: str | None
    message: str = ""
    """Why it has none, in the words of its condition."""
    feasible: int = 0
    """Nodes that would have taken it."""
    score: int = 0
    was: str = ""
    """The node it runs on in the dump, for a pod that was placed again (`replay`)."""


def chosen_text(score: int, feasible: int) -> str:
    """Why a pod got its node, for people. `feasible`: nodes that would have taken it."""
    return f"best of {feasible} feasible nodes, score {score}" if feasible > 1 else "the only feasible node"


@dataclass(slots=True)
class Outcome:
    """Placements in the order they were decided, refused pods last."""

    config: str
    """Digest of the configuration."""
    nodes: int = 0
    placements: list[Placement] = field(default_factory=list)
    others: dict[str, int] = field(default_factory=dict)
    """Pods without a node that wait for another scheduler, by its name."""
    problems: list[str] = field(default_factory=list)
    ignored: dict[str, int] = field(default_factory=dict)

    @property
    def placed(self) -> int:
        """Pods with a node."""
        return sum(1 for placement in self.placements if placement.node is not None)

    @property
    def moved(self) -> int:
        """Pods placed again whose node is another one now."""
        return sum(1 for placement in self.placements if placement.was and placement.was != placement.node)


def simulate(dump: Dump, config: SchedulerConfig, *, replay: int = 0, progress: Progress = lambda *_: None) -> Outcome:
    """Place every waiting pod of our profiles; with `replay` the latest so many bound ones again, too."""
    world = _World(dump, config, progress)
    world.fill(replay)
    world.place()
    return world.outcome


class _World:
    def __init__(self, dump: Dump, config: SchedulerConfig, progress: Progress) -> None:
        self._dump = dump
        self._progress = progress
        self._names = frozenset(config.scheduler_names)
        self._counted = held_per_container if config.sums_per_container else _as_it_is
        self.cluster = Cache(clock=lambda: _NO_TIME)
        self.core = SchedulerCore(self.cluster, config.build(), clock=lambda: _NO_TIME)
        self.outcome = Outcome(config=config.digest, problems=list(dump.problems), ignored=dict(dump.ignored))
        self._was: dict[str, str] = {}

    def fill(self, replay: int) -> None:
        """Take the dump into the cluster, then queue what waits, in the order it was made."""
        for route in routes(self.cluster):
            for obj in self._dump.of(route.resource.kind):
                self._applied(route.resource.kind, obj, route.apply)
        identified = map(_identified, self._dump.of("Pod"))
        # Files may repeat each other: the last is meant.
        pods = list({pod.metadata.uid: pod for pod in identified}.values())
        again = {pod.metadata.uid for pod in latest_bound(pods, self._names, replay)}
        waiting = []
        for given in pods:
            pod = given
            if pod.metadata.uid in again:
                self._was[pod.metadata.uid] = pod.spec.node_name
                pod = msgspec.structs.replace(pod, spec=msgspec.structs.replace(pod.spec, node_name=""))
            self._applied("Pod", pod, lambda pod: self.cluster.apply_pod(self._counted(pod)))
            if not pod.spec.node_name and not pod.terminal and not pod.metadata.deletion_timestamp:
                waiting.append(pod)
        for pod in sorted(waiting, key=made):
            if pod.spec.scheduler_name in self._names:
                self._applied("Pod", pod, self.core.queue.add)
            else:
                name = pod.spec.scheduler_name or "default-scheduler"
                self.outcome.others[name] = self.outcome.others.get(name, 0) + 1
        self.outcome.nodes = self.cluster.nodes.count

    def place(self) -> None:
        """Decide until no pod finds a node any more."""
        waiting, decided = len(self.core.queue), 0

        def popped(count: int) -> None:
            nonlocal decided
            decided += count
            self._progress(decided, waiting)

        for decision in Rounds(self.core, placed=self._note, popped=popped).place().values():
            self._note(decision)
        for queued in self.core.queue.gated():
            gate = queued.gate
            pod = queued.info
            text = f"held: {gate.reason}" if gate is not None else "held"
            self.outcome.placements.append(Placement(pod.namespace, pod.name, pod.scheduler_name, None, text))

    def _note(self, decision: ScheduleResult) -> None:
        pod = decision.pod
        self.outcome.placements.append(
            Placement(
                namespace=pod.namespace,
                name=pod.name,
                profile=pod.scheduler_name,
                node=decision.node,
                message=decision.message,
                feasible=decision.feasible,
                score=decision.total,
                was=self._was.get(pod.uid, ""),
            )
        )

    def _applied(self, kind: str, obj: Any, take: Callable[[Any], object]) -> None:
        """One object the rules cannot read must not end the simulation, as it does not end the scheduler."""
        try:
            take(obj)
        except (ValueError, TypeError, KeyError, OverflowError, ArithmeticError) as error:
            if len(self.outcome.problems) < MOST_PROBLEMS:
                meta = obj.metadata
                self.outcome.problems.append(f"{kind} {meta.namespace}/{meta.name}: left out: {error}")


def _as_it_is(pod: Pod) -> Pod:
    return pod


def latest_bound(pods: Iterable[Pod], names: Collection[str], count: int) -> list[Pod]:
    """The `count` pods of these profiles that were made last and have a node."""
    ours = [pod for pod in pods if pod.spec.node_name and pod.spec.scheduler_name in names and not pod.terminal]
    return sorted(ours, key=made)[-count:] if count > 0 else []


def made(pod: Pod) -> str:
    """When a pod was made: RFC 3339 texts of one zone sort by time. The sort is stable, so the dump's order decides ties."""
    return pod.metadata.creation_timestamp or "9999"


def _identified(pod: Pod) -> Pod:
    """A manifest has no uid yet; its name serves."""
    meta = pod.metadata
    if meta.uid:
        return pod
    made_up = msgspec.structs.replace(meta, uid=f"{meta.namespace or 'default'}/{meta.name}")
    return msgspec.structs.replace(pod, metadata=made_up)
