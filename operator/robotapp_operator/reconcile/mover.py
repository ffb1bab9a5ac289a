"""Carries out moves: evicts a pod so that its successor starts on another node, or starts again.

What must outlive this process is written first, into an annotation of the component's Deployment, on condition of its
resourceVersion. An eviction is on condition of the pod's uid, so a repeated one has no effect.
"""

import logging
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from typing import Any, Final, NamedTuple

from robotapp_api.model.app.component import Component
from robotapp_api.model.names import Annotation, EventReason, Label
from robotapp_api.values.placement.better_node import BetterNode, parse_better_node
from robotapp_claims.rules.instances import Instance, closed_nodes
from robotapp_client import ApiClient, Conflict, NotFound
from robotapp_client.api.resources import DEPLOYMENTS
from robotapp_client.tools.event_recorder import EventRecorder
from robotapp_operator.plan.moves.device_moves import RESTART, move_for_device, on_loss_of, restarts
from robotapp_operator.plan.moves.mass_loss import Losses
from robotapp_operator.plan.moves.move_record import parse_moves
from robotapp_operator.plan.moves.rescheduling import Move, Running, Stays, limits_of, moved_text, reschedule
from robotapp_operator.plan.render.devices.resource_claim import named_claim
from robotapp_operator.plan.render.node_affinity import tolerates_all
from robotapp_operator.plan.spec.desired import NEVER, App, desired_of
from robotapp_operator.plan.spec.objects import Deployment, Node, Pod
from robotapp_operator.plan.status.device_conflicts import free_elsewhere
from robotapp_operator.plan.status.device_loss import is_there, parse_record, record_text
from robotapp_operator.plan.status.events import PendingEvent
from robotapp_operator.plan.status.facts import InstanceFacts
from robotapp_operator.plan.status.latency import between
from robotapp_operator.queue.work import StartOver
from robotapp_operator.reconcile.apply_plan import evict
from robotapp_operator.reconcile.devices.resource_claims import release_claims
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.reconcile_state import Again, InstanceMemory, ReconcileState
from robotapp_operator.reconcile.status_reporter import send_event
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.facts.device_facts import device_losses, devices_of_pods
from robotapp_operator.watch.lister import instances_by_name, owned_deployments, problems_now

log = logging.getLogger(__name__)

LOST_S: Final = 10.0
"""A device must be gone for so long before it counts as lost: a touched cable moves nothing."""
COUNT_LOSSES_S: Final = 1.0
"""The losses of the whole cluster are counted anew after so long: far less than LOST_S, so those of one report count together."""
MASS_LOSS_S: Final = 10.0
"""Interval of checks of a pod that stays because too many lost a device."""
STAYS_S: Final = 30.0
"""Interval of checks of a pod whose budget is exceeded and that stays: a cooldown ends without an event, and a node is opened without one of the app."""
SETTLED_S: Final = 1.0
"""Pause after a record was written whose times were ahead of our clock."""
REFUSED_S: Final = 30.0
"""Pause after an eviction that a PodDisruptionBudget forbids."""
ACTION: Final = "Move"


class DeployedPod(NamedTuple):
    """A component that has one settled pod."""

    deployment: Deployment
    pod: Pod


