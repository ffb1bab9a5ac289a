"""What the operator remembers between runs of one app. All of it may be lost at any time: it only saves work or words."""

import dataclasses
from collections import defaultdict
from collections.abc import Collection, Mapping
from datetime import datetime
from typing import Any, Final

from robotapp_api.model.names import Reason
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.diff.newer import Held
from robotapp_operator.plan.moves.rescheduling import Move
from robotapp_operator.plan.spec.objects import ChildRef
from robotapp_operator.plan.spec.validate import Problem
from robotapp_operator.plan.status.facts import InstanceFacts
from robotapp_operator.plan.status.latency import BudgetTimes, EdgeKey, EdgeView, Rest
from robotapp_operator.plan.status.pace import Bucket, Crowd, Writing

Again = float | None
"""Seconds after which to look again although nothing has happened; None: not before something does."""
RACE_S: Final = 1.0
"""Pause after a lost race: by then the watch has delivered what another writer did."""
Trouble = tuple[Reason, str]


@dataclasses.dataclass(slots=True)
class InstanceMemory:
    """Of one instance: the facts as last computed, what they were computed from, and what was published of them."""

    facts: InstanceFacts | None = None
    stamp: tuple[object, ...] = ()
    facts_until_s: float = float("inf")
    """When other latency figures may be published, or the robot's grace is over."""
    shown: dict[EdgeKey, EdgeView] | None = None
    """The latency figures that are published; None until they are read from the object."""
    measured: tuple[EdgeView, ...] = ()
    """Its edges as measured last."""
    times: BudgetTimes = dataclasses.field(default_factory=BudgetTimes)
    """Since when its edges have been over or within their budgets."""
    lost_s: dict[str, float] = dataclasses.field(default_factory=dict)
    """Since when devices have been lost, by claim."""
    stays: str = ""
    """Why a component is not moved although an edge of it exceeds its budget."""
    device_stays: str = ""
    """Why a component is not moved although a device of it is lost."""
    evicted: str = ""
    """Uid of the pod that this process evicted last."""
    moving: Move | None = None
    """A move whose new pod is not on a node yet."""
    rest: Rest = dataclasses.field(default_factory=Rest)
    writing: Writing = dataclasses.field(default_factory=Writing)
    version: str = ""
    """resourceVersion of the object as we left or found it."""
    written_facts: tuple[object, ...] = ()
    """The facts that the object is known to show."""
    created: bool = False
    """There has been an object."""
    pending_status: dict[str, Any] = dataclasses.field(default_factory=dict)
    """The latest status that differed from the stored one, without its times."""

    def found(self, version: str) -> None:
        """The object has this resourceVersion now. After a write by another operator, the figures in the object count as published:
        two operators that each insisted on their own figures would overwrite each other for ever.
        """
        if self.version and self.version != version:
            self.shown, self.stamp = None, ()
        self.version = version


@dataclasses.dataclass(frozen=True, slots=True)
class Unseen:
    """Children of one instance that were written for this generation of the app: uid and version of each, and until when
    (monotonic) the watch is expected to show them.
    """

    generation: int
    until_s: float
    versions: Mapping[ChildRef, tuple[str, int]]


