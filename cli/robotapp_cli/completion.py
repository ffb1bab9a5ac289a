"""Names for the shell's completion; silence when the cluster does not answer at once."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import typer

from robotapp_api.model.names import Label
from robotapp_api.values.replicas import find_replicas
from robotapp_cli.reading.fields import Json, meta
from robotapp_cli.reading.instances import name_of
from robotapp_cli.reading.session import Options, endpoint
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import NODES, ROBOTAPPINSTANCES, ROBOTAPPS, Resource
from robotapp_client.transport.errors import ClientError

T = TypeVar("T")
_PATIENCE_S: Final = 2.0


def complete_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """RobotApps of the namespace on the command line that begin with what was typed."""
    return [name for name in _asked(ctx, ROBOTAPPS, _name) if name.startswith(incomplete)]


def complete_robots(ctx: typer.Context, incomplete: str) -> list[str]:
    """Robots of the app on the command line, or of all apps, that begin with what was typed."""
    selector = f"{Label.APP}={ctx.params['name']}" if ctx.params.get("name") else ""
    found = {name for name in _asked(ctx, ROBOTAPPINSTANCES, name_of, selector) if name}
    return sorted(name for name in found if name.startswith(incomplete))


def complete_components(ctx: typer.Context, incomplete: str) -> list[str]:
    """Components of the app on the command line that begin with what was typed."""
    apps = _asked(ctx, ROBOTAPPS, lambda app: app if _name(app) == ctx.params.get("name") else {})
    names: list[str] = []
    for components in ((app.get("spec") or {}).get("components") or () for app in apps):
        names += [*(component["name"] for component in components), *find_replicas(components)]
    return [name for name in names if name.startswith(incomplete)]


def complete_nodes(ctx: typer.Context, incomplete: str) -> list[str]:
    """Nodes of the cluster that begin with what was typed."""
    return [name for name in _asked(ctx, NODES, _name) if name.startswith(incomplete)]


def complete_pairs(ctx: typer.Context, incomplete: str) -> list[str]:
    """The next node of `A:B=`, with what is typed before it; nothing where a time is due."""
    if "=" in incomplete:
        return []
    first, colon, start = incomplete.partition(":")
    names = _asked(ctx, NODES, _name)
    if not colon:
        return [f"{name}:" for name in names if name.startswith(first)]
    return [f"{first}:{name}=" for name in names if name.startswith(start) and name != first]


def _name(obj: Json) -> str:
    return str(meta(obj)["name"])


def _asked(ctx: typer.Context, resource: Resource, naming: Callable[[Json], T], selector: str = "") -> list[T]:
    given: dict[str, Any] = ctx.params
    file = given.get("kubeconfig")
    options = Options(
        namespace=given.get("namespace"), context=given.get("context"), kubeconfig=Path(file) if file else None
    )
    try:
        return [
            naming(each) for each in asyncio.run(asyncio.wait_for(_objects(options, resource, selector), _PATIENCE_S))
        ]
    except (ClientError, TimeoutError):
        return []


async def _objects(options: Options, resource: Resource, selector: str) -> list[Json]:
    where = endpoint(options)
    async with ApiClient(where, user_agent="kubectl-robotapp", timeout_s=_PATIENCE_S) as client:
        listing = await client.list(resource, namespace=options.namespace or where.namespace, label_selector=selector)
    return list(listing.items)
