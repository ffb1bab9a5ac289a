"""The routes: pages, their streams, static files, signing in and out."""

import asyncio
import contextlib
import logging
import socket
import ssl
import time
from collections.abc import AsyncIterator, Callable
from typing import Final

from aiohttp import web

from robotapp_client.serving.port import Limits, Port, serve_listener
from robotapp_console.cluster.informer_set import InformerSet
from robotapp_console.web import security, tuner
from robotapp_console.web.actions import drop_notice, read_notice
from robotapp_console.web.api import answer_config, answer_nodes, take_config
from robotapp_console.web.app_actions import act_on_app, act_on_node, confirm_delete
from robotapp_console.web.console import CALLER, CONSOLE, Console
from robotapp_console.web.guard import Handler, answer_errors, guard
from robotapp_console.web.reasons import show_reasons
from robotapp_console.web.screens import AppScreen, FleetScreen, NodesScreen, Screen, ScreenContent
from robotapp_console.web.sessions import LONGEST_S, Caller
from robotapp_console.web.signing import answer_expired, open_local, show_login, sign_in, sign_out

log = logging.getLogger(__name__)
MOST_BODY: Final = 256 * 1024
"""Bytes; the form of the scheduler's configuration holds its text twice."""
MOST_STREAMS: Final = 30
"""Open pages of one user."""
GATHER_S: Final = 0.05
"""Changes come in groups: the first one waits this long for the others."""
LIMITS: Final = Limits(connections=512, answer_s=LONGEST_S, idle_s=75.0, new_per_s=100.0, new_at_once=200)
"""Open pages are answers that go on until the session ends; behind an ingress all users have one address."""
BEAT_S: Final = 15.0
"""Period of the comments that keep a quiet stream alive, and find out that the browser is gone."""


def make_app(console: Console) -> web.Application:
    """Returns the application; the console's informers end with it."""
    app = web.Application(middlewares=[answer_errors, guard], client_max_size=MOST_BODY)
    app[CONSOLE] = console
    app.on_response_prepare.append(security.add_headers)
    app.on_shutdown.append(_end_streams)
    app.cleanup_ctx.append(_run_informers)
    app.router.add_get("/healthz", _answer_health)
    app.router.add_get("/static/{name:.+}", console.files.serve)
    app.router.add_get("/open", open_local)
    app.router.add_get("/login", show_login)
    app.router.add_post("/login", sign_in)
    app.router.add_post("/logout", sign_out)
    app.router.add_get("/apps/{namespace}/{name}/delete", confirm_delete)
    app.router.add_get("/apps/{namespace}/{name}/why", show_reasons)
    app.router.add_post("/apps/{namespace}/{name}/{action:suspend|resume|restart|approve|delete}", act_on_app)
    app.router.add_post("/nodes/{name}/{action:begin-shutdown|end-shutdown}", act_on_node)
    app.router.add_get(tuner.PATH, tuner.show_scheduler)
    app.router.add_post(tuner.PATH, tuner.change_scheduler)
    app.router.add_get("/api/config", answer_config)
    app.router.add_post("/api/config", take_config)
    app.router.add_get("/api/nodes", answer_nodes)
    screens: tuple[tuple[str, Screen], ...] = (
        ("/", FleetScreen()),
        ("/nodes", NodesScreen()),
        ("/apps/{namespace}/{name}", AppScreen()),
    )
    for path, screen in screens:
        app.router.add_get(path, _make_page(screen))
        app.router.add_get(f"{path.rstrip('/')}/stream", _make_stream(screen), allow_head=False)
    return app


async def serve(
    console: Console,
    listener: socket.socket,
    *,
    tls: Callable[[], ssl.SSLContext] | None = None,
    limits: Limits = LIMITS,
) -> Port:
    """Serves the console on this socket until the port is closed. A handler ends with its connection.

    Each connection takes the certificate that `tls` returns then.
    """
    return await serve_listener(make_app(console), listener, tls=tls, limits=limits)


async def _answer_health(request: web.Request) -> web.Response:
    del request
    return web.Response(text="ok\n")


async def _run_informers(app: web.Application) -> AsyncIterator[None]:
    sweeping = asyncio.create_task(app[CONSOLE].informers.sweep_forever())
    yield
    sweeping.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await sweeping
    await app[CONSOLE].informers.close()


async def _end_streams(app: web.Application) -> None:
    app[CONSOLE].ending.set()


