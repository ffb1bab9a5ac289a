"""Which kinds a dump may hold, and where they go: what the scheduler watches."""

from typing import Any

from robotapp_api.client.api.resources import PODS, Resource
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.watch.routes import Route, routes

__all__ = ["kinds", "resources", "routes"]


def kinds() -> dict[str, type[Any]]:
    """Kind to the struct its objects are decoded into."""
    return {resource.kind: as_type for resource, as_type in resources().items()}


def resources() -> dict[Resource, type[Any]]:
    """The same by resource; pods come last, since they refer to all others."""
    watched: dict[Resource, type[Any]] = {each.resource: each.as_type for each in _watched()}
    return watched | {PODS: Pod}


def _watched() -> tuple[Route, ...]:
    return routes(Cache(clock=float))
