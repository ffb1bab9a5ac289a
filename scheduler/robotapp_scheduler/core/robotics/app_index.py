"""RobotApps, the owner chain of their pods, and where their components are.

Labels find candidates; that a pod belongs to an app is decided by its ownerReference chain
pod → ReplicaSet → Deployment → RobotApp, or pod → Job → RobotApp, inside one namespace.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import msgspec

from robotapp_api.model.names import ROBOT_END, Label
from robotapp_api.values.placement.better_node import edge_to, topic_of
from robotapp_api.values.placement.neighbours import NO_NEIGHBOURS, NeighbourRules, Neighbours, neighbours
from robotapp_api.values.placement.tiers import ROBOT
from robotapp_api.values.quantities.bandwidth import bandwidth_bps
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.replicas import expand_struct
from robotapp_scheduler.core.api.core_v1 import Owned, Pod, controller_of
from robotapp_scheduler.core.api.robotics_v1alpha1 import (
    Component,
    Edge,
    Reschedule,
    RobotApp,
    RobotAppSpec,
    SharedData,
)
from robotapp_scheduler.core.pods.pod_info import Member, member_of

ON_BOARD: Final = (ROBOT,)
"""`runsOn` of a component that never leaves its robot."""


class Link(NamedTuple):
    """An edge as one of its ends sees it."""

    what: str
    """For people: the topic, or a service or action by its kind and name."""
    peer: str
    """Component name, or `@robot`."""
    budget_us: int | None
    percentile: int
    required: bool

    @property
    def edge(self) -> str:
        """As the annotation of a proposal and the records of decisions name it."""
        return edge_to(self.what, self.peer)


class Flow(NamedTuple):
    """What an edge takes of the links between its ends."""

    from_: str
    to: str
    bps: int


class App(NamedTuple):
    """A RobotApp with its edges turned into links per component; `problems` are values that cannot be read.

    `neighbours`: components that must or must not share a node, of components with such rules.
    """

    source: RobotApp
    components: dict[str, Component]
    links: dict[str, tuple[Link, ...]]
    problems: tuple[str, ...]
    neighbours: Mapping[str, Neighbours]
    flows: tuple[Flow, ...] = ()
    """Of the edges whose bandwidth is stated."""

    @property
    def uid(self) -> str:
        """The app's uid."""
        return self.source.metadata.uid

    @property
    def observed(self) -> bool:
        """Whether the operator has observed the generation in the cache."""
        return self.source.status.observed_generation >= self.source.metadata.generation


InstanceKey = tuple[str, str]
"""(app uid, instance)."""


class Replica(NamedTuple):
    """One pod of a component; `node` is "" while it is not placed."""

    pod: Pod
    node: str


def budget_for_s(app: App) -> float:
    """`placement.reschedule.for`: how long a budget must be exceeded, or met, before that counts."""
    try:
        return parse_us(app.source.spec.placement.reschedule.for_) / 1_000_000
    except ValueError:  # stored before the schema had a pattern for it
        return parse_us(Reschedule().for_) / 1_000_000


def balances(app: App) -> bool:
    """`placement.objective: Balance`?"""
    return app.source.spec.placement.objective == "Balance"


def tied(component: Component) -> bool:
    """Bound to a robot or device: never refused because of a peer that could go elsewhere."""
    return component.runs_on == ON_BOARD or bool(component.devices)


def read_app(source: RobotApp) -> App:
    """Prepare an app, each replica that has an ordinal as a component of its own. Durations that cannot be read are collected, never guessed."""
    if (spec := expand_struct(source.spec)) is not source.spec:
        source = msgspec.structs.replace(source, spec=spec)
    problems: list[str] = []
    links: dict[str, list[Link]] = {}
    for i, edge in enumerate(source.spec.edges):
        budget_us = _duration(edge.latency.budget if edge.latency else "", f"edges[{i}].latency.budget", problems)
        for here, peer in ((edge.from_, edge.to), (edge.to, edge.from_)):
            if here != ROBOT_END:
                links.setdefault(here, []).append(_link(edge, peer, budget_us))
    for i, component in enumerate(source.spec.components):
        _duration(component.policies.latency_budget, f"components[{i}].policies.latencyBudget", problems)
        _duration(component.policies.deadline, f"components[{i}].policies.deadline", problems)
    flows = tuple(_flows(source.spec.edges, problems))
    return App(
        source=source,
        components={component.name: component for component in list_components(source.spec)},
        links={name: tuple(found) for name, found in links.items()},
        neighbours=neighbours(
            NeighbourRules(each.name, (*each.colocate_with, *each.shared_data.with_), each.separate_from)
            for each in source.spec.components
        ),
        flows=flows,
        problems=tuple(problems),
    )


def list_components(spec: RobotAppSpec) -> list[Component]:
    """Returns the components of a spec and those that its recordings become, as far as placement needs them."""
    recorders = (
        Component(
            name=recording.name,
            runs_on=recording.tiers,
            qos_class="best_effort",
            shared_data=SharedData(claim_names=(recording.volume.claim_name,) if recording.volume.claim_name else ()),
        )
        for recording in spec.recordings
    )
    return [*spec.components, *recorders]


