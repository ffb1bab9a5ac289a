"""The facts that statuses are computed from, gathered from the caches."""

import dataclasses
from collections.abc import Mapping
from datetime import datetime

from robotapp_api.model.names import Reason
from robotapp_claims.rules.completion.endings import Ending
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.diff.attempts import FIRST_ATTEMPT, Attempt
from robotapp_operator.plan.diff.newer import Held
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.links import LinkView
from robotapp_operator.plan.spec.validate import Problem
from robotapp_operator.plan.status.components import ComponentView, HelperView
from robotapp_operator.plan.status.device_loss import LostDevice
from robotapp_operator.plan.status.latency import EdgeView


@dataclasses.dataclass(frozen=True, slots=True)
class Grace:
    """What `connectivity.grace` leaves to a robot whose node is not Ready. Moments, not seconds: a status is written once.

    since: when the node was last Ready. until: when the instance is Offline. Both RFC 3339, `seconds` apart.
    """

    since: str
    until: str
    seconds: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class InstanceFacts:
    """One instance as observed. Edges carry the published figures, worst first.

    `refusal`: why it has no domain. `busy`: the holder of a device it waits for. `trouble`: another reason why children are missing.
    `undecided`: its domain has not been requested since the operator's start, so the stored status still holds.
    """

    instance: Instance
    components: tuple[ComponentView, ...]
    app_name: str = ""
    ending: Ending | None = None
    """Why it has ended: its jobs have completed or failed."""
    changes_at: datetime | None = None
    """The next time at which these facts change without any event: a run of a schedule is due or left out, or the deadline is over."""
    attempt: Attempt = FIRST_ATTEMPT
    """The present attempt: how often the instance was started again, and why."""
    edges: tuple[EdgeView, ...] = ()
    domain: int | None = None
    needs_domain: bool = True
    undecided: bool = False
    devices_wanted: int = 0
    devices_held: int = 0
    busy: str = ""
    devices_handed_over: int = 0
    """Of those held: devices that a driver gives to the containers."""
    any_scheduler: bool = False
    """Whether all devices that it wants for itself are in ResourceClaims, which every scheduler allocates."""
    ledger_note: str = ""
    """What a user may not expect of how its components get devices."""
    missing_device: str = ""
    """The device that no node has on which its component may run, and what is there instead."""
    claims: tuple[str, ...] = ()
    refusal: tuple[Reason, str] | None = None
    trouble: tuple[Reason, str] | None = None
    held: tuple[Held, ...] = ()
    robot_online: bool = True
    grace: Grace | None = None
    """Of a robot that is not online; None when it is over."""
    infrastructure_ready: bool = True
    helpers: tuple[HelperView, ...] = ()
    """Its discovery servers, router or master."""
    offline_since: str = ""
    """When the robot's node was last Ready (RFC 3339); "" for one that is Ready or gone."""
    lost: tuple[LostDevice, ...] = ()
    moves: tuple[tuple[str, tuple[str, ...]], ...] = ()
    """Components that were moved, each with the times of its latest moves (RFC 3339)."""
    stays: str = ""
    """Why a component that would be better off elsewhere is not moved there."""
    device_stays: str = ""
    """Why a component whose device is lost is not moved to another one."""
    config_held: tuple[str, ...] = ()
    """Restarts for changes of ConfigMaps that wait, a sentence each."""
    present: tuple[str, ...] = ()
    """Devices it holds that their nodes' agents report as present: `device can0 on amr-07`."""
    links: tuple[LinkView, ...] = ()
    """Addresses of `service.links`."""
    cut_off: tuple[str, ...] = ()
    """Pods that a user must restart: their discovery servers were all replaced, or their ROS 1 master too often."""

    @property
    def wanted(self) -> tuple[ComponentView, ...]:
        """Its components without those that the spec suspends; none of an instance that has ended."""
        if self.ending is not None:
            return ()
        return tuple(component for component in self.components if not component.suspended)

    @property
    def ready(self) -> bool:
        """Does everything run as the spec wants it now? Not while the API server refuses a change of it, whatever its predecessor
        does, nor while the robot is out of sight: then the instance will end.
        """
        running = all(component.ready for component in self.wanted) and self.infrastructure_ready
        return bool(self.wanted) and running and self.trouble is None and not self.instance.missing

    @property
    def offline(self) -> bool:
        """Is its robot out of reach for longer than `connectivity.grace`, and do its pods no longer count as ready?"""
        return not self.robot_online and not self.ready and self.grace is None

    @property
    def bound(self) -> bool:
        """Are all pods on nodes that exist or are being made?"""
        begun = [component for component in self.wanted if not (component.waits or component.completed)]
        return bool(begun) and all(component.bound for component in begun)

    @property
    def worst(self) -> ComponentView | None:
        """The component to talk about, None when all are ready: not one that waits for others while one of these is not ready."""
        waiting = [component for component in self.wanted if not component.ready]
        return max(
            waiting,
            key=lambda component: (component.badness, not component.waits, bool(component.message)),
            default=None,
        )

    @property
    def failing_helpers(self) -> list[HelperView]:
        """Helpers that fail for a stated reason, worst first: of a role that has a ready one, none while the instance is not ready."""
        failing = [helper for helper in self.helpers if helper.view.reason is not None]
        if not self.ready:
            served = {helper.part.role for helper in self.helpers if helper.view.ready}
            failing = [helper for helper in failing if helper.part.role not in served]
        return sorted(failing, key=lambda helper: (-helper.view.badness, helper.part.name))

    @property
    def name(self) -> str:
        return self.instance.robot

    @property
    def unclear(self) -> str:
        """Why the instance cannot be made for its robot, with the cure; "" when it can. Such an instance is not started, but runs on."""
        return self.instance.problem

    @property
    def unclear_reason(self) -> Reason:
        """Whether the robot has no primary node, or a name that does not fit into the spec."""
        return Reason.INVALID_SPEC if self.instance.node else Reason.ROBOT_NODE_UNCLEAR

    @property
    def has_begun(self) -> bool:
        """Is there anything of it, or a reason why there is not?"""
        return self.exists or self.ending is not None or self.refusal is not None or self.trouble is not None

    @property
    def exists(self) -> bool:
        """Has any component been created?"""
        return any(component.exists for component in self.components)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class AppFacts:
    """The app and its instances in name order. `previous` is the status as last written or read (plain JSON).

    `now` is RFC 3339 in whole seconds. `alone`: these facts are about one instance and nothing else of the app.
    """

    app: App
    problems: tuple[Problem, ...] = ()
    notes: tuple[str, ...] = ()
    instances: tuple[InstanceFacts, ...] = ()
    previous: Mapping[str, object] = dataclasses.field(default_factory=dict)
    now: str
    alone: bool = False
    rmw: str = ""
    discovery: str = ""
    bug: str = ""
    conflict: str = ""
    """What the app runs with or holds and another one holds or runs with."""

    @property
    def ended(self) -> bool:
        """Whether all its instances have ended."""
        return bool(self.instances) and all(instance.ending is not None for instance in self.instances)

    @property
    def completion_time(self) -> str:
        """The time at which the last of its instances ended; "" while one has not, and for an app that is refused or suspended."""
        if self.problems or self.app.suspended or not self.ended:
            return ""
        return max(instance.ending.time for instance in self.instances if instance.ending)

    @property
    def refused(self) -> bool:
        """Is the spec itself wrong, whatever nodes and pools there are?"""
        return any(not problem.of_cluster for problem in self.problems)

    @property
    def begun(self) -> tuple[InstanceFacts, ...]:
        """The instances without those of a sweep that wait for their turn; all of them where none has begun."""
        if self.app.spec.matrix is None:
            return self.instances
        return tuple(instance for instance in self.instances if instance.has_begun) or self.instances

    @property
    def generation(self) -> int:
        """Of the object the status is about. The spec of a RobotAppInstance never changes."""
        return 1 if self.alone else self.app.generation


def of_instance(
    facts: AppFacts, instance: InstanceFacts, *, previous: Mapping[str, object], bug: str = "", conflict: str = ""
) -> AppFacts:
    """The same facts about one instance alone. `previous`, `bug` and `conflict` are the instance's own."""
    return dataclasses.replace(facts, instances=(instance,), previous=previous, bug=bug, conflict=conflict, alone=True)
