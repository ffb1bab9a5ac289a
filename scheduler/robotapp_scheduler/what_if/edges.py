"""The round trips of the edges of app instances as the cache knows them now."""

from collections import Counter
from collections.abc import Iterable

from robotapp_api.values.placement.round_trips import UNREACHABLE_US
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.pods.pod_info import Member, member_of
from robotapp_scheduler.core.robotics.app_index import App, Connection, InstanceKey, connections
from robotapp_scheduler.core.robotics.edge_times import slowest_us
from robotapp_scheduler.core.robotics.rtt import SOURCE_NAMES
from robotapp_scheduler.what_if.difference import EdgeKey, EdgeTime


def instances_on(nodes: Iterable[str], cluster: Cache) -> list[InstanceKey]:
    """The app instances with a pod on one of these nodes, or whose robot one of them is."""
    found: dict[InstanceKey, None] = {}
    robots = set()
    for node in nodes:
        for placed in cluster.pods_on(node):
            member = member_of(placed.pod.metadata.labels or {})
            if member is not None:
                found[member.app_uid, member.instance] = None
        robots |= {robot for robot, computers in cluster.nodes.robots.items() if node in computers}
    if robots:
        found |= dict.fromkeys(each for each in cluster.apps.instances() if each[1] in robots)
    return list(found)


def edge_times(
    instances: Iterable[InstanceKey], cluster: Cache, *, lost: frozenset[str] = frozenset()
) -> dict[EdgeKey, EdgeTime]:
    """Every edge with a budget of these instances. No probe reaches a lost node."""
    found: dict[EdgeKey, EdgeTime] = {}
    for app_uid, instance in instances:
        app = cluster.apps.app(app_uid)
        alike: Counter[EdgeKey] = Counter()
        for connection in connections(app) if app is not None else ():
            if app is not None and (budget_us := connection.link.budget_us) is not None:
                key = _key(app, instance, connection)
                numbered = key._replace(number=alike[key])
                alike[key] += 1
                member = Member(app_uid, instance, connection.here)
                found[numbered] = _time(connection, member, budget_us, cluster, lost)
    return found


def _key(app: App, instance: str, connection: Connection) -> EdgeKey:
    meta = app.source.metadata
    return EdgeKey(meta.namespace, meta.name, instance, connection.link.what, connection.from_, connection.to)


def _time(connection: Connection, member: Member, budget_us: int, cluster: Cache, lost: frozenset[str]) -> EdgeTime:
    """The slowest round trip of an edge; of the pairs of nodes that are compared, the least known names its source."""
    sources: list[str] = []

    def between(one: str, other: str, percentile: int) -> float | None:
        known = cluster.rtt.between(one, other, percentile)
        us, source = known if lost.isdisjoint((one, other)) else (UNREACHABLE_US, "measured")
        sources.append(source)
        return us

    us = slowest_us(connection, member, cluster, between)
    # Without a pair both ends are on one node: no agent measures a round trip to its own node.
    worst = min(sources, key=SOURCE_NAMES.index, default="estimated")
    return EdgeTime(us, "unknown" if us is None else worst, budget_us, connection.link.percentile)