def _make_page(screen: Screen) -> Handler:
    async def show_page(request: web.Request) -> web.StreamResponse:
        console, caller = request.app[CONSOLE], request[CALLER]
        informers = await _prepare(screen, request, caller)
        if informers.signed_out:
            return answer_expired(request)
        content = await screen.show(request, caller, informers)
        if content.missing:
            return console.answer_message(request, 404, content.title, content.missing, links=content.context["links"])
        now_s = time.time()
        stream, query = f"{request.path.rstrip('/')}/stream", drop_notice(request.query_string)
        context = {
            "title": content.title,
            "screen": screen.path,
            "name": screen.name,
            "stream": f"{stream}?{query}" if query else stream,
            "notice": read_notice(console, caller, request),
        }
        async with informers.turn:
            html = console.render(request, "screen.html", dict(content.context) | context, now_s=now_s)
        return web.Response(text=html, content_type="text/html")

    return show_page


async def _prepare(screen: Screen, request: web.Request, caller: Caller) -> InformerSet:
    console = request.app[CONSOLE]
    informers = await console.informers.get(caller.key, caller.endpoint)
    await informers.use(screen.kinds, screen.namespace(request) or caller.home)
    return informers


def _make_stream(screen: Screen) -> Handler:
    async def follow_screen(request: web.Request) -> web.StreamResponse:
        informers = await _prepare(screen, request, request[CALLER])
        if informers.streams >= MOST_STREAMS:
            return web.Response(status=429, text="Too many open pages.\n", headers={"Retry-After": "10"})
        answer = web.StreamResponse(headers={"Content-Type": "text/event-stream", "X-Accel-Buffering": "no"})
        with informers.listen() as wake:
            await answer.prepare(request)
            with contextlib.suppress(ConnectionError):
                await _send_changes(answer, _Follower(screen, request, informers, wake))
        return answer

    return follow_screen


class _Follower:
    """One open page: what it shows now, and when that has changed."""

    def __init__(
        self,
        screen: Screen,
        request: web.Request,
        informers: InformerSet,
        wake: asyncio.Event,
    ) -> None:
        self.informers = informers
        self.wake = wake
        self._console = request.app[CONSOLE]
        self._screen = screen
        self._request = request
        self._caller = request[CALLER]
        self._sent: object = None

    def has_ended(self) -> bool:
        """Returns whether the process, the session or the token's life is over."""
        return self._console.ending.is_set() or self.informers.signed_out or time.time() > self._caller.ends_s

    async def wait_for_change(self) -> bool:
        """Returns whether something changed before the next beat is due."""
        key = self._screen.key(self._request)
        place = {"namespace": self._screen.namespace(self._request), "home": self._caller.home}
        if not self.informers.is_behind(key, **place) and not await self._is_woken():
            return False
        while True:
            await asyncio.sleep(GATHER_S)
            self.wake.clear()
            pause_s = self.informers.pause_s(key, **place)
            if not pause_s:
                return True
            with contextlib.suppress(TimeoutError):  # an edit makes the pause shorter
                await asyncio.wait_for(self.wake.wait(), pause_s)

    async def _is_woken(self) -> bool:
        waiting = asyncio.ensure_future(self.wake.wait())
        ending = asyncio.ensure_future(self._console.ending.wait())
        try:
            await asyncio.wait({waiting, ending}, timeout=BEAT_S, return_when=asyncio.FIRST_COMPLETED)
        finally:
            waiting.cancel()
            ending.cancel()
        return self.wake.is_set()

    async def render_change(self) -> str:
        """Returns the fragment, empty when it is what was sent last."""
        content: ScreenContent = await self._screen.show(self._request, self._caller, self.informers)
        if content.fingerprint == self._sent:
            return ""
        self._sent = content.fingerprint
        if content.missing:
            context = {"text": content.missing}
            return self._console.pages.render("gone.html", context)
        return self._console.pages.render(f"{self._screen.name}_live.html", content.context, now_s=time.time())


async def _send_changes(answer: web.StreamResponse, follower: _Follower) -> None:
    """Sends the fragment at once and after every change, until the page, the session or the process ends."""
    while not follower.has_ended():
        if fragment := await follower.render_change():
            lines = "".join(f"data: {line}\n" for line in fragment.splitlines() if line.strip())
            await answer.write(f"{lines}\n".encode())
        while not await follower.wait_for_change():
            if follower.has_ended():
                return
            await answer.write(b": still here\n\n")
