"""Names for the shell's completion; silence when the cluster does not answer at once."""

import asyncio
from pathlib import Path
from typing import Any, Final

import typer

from robotapp_api.client.api import ApiClient
from robotapp_api.client.errors import ClientError
from robotapp_api.client.resources import ROBOTAPPS
from robotapp_cli.fields import meta
from robotapp_cli.session import Options, endpoint

_PATIENCE_S: Final = 2.0


def complete_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """RobotApps of the namespace on the command line that begin with what was typed."""
    given: dict[str, Any] = ctx.params
    file = given.get("kubeconfig")
    options = Options(given.get("namespace"), False, given.get("context"), Path(file) if file else None)
    try:
        names = asyncio.run(asyncio.wait_for(_names(options), _PATIENCE_S))
    except (ClientError, TimeoutError):
        return []
    return [name for name in names if name.startswith(incomplete)]


async def _names(options: Options) -> list[str]:
    where = endpoint(options)
    async with ApiClient(where, user_agent="kubectl-robotapp", timeout_s=_PATIENCE_S) as client:
        listing = await client.list(ROBOTAPPS, namespace=options.namespace or where.namespace)
    return [str(meta(app)["name"]) for app in listing.items]