@dataclasses.dataclass(slots=True)
class AppMemory:
    """What the operator remembers of one app. Tables are by instance name where nothing else is named."""

    outcomes: dict[str, DomainOutcome] = dataclasses.field(default_factory=dict)
    """The last answer to a request for a domain, granted or refused."""
    troubles: dict[str, Trouble] = dataclasses.field(default_factory=dict)
    """What the server refused."""
    held: dict[str, tuple[Held, ...]] = dataclasses.field(default_factory=dict)
    """The templates that are not written although they differ."""
    config_held: dict[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """Restarts for changes of ConfigMaps that wait, a sentence each."""
    config_due: dict[str, datetime] = dataclasses.field(default_factory=dict)
    """When the first of these may be."""
    deadlines: dict[str, datetime] = dataclasses.field(default_factory=dict)
    """The time at which an instance ends at the latest (completion.deadline)."""
    next_runs: dict[str, datetime] = dataclasses.field(default_factory=dict)
    """The next time at which a run of a schedule is due, or a due one is left out."""
    overrides: dict[str, object] = dataclasses.field(default_factory=dict)
    """By instance, the overrides that its node chose when the app was last planned."""
    barred: dict[str, frozenset[str]] = dataclasses.field(default_factory=dict)
    """Uids of pods that keep our gate, because no node that they may use admits their namespace."""
    judged: dict[str, dict[str, int]] = dataclasses.field(default_factory=dict)
    """By a pod's uid, the version of the nodes when its place was judged last."""
    settled: dict[str, tuple[int, str]] = dataclasses.field(default_factory=dict)
    """By a Deployment's uid, its generation and the hash it was found with."""
    unseen: dict[str, Unseen] = dataclasses.field(default_factory=dict)
    """What was written last and may not be in the caches yet."""
    new_domains: dict[str, int] = dataclasses.field(default_factory=dict)
    """Ids granted since the last status."""
    scaled: dict[str, None] = dataclasses.field(default_factory=dict)
    """Texts, in order, about Deployments that others scaled and that were set back: an event each is due."""
    instances: dict[str, InstanceMemory] = dataclasses.field(default_factory=dict)
    bugs: dict[tuple[str, str], str] = dataclasses.field(default_factory=dict)
    """Per kind of work and instance."""
    chosen: tuple[tuple[Instance, ...], tuple[Problem, ...]] | None = None
    """Which instances and which problems the app had when it was last planned."""
    shown: dict[str, tuple[EdgeView, ...]] = dataclasses.field(default_factory=dict)
    """The latency figures that the app's own status is about."""
    rest: Rest = dataclasses.field(default_factory=Rest)
    """Limits how often these change."""
    bucket: Bucket = dataclasses.field(default_factory=Bucket)
    """When the app's own status may be written."""
    reported: tuple[object, ...] = ()
    """What the app's last status was made of."""
    rendered: bool = False
    """This process has rendered a status of the app."""
    namespace_ends: bool = False
    """The app's namespace is being deleted. It stays so: an app of a later namespace of that name has another uid."""

    def instance(self, name: str) -> InstanceMemory:
        return self.instances.setdefault(name, InstanceMemory())

    def bug(self, instance: str | None = None) -> str:
        """The first bug, of one instance or of all; "" without any."""
        return next((text for (_, name), text in self.bugs.items() if instance in (None, name)), "")


class ReconcileState:
    """By app uid."""

    def __init__(self) -> None:
        self._apps: defaultdict[str, AppMemory] = defaultdict(AppMemory)
        self.crowd = Crowd()
        self.ending_namespaces: set[str] = set()
        """Namespaces of which the log has said since the last resync that they are being deleted."""

    def __len__(self) -> int:
        return len(self._apps)

    def of(self, uid: str) -> AppMemory:
        """The app's memory, a new one if there is none."""
        return self._apps[uid]

    def outcome(self, uid: str, robot: str) -> DomainOutcome | None:
        memory = self._apps.get(uid)
        return memory.outcomes.get(robot) if memory else None

    def without_domain(self) -> list[tuple[str, str]]:
        """(uid, instance) of all instances whose request for a domain was refused."""
        return [
            (uid, robot)
            for uid, memory in self._apps.items()
            for robot, outcome in memory.outcomes.items()
            if outcome.id is None
        ]

    def forget(self, uid: str) -> None:
        self._apps.pop(uid, None)
        self.crowd.leave(uid)

    def forget_instances(self, uid: str, kept: set[str]) -> None:
        """Drop what is about instances the app no longer has."""
        memory = self._apps.get(uid)
        if memory is None:
            return
        tables: tuple[dict[str, Any], ...] = (
            memory.outcomes,
            memory.troubles,
            memory.held,
            memory.config_held,
            memory.config_due,
            memory.deadlines,
            memory.next_runs,
            memory.overrides,
            memory.barred,
            memory.judged,
            memory.unseen,
            memory.new_domains,
            memory.instances,
            memory.shown,
        )
        for table in tables:
            for robot in set(table) - kept:
                del table[robot]

    def forget_children(self, uid: str, kept: Collection[str]) -> None:
        """Drop what was noted of children other than these uids. While some of our own are not in the caches yet, nothing is."""
        memory = self._apps.get(uid)
        if memory is not None and not memory.unseen:
            memory.settled = {child: found for child, found in memory.settled.items() if child in kept}

    def forget_facts(self) -> None:
        """Compute all facts anew, in case a change was missed."""
        self.ending_namespaces.clear()
        for memory in self._apps.values():
            memory.reported = ()
            for instance in memory.instances.values():
                instance.stamp, instance.written_facts = (), ()
