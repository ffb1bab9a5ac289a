"""The watched resources of groups. An API server without them is asked again only while a pod waits for one."""

from robotapp_api.client.api.resources import COSCHEDULING_PODGROUPS, WORKLOAD_PODGROUPS, Resource
from robotapp_scheduler.core.api.pod_group import GivenPodGroup
from robotapp_scheduler.core.pods.pod_group_index import PodGroups
from robotapp_scheduler.shell.route import Route


def group_routes(groups: PodGroups) -> tuple[Route, ...]:
    """PodGroups of both APIs."""
    return (_route(COSCHEDULING_PODGROUPS, groups), _route(WORKLOAD_PODGROUPS, groups))


def _route(resource: Resource, groups: PodGroups) -> Route:
    return Route(
        resource,
        GivenPodGroup,
        lambda group: groups.apply(group, resource.group),
        lambda group: groups.remove(group, resource.group),
    )
