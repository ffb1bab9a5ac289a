"""Workloads that met before become one app, or apps of one domain; what will no longer meet is named. Pure."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, Final

from rigel_bridge.document.failures import BridgeError
from rigel_bridge.migration.apps import Migrated, migrated, names_as_peer
from rigel_bridge.migration.found import Workload
from rigel_bridge.migration.ros_graphs import RosGraph, asks_for_own_domain, graph_of, master_uri, meets

_MULTICAST: Final = "where the network carries multicast, write ros2: {discovery: {mode: Multicast}} into both"
_MULTICAST_HERE: Final = "they meet by multicast alone, so write ros2: {discovery: {mode: Multicast}}"

Group = tuple[Workload, ...]


def select(workloads: Sequence[Workload], names: Sequence[str]) -> tuple[list[Workload], list[Workload]]:
    """Splits workloads into those that the user named, with their peers, and the others; without names there are no others."""
    chosen = [each for each in workloads if not names or each.name in names]
    for workload in chosen:  # grows while it is walked: peers have peers
        chosen += [each for each in workloads if each not in chosen and names_as_peer(workload, each)]
    return [each for each in workloads if each in chosen], [each for each in workloads if each not in chosen]


def join(workloads: Sequence[Workload], *, distro: str) -> list[Group]:
    """Joins workloads that name one another as peers or met in one ROS graph, as far as one app can hold them."""
    groups: list[Group] = []
    order = {workload.title: index for index, workload in enumerate(workloads)}
    for workload in workloads:
        group: Group = (workload,)
        for other in list(groups):
            whole = tuple(sorted((*other, *group), key=lambda each: order[each.title]))
            if _belong_together(group, other, distro) and _fits_one_app(whole, distro):
                groups.remove(other)
                group = whole
        groups.append(group)
    return sorted(groups, key=lambda group: order[group[0].title])


def _belong_together(group: Group, other: Group, distro: str) -> bool:
    return any(
        names_as_peer(one, two)
        or (one.namespace == two.namespace and not _own_domains(one, two) and _met(one, two, distro))
        for one in group
        for two in other
    )


def _own_domains(*workloads: Workload) -> bool:
    return any(asks_for_own_domain(workload) for workload in workloads)


def _met(workload: Workload, peer: Workload, distro: str) -> bool:
    return meets(graph_of(workload, distro=distro), graph_of(peer, distro=distro))


def _fits_one_app(group: Group, distro: str) -> bool:
    try:
        migrated(group, distro=distro)
    except BridgeError:
        return False
    return True


def keep_meeting(apps: Sequence[Migrated], staying: Iterable[Workload], *, distro: str) -> list[Migrated]:
    """Lets apps that met before share a master or a domain, and names in each app whom its nodes will not meet any more."""
    kept = list(apps)
    for first, second in combinations(range(len(kept)), 2):
        if pair := _meeting(kept[second], kept[first].workloads, distro):
            kept[first], kept[second] = _tie(kept[first], kept[second], pair)
    kept = [
        _name_uncertain(app, [other for each in kept if each is not app for other in each.workloads], distro)
        for app in kept
    ]
    return [_name_staying(_note_default_domain(app, distro), tuple(staying), distro) for app in kept]


def _name_uncertain(app: Migrated, others: Iterable[Workload], distro: str) -> Migrated:
    """Names in the app whose domain a migration cannot read a workload of another app that its nodes may have met."""
    for one in app.workloads:
        graph = graph_of(one, distro=distro)
        if graph is None or not graph.is_unread:
            continue
        for two in others:
            second = graph_of(two, distro=distro)
            if second and not meets(graph, second) and meets(replace(graph, domain=second.domain), second):
                told = f"{one.title} and {two.title} may have met: {graph.domain} may state {second}; each app gets a domain of its own"
                return replace(app, apart=(*app.apart, told))
    return app


def _meeting(app: Migrated, others: Iterable[Workload], distro: str) -> tuple[Workload, Workload, RosGraph] | None:
    """Returns the first two workloads of an app and of others that met, and where."""
    for one in app.workloads:
        for two in others:
            graph = graph_of(one, distro=distro)
            if graph and meets(graph, graph_of(two, distro=distro)):
                return one, two, graph
    return None


def _tie(first: Migrated, second: Migrated, pair: tuple[Workload, Workload, RosGraph]) -> tuple[Migrated, Migrated]:
    """Lets two apps that could not be one meet as before, as far as that is possible."""
    one, two, graph = pair
    if graph.version == 1:
        return _with_old_master(first, two), _with_old_master(second, one)
    told = f"{one.title} and {two.title} were in {graph} and become two apps"
    if _own_domains(one, two) or (first.namespace != second.namespace and graph.number is None):
        return first, replace(second, apart=(*second.apart, f"{told}, each with a domain of its own"))
    first, second = _sharing(first, second)
    if graph.brokers:
        note = f"{told} that share a domain and go on with {', '.join(sorted(graph.brokers))}"
        return first, replace(second, notes=(*second.notes, note))
    return first, replace(second, apart=(*second.apart, f"{told} that share a domain, but no discovery: {_MULTICAST}"))


def _sharing(first: Migrated, second: Migrated) -> tuple[Migrated, Migrated]:
    """Returns the apps with one domain, which the first holds; across namespaces both must name the other."""
    if first.namespace == second.namespace:
        return first, _with_share(second, {"name": first.name})
    owner = min(first, second, key=lambda app: (app.namespace, app.name))
    shared = [
        _with_share(app, {"name": other.name, "namespace": other.namespace}, keeps_domain=app is owner)
        for app, other in ((first, second), (second, first))
    ]
    return shared[0], shared[1]


def _with_share(app: Migrated, other: dict[str, str], *, keeps_domain: bool = False) -> Migrated:
    """Returns an app that shares a domain; one that shares already follows the same owner."""
    ros2: dict[str, Any] = dict(app.app["spec"].get("ros2", {}))
    if "shareWith" in ros2:
        return app
    for key in () if keeps_domain else ("domain", "allowUnsafeDomain"):
        ros2.pop(key, None)
    return _with_spec(app, ros2={**ros2, "shareWith": [other]})


def _with_old_master(app: Migrated, workload: Workload) -> Migrated:
    """Returns an app of ROS 1 that goes on with the master it had, because others use it as well."""
    if "ros1" in app.app["spec"]:
        return app
    note = f"the master at {master_uri(workload)} stays the app's: {workload.title} uses it, too"
    uri = {"master": "External", "uri": master_uri(workload)}
    return replace(_with_spec(app, ros1=uri), notes=(*app.notes, note))


def _with_spec(app: Migrated, **fields: dict[str, Any]) -> Migrated:
    return replace(app, app={**app.app, "spec": {**app.app["spec"], **fields}})


def _name_staying(app: Migrated, staying: Sequence[Workload], distro: str) -> Migrated:
    """Names the workloads that stay and met nodes of the app."""
    for workload in staying:
        pair = _meeting(app, (workload,), distro)
        if pair is None:
            continue
        if pair[2].version == 1:
            app = _with_old_master(app, workload)
        elif pair[2].number is None:
            told = (
                f"{workload.title} stays in {pair[2]}, and the app gets a domain of its own: migrate both in one call"
            )
            app = replace(app, apart=(*app.apart, told))
        elif not pair[2].brokers:
            told = f"{workload.title} stays in {pair[2]}, which the app keeps: {_MULTICAST_HERE}"
            app = replace(app, apart=(*app.apart, told))
    return app


def _note_default_domain(app: Migrated, distro: str) -> Migrated:
    """Notes once that programs outside of the cluster, which migrate does not see, are in the default domain."""
    graphs = {graph for each in app.workloads if (graph := graph_of(each, distro=distro))}
    if not any(graph.version == 2 and graph.domain == "0" for graph in graphs) or "domain" in _ros2(app):
        return app
    note = "the app leaves the default domain: laptops and other programs outside of the cluster need its ROS_DOMAIN_ID to meet it"
    return replace(app, notes=(*app.notes, note))


def _ros2(app: Migrated) -> dict[str, Any]:
    return dict(app.app["spec"].get("ros2", {}))
