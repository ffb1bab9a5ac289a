"""The HTTPS side of the process: liveness and readiness for everybody, the answers for who may have them.

`/livez` says the event loop turns and leadership is renewed; `/readyz` names what is still missing.
"""

import ssl
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from aiohttp import web

from robotapp_api.serving.port import opened
from robotapp_scheduler.shell.answers import Answers


@dataclass(slots=True)
class Pages:
    """What the endpoint serves; every field is asked at request time."""

    answers: Answers
    ready_checks: dict[str, Callable[[], bool]] = field(default_factory=dict)
    live_checks: dict[str, Callable[[], bool]] = field(default_factory=dict)


def application(pages: Pages) -> web.Application:
    """The aiohttp application; start it with `serve`."""

    async def live(_: web.Request) -> web.Response:
        return _checked(pages.live_checks)

    async def ready(_: web.Request) -> web.Response:
        return _checked(pages.ready_checks | pages.live_checks)

    app = web.Application()
    app.router.add_get("/livez", live)
    app.router.add_get("/healthz", live)
    app.router.add_get("/readyz", ready)
    pages.answers.add_to(app.router)
    return app


async def serve(pages: Pages, *, host: str, port: int, tls: ssl.SSLContext | None = None) -> tuple[web.AppRunner, int]:
    """Start serving; gives the runner (to be cleaned up) and the port in use (0 asks for a free one). Raises `PortError`."""
    runner = await opened(application(pages), host=host, port=port, tls=tls)
    return runner, int(runner.addresses[0][1])


def _checked(checks: Mapping[str, Callable[[], bool]]) -> web.Response:
    missing = sorted(name for name, check in checks.items() if not check())
    if missing:
        return web.Response(status=503, text="".join(f"[-]{name} failed\n" for name in missing))
    return web.Response(text="ok")
