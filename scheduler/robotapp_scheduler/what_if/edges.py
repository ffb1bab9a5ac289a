"""The round trips of the edges of app instances as the cache knows them now."""

from collections.abc import Iterable

from robotapp_api.values.round_trips import UNREACHABLE_US
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.pods.pod_info import Member, member_of
from robotapp_scheduler.core.robotics.app_index import connections
from robotapp_scheduler.core.robotics.edge_times import slowest_us
from robotapp_scheduler.core.robotics.rtt import SOURCE_NAMES
from robotapp_scheduler.what_if.difference import EdgeKey, EdgeTime

Instance = tuple[str, str]
"""(app uid, instance)."""


def instances_on(nodes: Iterable[str], cluster: Cache) -> list[Instance]:
    """The app instances with a pod on one of these nodes, or whose robot one of them is."""
    found: dict[Instance, None] = {}
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
    instances: Iterable[Instance], cluster: Cache, *, lost: frozenset[str] = frozenset()
) -> dict[EdgeKey, EdgeTime]:
    """Every edge with a budget of these instances. No probe reaches a lost node."""
    found = {}
    for app_uid, instance in instances:
        app = cluster.apps.app(app_uid)
        if app is None:
            continue
        meta = app.source.metadata
        for number, each in enumerate(connections(app)):
            link = each.link
            if link.budget_us is None:
                continue
            key = EdgeKey(
                meta.namespace,
                meta.name,
                instance,
                number,
                link.what,
                each.from_,
                each.to,
                link.budget_us,
                link.percentile,
            )
            sources: list[str] = []

            def between(one: str, other: str, percentile: int, seen: list[str] = sources) -> float | None:
                us, source = (
                    (UNREACHABLE_US, "measured")
                    if one in lost or other in lost
                    else cluster.rtt.between(one, other, percentile)
                )
                seen.append(source)
                return us

            us = slowest_us(each, Member(app_uid, instance, each.here), cluster, between)
            worst = min(sources, key=SOURCE_NAMES.index, default="measured")  # without a link both ends are on one node
            found[key] = EdgeTime(us, "unknown" if us is None else worst)
    return found
