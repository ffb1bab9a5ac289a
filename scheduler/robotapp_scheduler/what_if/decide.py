"""Answers a question on a cache that is changed for good: call it in a copy of the process alone.

Lost nodes are marked as the node controller marks them, their pods end and get successors; round trips are replaced, apps are added
with the pods that the operator would make, profiles are swapped. Then the scheduler's own core places what has no node.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Final

import msgspec

from robotapp_api.model.names import PodReason
from robotapp_api.values.quantities.duration import format_us
from robotapp_scheduler.config.load import SchedulerConfig
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.better_node import Proposal, better_node, settled, why_kept
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.pods.pod_info import Member, member_of
from robotapp_scheduler.core.robotics.app_index import App, InstanceKey, Link, Replica
from robotapp_scheduler.core.robotics.edge_times import PlacedComponent, movable, part_of, worst_late
from robotapp_scheduler.simulation.rounds import Rounds
from robotapp_scheduler.simulation.run import chosen_text, latest_bound
from robotapp_scheduler.what_if import replay
from robotapp_scheduler.what_if.app_pods import instances_with_pods, running_apps, take_away, tried_app
from robotapp_scheduler.what_if.difference import Answer, Outcome, PodChange, edge_changes, in_order
from robotapp_scheduler.what_if.edges import edge_times, instances_on
from robotapp_scheduler.what_if.lost_nodes import SUCCESSOR, change_of, describe_own_program, fate, lost, successor_of
from robotapp_scheduler.what_if.question import Question, QuestionError, check_nodes
from robotapp_scheduler.what_if.replay import compare_choices

REPLAY_S: Final = 0.5
"""After this long no further running pod is placed again: the answer is to be there within a second."""
SEARCH_S: Final = 3.0
"""After this long no better node is searched any more: the worker is given five seconds, and a busy machine is slow."""
MOST_REPLAYED: Final = 2000
"""`placement.reschedule.when` of an app whose pods the operator moves."""
NOT_TRIED: Final = "not tried: claims of domains, evictions, discovery servers of new apps; a priorityClassName in a new app counts as 0"


def answer(
    core: SchedulerCore, question: Question, config: SchedulerConfig | None, *, clock: Callable[[], float]
) -> Answer:
    """What would be different. Raises QuestionError. The cache is another one afterwards."""
    check_nodes(question, core.cluster.nodes.row_of)
    return _Decider(core, question, config, clock).answer()


class _Decider:
    def __init__(
        self, core: SchedulerCore, question: Question, config: SchedulerConfig | None, clock: Callable[[], float]
    ) -> None:
        self._before = core
        self._cluster = core.cluster
        self._question = question
        self._clock = clock
        self._began_s = clock()
        profiles: Mapping[str, Profile] = (
            config.build() if config is not None else {name: core.runner(name).profile for name in core.scheduler_names}
        )
        self._core = SchedulerCore(core.cluster, profiles, clock=clock)
        self._pods: list[PodChange] = []
        self._notes: list[str] = []
        self._was: dict[str, str] = {}
        """Where a pod that is placed anew was, by uid."""
        self._told: set[str] = set()
        """Uids of pods that need no other answer."""
        self._lost = tuple(dict.fromkeys(question.node_loss))
        self._running = sum(self._ours(placed.pod) for placed in core.cluster.placed.values())

    def answer(self) -> Answer:
        if self._question.replay:
            return self._answer_replay()
        running = running_apps(self._question.names, self._cluster)
        replaced = instances_with_pods(running.values(), self._cluster)
        concerned = list(dict.fromkeys([*instances_on(self._question.nodes, self._cluster), *replaced]))
        before = edge_times(concerned, self._cluster)
        late = self._late(concerned)
        for pair in self._question.rtt:
            self._cluster.suppose_round_trip(pair.one, pair.other, float(pair.us))
        former = take_away(running.values(), self._cluster)
        successors = [pod for node in self._lost for pod in self._lose(node)]
        made = self._apps(running, former, replaced)
        self._queue(successors, made)
        self._place()
        new = [(member.app_uid, member.instance) for pod in made if (member := member_of(pod.metadata.labels or {}))]
        after = edge_times(dict.fromkeys([*concerned, *new]), self._cluster, lost=frozenset(self._lost))
        self._better([each for each in concerned if each not in replaced], late)
        if self._question.config is not None:
            self._replay()
        edges, same = edge_changes(before, after)
        return Answer(
            pods=in_order(self._pods),
            edges=edges,
            edges_unchanged=same,
            notes=(*self._notes, NOT_TRIED),
            decided_ms=round(1000 * (self._clock() - self._began_s), 1),
        )

    def _answer_replay(self) -> Answer:
        """The latest placements under the supposed configuration, and nothing else."""
        until_s = self._began_s + replay.REPLAY_S
        result = replay.replay_latest(
            self._before, self._core, self._question.replay, clock=self._clock, until_s=until_s
        )
        return Answer(
            pods=in_order(result.pods),
            edges=result.edges,
            edges_unchanged=result.edges_unchanged,
            replayed=result.judged,
            notes=result.notes,
            decided_ms=round(1000 * (self._clock() - self._began_s), 1),
        )

    # --- Lost nodes and new apps ---------------------------------------------------------------------------------

    def _lose(self, node: str) -> list[Pod]:
        """Mark the node and end its pods; their successors."""
        cluster, others = self._cluster, 0
        row = cluster.nodes.row_of[node]
        stored = cluster.nodes.objects[row]
        if stored is not None:
            cluster.apply_node(lost(stored))
        cluster.suppose_unreachable(node)
        found = []
        for placed in list(cluster.pods_on(node)):
            pod = placed.pod
            if pod.metadata.deletion_timestamp is not None:
                continue
            if pod.spec.scheduler_name not in self._before.scheduler_names:
                others += 1
                if own := describe_own_program(pod, node):
                    self._notes.append(own)
                continue
            change = fate(pod, node, cluster)
            if change is not None:
                self._told.add(pod.metadata.uid)
                self._pods.append(change)
                continue
            successor = successor_of(pod)
            self._was[successor.metadata.uid] = node
            found.append(successor)
        if others:
            what = "1 pod of another scheduler is" if others == 1 else f"{others} pods of other schedulers are"
            self._notes.append(f"{what} on {node}: where they go is not decided here")
        return found

    def _apps(
        self,
        running: Mapping[tuple[str, str], App],
        former: dict[Member, list[Replica]],
        replaced: Collection[InstanceKey],
    ) -> list[Pod]:
        """Add the apps in place of those that run under their names; their pods."""
        found: list[Pod] = []
        for source, name in zip(self._question.apps, self._question.names, strict=True):
            nodes = [node for node in self._cluster.nodes.objects if node is not None]
            uid = running[name].uid if name in running else ""
            tried = tried_app(
                source,
                nodes,
                profiles=self._core.scheduler_names,
                running=running.get(name),
                robots={robot for app_uid, robot in replaced if app_uid == uid},
            )
            self._cluster.apply_app(tried.app)
            self._give_back(former, uid, tried.kept)
            self._notes += tried.notes
            for pod in tried.pods:
                member = member_of(pod.metadata.labels or {})
                places = former.get(member, []) if member is not None else []
                self._was[pod.metadata.uid] = places.pop(0).node if places else ""
            found += tried.pods
        for left in former.values():
            for pod, node in left:
                reason = "its app would have no such pod any more"
                self._pods.append(change_of(pod, self._cluster, Outcome.ENDS, from_=node, reason=reason))
        for namespace, app in running:
            self._notes.append(f"RobotApp {namespace}/{app} runs: its pods are compared with where they are now")
        return found

    def _give_back(self, former: dict[Member, list[Replica]], uid: str, robots: Collection[str]) -> None:
        """Pods on robots that no node shows are as they were."""
        for member in [each for each in former if each.app_uid == uid and each.instance in robots]:
            for replica in former.pop(member):
                self._cluster.apply_pod(replica.pod)

    # --- Deciding ------------------------------------------------------------------------------------------------

    def _queue(self, successors: list[Pod], made: list[Pod]) -> None:
        """Queue the pods. A predecessor that need not be waited for is gone when its successor is placed."""
        cluster = self._cluster
        for pod in (*successors, *made):
            try:
                cluster.apply_pod(pod)
            except (ValueError, TypeError, OverflowError) as error:
                raise QuestionError(f"pod {pod.metadata.namespace}/{pod.metadata.name}: {error}") from error
        for pod in successors:
            gate = self._core.groups.gate(cluster.pod_info(pod))
            if gate is not None and gate.code == PodReason.WAITING_FOR_PREDECESSOR:
                self._note(pod, Outcome.PENDING, code=gate.code, reason=gate.reason)
                continue
            before = cluster.placed.get(pod.metadata.uid.removeprefix(SUCCESSOR))
            if before is not None:
                cluster.remove_pod(before.pod)
            self._told.add(pod.metadata.uid)
            self._core.queue.add(pod)
        for pod in made:
            self._told.add(pod.metadata.uid)
            self._core.queue.add(pod)

    def _place(self) -> None:
        refused = Rounds(self._core, placed=self._placed).place()
        for decision in refused.values():
            self._note(decision.pod.pod, Outcome.PENDING, code=str(decision.reason), reason=_with_evictions(decision))
        for queued in self._core.queue.gated():
            gate = queued.gate
            self._note(
                queued.info.pod,
                Outcome.PENDING,
                code=str(gate.code) if gate is not None else "",
                reason=gate.reason if gate is not None else "",
            )

    def _placed(self, decision: ScheduleResult) -> None:
        was, node = self._was.get(decision.pod.uid, ""), decision.node or ""
        if was == node:
            return
        reason = chosen_text(decision.total, decision.feasible)
        self._note(decision.pod.pod, Outcome.MOVES if was else Outcome.PLACED, to=node, reason=reason)

    def _note(self, pod: Pod, outcome: Outcome, **fields: str) -> None:
        was = self._was.get(pod.metadata.uid, "")
        self._pods.append(change_of(pod, self._cluster, outcome, from_=was, **fields))

    # --- Running pods --------------------------------------------------------------------------------------------

    def _components(self, instances: list[InstanceKey]) -> Iterator[PlacedComponent]:
        apps = self._cluster.apps
        for app_uid, instance in instances:
            app = apps.app(app_uid)
            for name in movable(app) if app is not None else ():
                part = part_of(app, Member(app_uid, instance, name), apps) if app is not None else None
                if part is not None:
                    yield part

    def _late(self, instances: list[InstanceKey]) -> set[str]:
        """Uids of pods that are over a budget."""
        measured = self._cluster.rtt.measured_us
        return {
            part.pod.metadata.uid for part in self._components(instances) if worst_late(part, self._cluster, measured)
        }

    def _better(self, instances: list[InstanceKey], late: set[str]) -> None:
        """Where pods would go whose budget is exceeded only now, one after the other: what one has taken the next cannot have."""
        cluster, skipped = self._cluster, 0
        for part in self._components(instances):
            worst = worst_late(part, cluster, cluster.rtt.measured_us)
            if worst is None or part.pod.metadata.uid in late or not settled(self._core, part):
                continue
            if self._clock() - self._began_s > SEARCH_S:
                skipped += 1
                continue
            found = better_node(self._core, part, worst)
            if found is None:
                continue
            kept = why_kept(part.app.source.spec.placement.reschedule)
            moves = not kept
            reason = _why_better(worst.link, found) + (f"; {kept}" if kept else "")
            outcome = Outcome.MOVES if moves else Outcome.MAY_MOVE
            self._told.add(part.pod.metadata.uid)
            self._pods.append(change_of(part.pod, cluster, outcome, from_=part.node, to=found.node, reason=reason))
            if moves:
                spec = msgspec.structs.replace(part.pod.spec, node_name=found.node)
                cluster.remove_pod(part.pod)
                cluster.apply_pod(msgspec.structs.replace(part.pod, spec=spec))
        if skipped:
            self._notes.append(f"{skipped} more pods are over a budget: not looked at for want of time")

    def _replay(self) -> None:
        """Decide about running pods under both configurations, the latest first, as many as there is time for."""
        pods = latest_bound(
            (placed.pod for placed in self._cluster.placed.values()), self._before.scheduler_names, MOST_REPLAYED
        )
        pods = [pod for pod in pods if pod.metadata.uid not in self._told and not pod.metadata.deletion_timestamp]
        looked = 0
        for pod in reversed(pods):
            if self._clock() - self._began_s > REPLAY_S:
                break
            looked += 1
            change = compare_choices(self._before, self._core, pod)
            if change is not None:
                self._pods.append(change)
        self._notes.append(
            f"{looked} of {self._running} running pods were placed again with the configuration, the latest first"
        )

    def _ours(self, pod: Pod) -> bool:
        return pod.spec.scheduler_name in self._before.scheduler_names


def _why_better(link: Link, found: Proposal) -> str:
    """`/cmd_vel to driver: 90ms of 30ms, 15ms there`."""
    times = f"{format_us(found.before_us)} of {format_us(link.budget_us or 0)}, {format_us(found.after_us)} there"
    return f"{link.edge}: {times}"


def _with_evictions(decision: ScheduleResult) -> str:
    count = len(decision.plan.victims) if decision.plan is not None else 0
    return f"{decision.message}; evicting {count} pods would make room" if count else decision.message
