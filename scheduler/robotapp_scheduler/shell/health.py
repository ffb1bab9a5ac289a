"""The HTTP side of the process: liveness, readiness, metrics, the configuration in use, and explanations.

`/livez` says the event loop turns and leadership is renewed; `/readyz` names what is still missing.
"""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec
from aiohttp import web
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest

from robotapp_api.client.errors import ClientError
from robotapp_scheduler.shell.access import Access

Authorize = Callable[[str, str], Awaitable[Access]]
"""(bearer token, namespace) to what the caller may see."""
Explain = Callable[[str, str, bool], Mapping[str, Any] | None]
"""(namespace, pod, with node names) to the explanation, None when nothing is known about the pod."""


@dataclass(slots=True)
class Pages:
    """What the endpoint serves; every field is asked at request time."""

    registry: CollectorRegistry
    config: Callable[[], Mapping[str, Any]]
    explain: Explain
    authorize: Authorize
    ready_checks: dict[str, Callable[[], bool]] = field(default_factory=dict)
    live_checks: dict[str, Callable[[], bool]] = field(default_factory=dict)


def application(pages: Pages) -> web.Application:
    """The aiohttp application; start it with `serve`."""

    async def live(_: web.Request) -> web.Response:
        return _checked(pages.live_checks)

    async def ready(_: web.Request) -> web.Response:
        return _checked(pages.ready_checks | pages.live_checks)

    async def metrics(_: web.Request) -> web.Response:
        return web.Response(body=generate_latest(pages.registry), headers={"Content-Type": CONTENT_TYPE_LATEST})

    async def config(_: web.Request) -> web.Response:
        return _json({"kubescheduler.config.k8s.io": pages.config()})

    async def explain(request: web.Request) -> web.Response:
        return await _explain(request, pages)

    app = web.Application()
    app.router.add_get("/livez", live)
    app.router.add_get("/healthz", live)
    app.router.add_get("/readyz", ready)
    app.router.add_get("/metrics", metrics)
    app.router.add_get("/configz", config)
    app.router.add_get("/explain/{namespace}/{pod}", explain)
    return app


async def serve(pages: Pages, *, host: str, port: int) -> tuple[web.AppRunner, int]:
    """Start serving; gives the runner (to be cleaned up) and the port in use (0 asks for a free one)."""
    runner = web.AppRunner(application(pages), access_log=None, handle_signals=False)
    await runner.setup()
    site = web.TCPSite(runner, host, port)
    await site.start()
    return runner, int(runner.addresses[0][1])


def _checked(checks: Mapping[str, Callable[[], bool]]) -> web.Response:
    missing = sorted(name for name, check in checks.items() if not check())
    if missing:
        return web.Response(status=503, text="".join(f"[-]{name} failed\n" for name in missing))
    return web.Response(text="ok")


async def _explain(request: web.Request, pages: Pages) -> web.Response:
    namespace, pod = request.match_info["namespace"], request.match_info["pod"]
    scheme, _, token = request.headers.get("Authorization", "").partition(" ")
    try:
        access = await pages.authorize(token.strip() if scheme.lower() == "bearer" else "", namespace)
    except ClientError as error:
        return _problem(503, f"the API server cannot say who you are: {error}")
    if access is Access.UNKNOWN_CALLER:
        return _problem(401, "send a bearer token of the cluster: Authorization: Bearer $(kubectl create token ...)")
    if access is Access.FORBIDDEN:
        return _problem(403, f"you may not get pods in namespace {namespace}")
    found = pages.explain(namespace, pod, access is Access.ALL)
    if found is None:
        return _problem(404, f"no decision is known for pod {namespace}/{pod}: it is not ours, or not seen yet")
    return _json(found)


def _json(value: Mapping[str, Any], status: int = 200) -> web.Response:
    return web.Response(status=status, body=msgspec.json.encode(value), content_type="application/json")


def _problem(status: int, text: str) -> web.Response:
    return _json({"error": text}, status)