class Connection(NamedTuple):
    """An edge once, as written: `link` is how the component `here`, one of its two ends, sees it."""

    from_: str
    to: str
    here: str
    link: Link


def connections(app: App) -> Iterator[Connection]:
    """The edges of an app, each once, in their order."""
    seen = {name: iter(links) for name, links in app.links.items()}
    for edge in app.source.spec.edges:
        ends = [(end, next(seen[end])) for end in (edge.from_, edge.to) if end != ROBOT_END]
        if ends:
            here, link = ends[0]
            yield Connection(edge.from_, edge.to, here, link)


def _flows(edges: Sequence[Edge], problems: list[str]) -> Iterator[Flow]:
    for i, edge in enumerate(edges):
        try:
            bps = bandwidth_bps(edge.bandwidth, rate_hz=edge.rate_hz, message_bytes=edge.message_bytes)
        except ValueError as error:
            problems.append(f"spec.edges[{i}]: {error}")
            continue
        if bps > 0:
            yield Flow(edge.from_, edge.to, bps)


def is_complete(component: Component, pods: int) -> bool:
    """Whether so many pods are all that a component has for now: one that waits for others (dependsOn) has none until they are ready, and
    a job has none before its next attempt and after it has ended.
    """
    return pods == component.replicas or (pods == 0 and (bool(component.depends_on) or component.job is not None))


def on_one_node(app: App, component: str) -> bool:
    """Must all pods of the component be on one node? So it is where a partner has one pod only."""
    partners = app.neighbours.get(component, NO_NEIGHBOURS).together
    return bool(partners) and any(app.components[name].replicas == 1 for name in (component, *partners))


def _link(edge: Edge, peer: str, budget_us: int | None) -> Link:
    latency = edge.latency
    return Link(
        what=topic_of(edge.kind, edge.topic),
        peer=peer,
        budget_us=budget_us,
        percentile=latency.percentile if latency else 95,
        required=latency is None or latency.enforce == "Required",
    )


def _duration(text: str, field: str, problems: list[str]) -> int | None:
    if not text:
        return None
    try:
        return parse_us(text)
    except ValueError:
        problems.append(f"spec.{field}: {text!r} is not a duration such as 30ms")
        return None


