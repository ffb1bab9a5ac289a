"""The round trips of a component's connections that have a budget, with the component where it is or on another node."""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple, Protocol

from robotapp_api.model.names import ROBOT_END
from robotapp_api.values.placement.round_trips import SAME_NODE
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.pods.pod_info import Member
from robotapp_scheduler.core.robotics.app_index import ON_BOARD, App, AppIndex, Connection, Link

Between = Callable[[str, str, int], float | None]
"""The round trip between two nodes at a percentile; infinite = unreachable, None = unknown."""


class Around(Protocol):
    """The part of the cache that is read here."""

    @property
    def apps(self) -> AppIndex: ...
    def robot_end(self, robot: str) -> tuple[str, ...]:
        """The robot's primary node; all of its nodes while that is not known."""


class PlacedComponent(NamedTuple):
    """The only pod of a component of an instance, on its node."""

    app: App
    member: Member
    pod: Pod
    node: str

    @property
    def budgeted(self) -> Iterator[Link]:
        """Its connections to other components or the robot that have a budget."""
        name = self.member.component
        return (link for link in self.app.links.get(name, ()) if link.budget_us is not None and link.peer != name)


class Late(NamedTuple):
    """A required connection that is over its budget. `us` is infinite where no probe was answered."""

    link: Link
    us: float


def movable(app: App) -> Iterator[str]:
    """Components that a budget may move: one replica, not bound to the robot, and a required connection with a budget."""
    for name, links in app.links.items():
        component = app.components.get(name)
        if component is None or component.replicas != 1 or component.runs_on == ON_BOARD:
            continue
        if any(link.required and link.budget_us is not None for link in links):
            yield name


def part_of(app: App, member: Member, apps: AppIndex) -> PlacedComponent | None:
    """The component's pod; None when it has none, several, or one that waits or ends."""
    found = apps.replicas(member, member.component)
    if len(found) != 1 or not found[0].node or found[0].pod.metadata.deletion_timestamp is not None:
        return None
    return PlacedComponent(app, member, found[0].pod, found[0].node)


def peer_nodes(link: Link, member: Member, around: Around) -> tuple[str, ...]:
    """Nodes of the other end: the robot's, or one per replica ("" for one that is not placed)."""
    if link.peer == ROBOT_END:
        return around.robot_end(member.instance)
    return tuple(replica.node for replica in around.apps.replicas(member, link.peer))


def time_us(link: Link, member: Member, node: str, around: Around, between: Between) -> float | None:
    """The round trip of a connection with the component on `node`: to the nearest of the robot's nodes, or to the farthest
    replica. None when the time to one of them is unknown.
    """
    times = [
        SAME_NODE.of(link.percentile) if other == node else between(other, node, link.percentile)
        for other in peer_nodes(link, member, around)
    ]
    known = [time for time in times if time is not None]
    if not known or len(known) < len(times):
        return None
    return min(known) if link.peer == ROBOT_END else max(known)


def slowest_us(connection: Connection, member: Member, around: Around, between: Between) -> float | None:
    """The round trip of an edge of an instance, over all pods of both ends. None when one is unknown, or a pod has no node."""
    here = member._replace(component=connection.here)
    nodes = [replica.node for replica in around.apps.replicas(here, connection.here)]
    times = [time_us(connection.link, here, node, around, between) if node else None for node in nodes]
    known = [time for time in times if time is not None]
    return max(known) if known and len(known) == len(times) else None


class Times:
    """`time_us` of a component's connections. It is computed once per peer, percentile and node and then kept.

    An app may have 256 topics between two components, and each of these 32 pods.
    """

    def __init__(self, part: PlacedComponent, around: Around, between: Between) -> None:
        self._part = part
        self._around = around
        self._between = between
        self._known: dict[tuple[str, int, str], float | None] = {}

    def __repr__(self) -> str:
        return f"Times({self._part.member}, {len(self._known)} known)"

    def at(self, link: Link, node: str) -> float | None:
        """`time_us` with the component on a node."""
        key = (link.peer, link.percentile, node)
        if key not in self._known:
            self._known[key] = time_us(link, self._part.member, node, self._around, self._between)
        return self._known[key]


def over_budget(part: PlacedComponent, around: Around, between: Between) -> dict[Link, float]:
    """The required connections that are over their budgets, each with its round trip (`Late.us`)."""
    times = Times(part, around, between)
    found = ((link, times.at(link, part.node)) for link in part.budgeted if link.required)
    return {link: us for link, us in found if us is not None and us > (link.budget_us or 0)}


def worst_of(late: Mapping[Link, float]) -> Late | None:
    """Of connections over their budgets the one that uses most of its own; the first where several do."""
    if not late:
        return None
    return Late(*max(late.items(), key=lambda item: item[1] / max(item[0].budget_us or 0, 1)))


def worst_late(part: PlacedComponent, around: Around, between: Between) -> Late | None:
    """The required connection that uses most of its budget, if it is over it."""
    return worst_of(over_budget(part, around, between))