class Mover:
    """`enqueue` is called with the app's uid and the instance when the instance's text about moves changes."""

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        memory: ReconcileState,
        observer: Observer,
        recorder: EventRecorder,
        *,
        enqueue: Callable[[str, str], None],
        clock: Callable[[], float],
        now: Callable[[], datetime],
    ) -> None:
        self._client = client
        self._cache = cache
        self._memory = memory
        self._observer = observer
        self._recorder = recorder
        self._enqueue = enqueue
        self._clock = clock
        self._now = now
        self._losses: tuple[float, Losses] | None = None
        """With the time at which they were counted."""

    async def look(self, uid: str, name: str) -> Again:
        """Record lost devices of one instance, and move or restart pods where the plan decides so."""
        record = self._cache.apps.get(uid)
        app = record.app if record is not None and not record.deleting else None
        if app is None:
            return None
        idle = app.spec.suspend or not _may_move(app) or problems_now(app, self._cache)
        instance = None if idle else instances_by_name(app, self._cache).get(name)
        if instance is None or instance.missing or instance.problem:
            if (left := self._memory.of(uid).instances.get(name)) is not None:
                left.moving = None
                self._show(app, name, left)
            return None
        facts = self._observer.instance(app, instance)
        own = self._memory.of(uid).instance(name)
        if own.moving is not None:
            self._tell(app, own, self._components(app, name))
        if not self._is_about_anything(app, facts, own):
            self._show(app, name, own)
            return None
        parts = self._components(app, name)
        if await self._settle(parts):
            return SETTLED_S
        devices_again = await self._devices(app, facts, own, parts)
        for_device, for_edge, edges_again = self._decide(app, instance, facts, own, parts)
        move = next((one for one in (for_device, for_edge) if isinstance(one, Move)), None)
        refused = ""
        if move is not None:
            refused = await self._move(app, own, parts[move.component], move, for_device=move is for_device)
        device, edge = (_why(one, move, refused) for one in (for_device, for_edge))
        self._show(app, name, own, device=device, edge=edge)
        due = [again for again in (devices_again, edges_again, REFUSED_S if refused else None) if again is not None]
        return min(due, default=None)

    def _is_about_anything(self, app: App, facts: InstanceFacts, own: InstanceMemory) -> bool:
        """Whether a budget is exceeded, or a device lost now or before."""
        if facts.lost or own.lost_s or any(view.met is False for view in own.measured):
            return True
        mine = self._cache.deployments.of_instance(app.uid, facts.name).values()
        return app.wants_devices and any(Annotation.LOST_DEVICES in item.metadata.annotations for item in mine)

    def _decide(
        self, app: App, instance: Instance, facts: InstanceFacts, own: InstanceMemory, parts: Mapping[str, DeployedPod]
    ) -> tuple[Move | Stays | None, Move | Stays | None, Again]:
        """What to do about lost devices and about budgets, one move at most, and when another answer is due although nothing happens."""
        # What is out of reach is never evicted, and nothing moves while something else is moving.
        if not facts.robot_online or not facts.bound:
            return None, None, None
        now_s = self._clock()
        lasts = {
            view.key: own.times.lasts_from_s(view, for_s=app.budget_for_s) for view in own.measured if view.met is False
        }
        over = frozenset(key for key, from_s in lasts.items() if from_s <= now_s)
        running = {name: self._running(app, name, part) for name, part in parts.items()}
        lost = [device for device in facts.lost if now_s - own.lost_s.get(device.claim, now_s) >= LOST_S]
        for_device = move_for_device(
            app,
            lost,
            running=running,
            elsewhere=lambda component: self._elsewhere(app, instance, component, parts[component.name]),
            losses=self._all_losses,
            now=self._now(),
        )
        for_edge: Move | Stays | None = None
        if not isinstance(for_device, Move):
            for_edge = reschedule(
                app,
                own.measured,
                over=over,
                running=running,
                between=lambda one, two: between(one, two, self._cache.round_trips),
                unusable=lambda node: self._unusable(app, node),
                now=self._now(),
            )
        later = [from_s - now_s for from_s in lasts.values() if now_s < from_s < float("inf")]
        if isinstance(for_device, Stays):
            later.append(MASS_LOSS_S)  # it may depend on what other pods have lost
        if isinstance(for_edge, Stays) and for_edge.why and app.spec.placement.reschedule.when != NEVER:
            later.append(STAYS_S)
        return for_device, for_edge, min(later, default=None)

    # What there is

    def _components(self, app: App, instance: str) -> dict[str, DeployedPod]:
        """Components with exactly one pod, bound to a node that is Ready, and not ending."""
        pods, found = self._cache.pods_by_deployment(app.uid, instance), {}
        names = {component.name for component in app.spec.components}
        for deployment in owned_deployments(app, instance, self._cache):
            mine = [pod for pod in pods.get(deployment.metadata.uid, ()) if not pod.terminal]
            name = deployment.metadata.labels.get(Label.COMPONENT, "")
            if name in names and len(mine) == 1 and self._settled(mine[0]):
                found[name] = DeployedPod(deployment, mine[0])
        return found

    def _settled(self, pod: Pod) -> bool:
        node = self._cache.nodes.get(pod.spec.node_name)
        return pod.metadata.deletion_timestamp is None and node is not None and node.ready

    def _running(self, app: App, name: str, part: DeployedPod) -> Running:
        component = next(one for one in app.spec.components if one.name == name)
        text = part.pod.metadata.annotations.get(Annotation.BETTER_NODE, "")
        better: BetterNode | None = None
        unreadable = ""
        try:
            better = parse_better_node(text) if text else None
        except ValueError as problem:
            unreadable = str(problem)
        return Running(
            component=component,
            pod=part.pod.metadata.uid,
            node=part.pod.spec.node_name,
            record=parse_moves(part.deployment.metadata.annotations, Annotation.MOVES),
            better=better,
            unreadable=unreadable,
        )

    def _unusable(self, app: App, name: str) -> str:
        """One answer for nodes that do not exist and those that do not admit the namespace: the name is the tenant's."""
        node = self._cache.nodes.get(name)
        computers = {name, *self._cache.nodes.of_robot(node.robot)} if node is not None else set()
        if node is None or node.spec.unschedulable or name in self._closed(app, computers):
            return "takes no pods of this namespace now"
        return "" if node.ready else "is not Ready"

    def _usable(self, app: App) -> Mapping[str, Node]:
        closed = self._closed(app, self._cache.nodes)
        return {
            name: node
            for name, node in self._cache.nodes.items()
            if node.ready and not node.spec.unschedulable and name not in closed
        }

    def _closed(self, app: App, names: Iterable[str]) -> frozenset[str]:
        """Those of these nodes, all computers of each robot among them, that do not admit the app's namespace."""
        return closed_nodes([self._cache.nodes[name].metadata for name in names], app.namespace)

    def _elsewhere(self, app: App, instance: Instance, component: Component, part: DeployedPod) -> str:
        desired = desired_of(app, instance.robot)
        usable = self._usable(app)
        if named_claim(part.deployment.spec):  # only nodes with the driver have devices for its claim
            driver_nodes = self._cache.allocations.driver_nodes(self._cache.nodes).names
            usable = {name: node for name, node in usable.items() if name in driver_nodes}
        return free_elsewhere(
            component,
            desired,
            but=part.pod.spec.node_name,
            claims=self._cache.claims_by_name,
            used=devices_of_pods(self._cache),
            telemetry=self._cache.telemetry,
            nodes={name: node for name, node in usable.items() if tolerates_all(component, desired, node.spec.taints)},
        )

    # Devices

    async def _devices(
        self, app: App, facts: InstanceFacts, own: InstanceMemory, parts: Mapping[str, DeployedPod]
    ) -> Again:
        """Bring the records of lost devices up to date, and restart the pods whose devices are back."""
        now_s = self._clock()
        waiting: list[float] = []
        own.lost_s = {device.claim: own.lost_s.get(device.claim, now_s) for device in facts.lost}
        for name, part in parts.items():
            recorded = parse_record(part.deployment.metadata.annotations.get(Annotation.LOST_DEVICES, ""))
            component = next(one for one in app.spec.components if one.name == name)
            mine = {
                device.claim: device.pod
                for device in facts.lost
                if device.component == name and now_s - own.lost_s[device.claim] >= LOST_S
            }
            if mine.items() - recorded.items() and self._is_mass_restart(component, part):
                mine = {}
                waiting.append(MASS_LOSS_S)
            back = restarts(recorded, there=self._is_there) if on_loss_of(component) == RESTART else frozenset()
            pod = part.pod.metadata.uid
            kept = {claim: user for claim, user in recorded.items() if user == pod and self._keeps(claim, component)}
            if kept | mine != recorded:
                await self._annotate(
                    part.deployment, Annotation.LOST_DEVICES, record_text(kept | mine) if kept | mine else None
                )
            elif pod in back and facts.robot_online and own.evicted != pod:
                if await evict(self._client, part.pod):
                    waiting.append(REFUSED_S)
                    continue
                log.info("%s/%s lost a device that is back: it is restarted", app.namespace, part.pod.metadata.name)
                own.evicted = pod
        waiting += [LOST_S - (now_s - since_s) for since_s in own.lost_s.values() if now_s - since_s < LOST_S]
        return min(waiting, default=None)

    def _is_mass_restart(self, component: Component, part: DeployedPod) -> bool:
        """Whether so many pods lost devices that none of them is to restart when the devices are back."""
        node = part.pod.spec.node_name
        return on_loss_of(component) == RESTART and self._all_losses().too_many_to_restart(node)

    def _all_losses(self) -> Losses:
        """Of the whole cluster."""
        now_s = self._clock()
        if self._losses is None or now_s - self._losses[0] >= COUNT_LOSSES_S:
            self._losses = now_s, device_losses(self._cache)
        return self._losses[1]

    def _keeps(self, claim: str, component: Component) -> bool:
        """Whether a record of a loss is kept: until the pod is replaced where onLoss is Restart, else until the device is back."""
        return on_loss_of(component) == RESTART or not self._is_there(claim)

    def _is_there(self, claim: str) -> bool:
        found = self._cache.claims_by_name.get(claim)
        return found is not None and is_there(found, self._cache.telemetry) is True

    # Writes

    async def _settle(self, parts: Mapping[str, DeployedPod]) -> bool:
        """Write records anew that have times ahead of our clock; whether there were any."""
        now, found = self._now(), False
        for part in parts.values():
            record = parse_moves(part.deployment.metadata.annotations, Annotation.MOVES)
            settled = record.settled(now) if record is not None else None
            if settled is not None and settled is not record:
                await self._annotate(part.deployment, Annotation.MOVES, settled.text())
                found = True
        return found

    async def _move(self, app: App, own: InstanceMemory, part: DeployedPod, move: Move, *, for_device: bool) -> str:
        """Why the pod could not be evicted, "" when it was, or when it is gone already."""
        if own.evicted == move.pod:
            return ""
        # A move that a disruption budget forbids is not recorded: another may replace the pod, and it was not moved then.
        refused = await evict(self._client, part.pod, dry_run=True)
        if refused == "" and not move.counted and not await self._count(app, part.deployment, move):
            return ""
        if refused == "":
            refused = await evict(self._client, part.pod)
        if refused:
            return f"{move.component} is not moved to {move.after}: {refused}"
        own.evicted = move.pod
        if refused is None:
            return ""
        log.info(
            "%s/%s: %s is evicted from %s for %s", app.namespace, app.name, move.component, move.before, move.after
        )
        own.moving = move
        if for_device:
            await self._release_claim(app, part)
        return ""

    async def _release_claim(self, app: App, part: DeployedPod) -> None:
        """Deletes the ResourceClaim of a pod that was evicted for a lost device, so that its successor has another device chosen.

        It must be as it was before the eviction: a scheduler that has bound the successor with it has written on it. The successor
        is then moved by a later check.
        """
        name, meta = named_claim(part.deployment.spec), part.pod.metadata
        for claim in self._cache.allocations.claims.of_instance(app.uid, meta.instance).values():
            if claim.metadata.name != name or claim.metadata.controller_uid != app.uid:
                continue
            if claim.metadata.namespace == app.namespace:
                await release_claims(self._client, [claim])

    def _tell(self, app: App, own: InstanceMemory, parts: Mapping[str, DeployedPod]) -> None:
        """Write the event of a move when the successor is on a node, about the node that the scheduler has chosen."""
        move = own.moving
        part = parts.get(move.component) if move else None
        if move is None or part is None or part.pod.metadata.uid == move.pod:
            return
        own.moving = None
        note = moved_text(move, part.pod.spec.node_name)
        log.info("%s/%s: %s", app.namespace, app.name, note)
        send_event(self._recorder, app, PendingEvent(EventReason.RESCHEDULED, note, warning=False), action=ACTION)

    async def _count(self, app: App, deployment: Deployment, move: Move) -> bool:
        """Add the move to the stored record; False when the limits forbid it by that record."""
        meta = deployment.metadata
        try:
            live = await self._client.get(DEPLOYMENTS, meta.name, namespace=meta.namespace, as_type=Deployment)
        except NotFound:
            return False
        now = self._now()
        record = parse_moves(live.metadata.annotations, Annotation.MOVES)
        if live.metadata.uid != meta.uid or record is None:
            return False
        if record.counts(move.pod, now):
            return True  # by this process a moment ago: the cache does not have it yet
        if record.why_not(move.pod, limits_of(app), now):
            return False
        await self._annotate(live, Annotation.MOVES, record.with_move(move.pod, now).text())
        return True

    async def _annotate(self, deployment: Deployment, key: Annotation, value: str | None) -> None:
        meta = deployment.metadata
        body: dict[str, Any] = {
            "metadata": {
                "uid": meta.uid,
                "resourceVersion": meta.resource_version,
                "annotations": {key.value: value},
            }
        }
        try:
            await self._client.patch(DEPLOYMENTS, meta.name, body, namespace=meta.namespace)
        except (Conflict, NotFound) as race:
            raise StartOver(f"Deployment {meta.name} changed while {key} was written") from race

    def _show(self, app: App, instance: str, own: InstanceMemory, *, device: str = "", edge: str = "") -> None:
        """Have the status show why a component is not moved, for a lost device or for an edge ("": nothing to show)."""
        if (own.device_stays, own.stays) != (device, edge):
            own.device_stays, own.stays = device, edge
            self._enqueue(app.uid, instance)


def _why(decision: Move | Stays | None, move: Move | None, refused: str) -> str:
    """Why nothing is moved for this; `refused`: why the move that was decided could not be made."""
    if isinstance(decision, Stays):
        return decision.why
    return refused if decision is not None and decision is move else ""


def concerns(app: App, own: InstanceMemory | None) -> bool:
    """Whether `Mover.look` has anything to do for an instance: components may be moved, or why one was not is still shown."""
    return _may_move(app) or (own is not None and bool(own.stays or own.device_stays))


def _may_move(app: App) -> bool:
    """Whether components of the app can be moved at all: other schedulers propose no nodes and claim no devices."""
    return app.our_scheduler and (app.wants_devices or any(edge.latency for edge in app.spec.edges))