class AppIndex:
    """RobotApps by uid, owners by uid, and all live pods that carry an app's labels."""

    def __init__(self) -> None:
        self._apps: dict[str, App] = {}
        self._owners: dict[str, Owned] = {}
        self._expected: Mapping[Member, tuple[str, ...]] = {}
        self._replicas: dict[InstanceKey, dict[str, dict[str, Replica]]] = {}
        self._on_node: dict[str, Counter[InstanceKey]] = {}
        """How many pods of an instance a node has."""
        self._touched: set[InstanceKey] = set()
        self._touched_apps: set[str] = set()
        """What changed since the last `take_touched`."""
        self._changed_flows: set[InstanceKey] = set()
        """What changed since the last `take_changed_flows`."""

    def __repr__(self) -> str:
        return f"AppIndex({len(self._apps)} apps, {len(self._owners)} owners, {len(self._replicas)} instances)"

    def apply_app(self, source: RobotApp) -> bool:
        """Add or update an app; True when anything but its name changed."""
        old = self._apps.get(source.metadata.uid)
        if old is not None and (
            old.source.metadata.generation == source.metadata.generation
            and old.source.status.observed_generation == source.status.observed_generation
        ):
            return False
        if old is not None:
            self._note_flows(old)
        self._apps[source.metadata.uid] = app = read_app(source)
        self._touched_apps.add(source.metadata.uid)
        self._note_flows(app)
        return True

    def remove_app(self, uid: str) -> bool:
        """The app is gone."""
        self._touched_apps.discard(uid)
        app = self._apps.pop(uid, None)
        if app is not None:
            self._note_flows(app)
        return app is not None

    def app(self, uid: str) -> App | None:
        """The app of this uid, None when it is not in the cache."""
        return self._apps.get(uid)

    def apply_owner(self, owner: Owned) -> bool:
        """Add or update a ReplicaSet or Deployment; True when its owner changed."""
        old = self._owners.get(owner.metadata.uid)
        self._owners[owner.metadata.uid] = owner
        self._note_flows_of(owner)
        return old is None or old.metadata.owner_references != owner.metadata.owner_references

    def remove_owner(self, uid: str) -> bool:
        """A ReplicaSet or Deployment is gone."""
        owner = self._owners.pop(uid, None)
        if owner is not None:
            self._note_flows_of(owner)
        return owner is not None

    def belongs(self, pod: Pod, app_uid: str) -> bool:
        """Does the owner chain lead from the pod to this app, inside the app's namespace?"""
        if not self._at_home(pod, app_uid):
            return False
        namespace = pod.metadata.namespace
        references = pod.metadata.owner_references
        for _ in range(3):
            owner = controller_of(references)
            if owner is None:
                return False
            if owner.uid == app_uid:
                return owner.kind == "RobotApp"
            known = self._owners.get(owner.uid)
            if known is None or known.metadata.namespace != namespace:
                return False
            references = known.metadata.owner_references
        return False

    def _at_home(self, pod: Pod, app_uid: str) -> bool:
        """Is the pod in the app's namespace, as far as the app is known? Elsewhere labels and owner references prove nothing."""
        app = self._apps.get(app_uid)
        return app is None or app.source.metadata.namespace == pod.metadata.namespace

    def place(self, pod: Pod, node: str) -> None:
        """Count a live pod of an app where it is (node "" = still waiting); others are not counted."""
        member = member_of(pod.metadata.labels or {})
        if member is None:
            return
        key = (member.app_uid, member.instance)
        replicas = self._replicas.setdefault(key, {}).setdefault(member.component, {})
        self._count(key, replicas.get(pod.metadata.uid), -1)
        replicas[pod.metadata.uid] = Replica(pod, node)
        self._count(key, replicas[pod.metadata.uid], 1)
        self._touched.add(key)
        self._note_flows_of(pod)

    def drop(self, pod: Pod) -> None:
        """Stop counting a pod that is gone or terminal."""
        member = member_of(pod.metadata.labels or {})
        if member is None:
            return
        key = (member.app_uid, member.instance)
        self._note_flows_of(pod)
        instance = self._replicas.get(key, {})
        replicas = instance.get(member.component, {})
        self._count(key, replicas.pop(pod.metadata.uid, None), -1)
        self._touched.add(key)
        if not replicas:
            instance.pop(member.component, None)
        if not instance:
            self._replicas.pop(key, None)
            self._touched.discard(key)

    def _count(self, key: InstanceKey, replica: Replica | None, by: int) -> None:
        """Note that a node has one pod more or less of an instance."""
        if replica is None or not replica.node:
            return
        here = self._on_node.setdefault(replica.node, Counter())
        here[key] += by
        if not here[key]:
            del here[key]
        if not here:
            del self._on_node[replica.node]

    def partners(self, member: Member | None) -> frozenset[str]:
        """Uids of the pods a pod must share its node with, wherever they are; its own may be among them."""
        app = self._apps.get(member.app_uid) if member is not None else None
        if app is None or member is None:
            return frozenset()
        names = app.neighbours.get(member.component, NO_NEIGHBOURS).together
        return frozenset(found.pod.metadata.uid for name in names for found in self.replicas(member, name))

    def replicas(self, member: Member, component: str) -> list[Replica]:
        """Live pods of a component of the same instance that truly belong to the app."""
        instance = self._replicas.get((member.app_uid, member.instance), {})
        return [
            replica for replica in instance.get(component, {}).values() if self.belongs(replica.pod, member.app_uid)
        ]

    def expect(self, candidates: Mapping[Member, tuple[str, ...]]) -> None:
        """While a group is planned: nodes on which components that are not placed yet may still end up."""
        self._expected = candidates

    def expected(self, member: Member, component: str) -> tuple[str, ...]:
        """Nodes a component of the same instance may still end up on; empty when they are not known."""
        return self._expected.get(member._replace(component=component), ())

    def take_changed_flows(self) -> set[InstanceKey]:
        """Instances whose connections may take other links, or more of them, since the last call."""
        found, self._changed_flows = self._changed_flows, set()
        return found

    def _note_flows(self, app: App, instance: str | None = None) -> None:
        """Note one instance, or all. Only of apps with flows: where no app has any, nobody takes the notes."""
        if not app.flows:
            return
        if instance is not None:
            self._changed_flows.add((app.uid, instance))
        else:
            self._changed_flows.update(key for key in self._replicas if key[0] == app.uid)

    def _note_flows_of(self, owned: Pod | Owned) -> None:
        """Whether pods count is decided by their owners, too."""
        labels = owned.metadata.labels or {}
        app = self._apps.get(labels.get(Label.APP_UID, ""))
        if app is not None:
            self._note_flows(app, labels.get(Label.INSTANCE))

    def instances(self) -> list[InstanceKey]:
        """Everything that has a live pod."""
        return list(self._replicas)

    def take_touched(self, nodes: Iterable[str], robots: Collection[str]) -> list[InstanceKey]:
        """Instances whose pods or app have changed since the last call, and those with an end on these nodes or at these robots."""
        found, self._touched = self._touched, set()
        apps, self._touched_apps = self._touched_apps, set()
        for node in nodes:
            found.update(self._on_node.get(node, ()))
        if apps or robots:
            found.update(key for key in self._replicas if key[0] in apps or key[1] in robots)
        return sorted(found)

    def labelled(self, member: Member) -> list[Replica]:
        """Live pods of the app's namespace with exactly these labels, without a look at the owner chain: orphans count."""
        found = self._replicas.get((member.app_uid, member.instance), {}).get(member.component, {})
        return [replica for replica in found.values() if self._at_home(replica.pod, member.app_uid)]
