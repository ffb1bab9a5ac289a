"""Opens a process' HTTP port; when it cannot, the error text tells the user what to do."""

import asyncio
import errno
import socket
import ssl
from typing import Final

from aiohttp import web

from robotapp_client.serving.pages import list_pages

_STOPPING_S = 5.0
_BACKLOG: Final = 128
_PAUSES_S: Final = (0.1, 0.2, 0.4, 0.8)


class PortError(Exception):
    """The port cannot be opened: it is in use, or not permitted. The text has the cause and what to do."""


async def opened(app: web.Application, *, host: str | None, port: int, tls: ssl.SSLContext | None) -> web.AppRunner:
    """Serve the application; the caller cleans up the runner at the end. Port 0 takes a free one. Raises `PortError`."""
    runner = await _runner(app)
    try:
        await web.TCPSite(runner, host, port, ssl_context=tls).start()
    except OSError as error:
        await runner.cleanup()
        raise _taken(f"{error.strerror or error}") from error
    return runner


async def serving(app: web.Application, listener: socket.socket, *, tls: ssl.SSLContext | None) -> web.AppRunner:
    """Serve the application on a socket of `listening`, which another process may have opened."""
    runner = await _runner(app)
    await web.SockSite(runner, listener, ssl_context=tls).start()
    return runner


async def listening(host: str, port: int) -> socket.socket:
    """An open port without a server yet: connections wait. Raises `PortError`.

    A port in use is tried again: a process that served it for a parent that was killed may need a moment to end.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for pause_s in (*_PAUSES_S, None):
        try:
            return socket.create_server((host, port), family=family, backlog=_BACKLOG)
        except OSError as error:
            if pause_s is None or error.errno != errno.EADDRINUSE:
                raise _taken(f"{host} port {port}: {error.strerror or error}") from error
        await asyncio.sleep(pause_s)
    raise AssertionError("the last attempt returns or raises")


async def _runner(app: web.Application) -> web.AppRunner:
    list_pages(app)
    runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=_STOPPING_S)
    await runner.setup()
    return runner


def _taken(why: str) -> PortError:
    return PortError(f"{why}: --health-port names another port")
