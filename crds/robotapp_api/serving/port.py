"""A port of ours: open, or a sentence for the person who started us."""

import ssl

from aiohttp import web

from robotapp_api.serving.pages import list_pages

_STOPPING_S = 5.0


class PortError(Exception):
    """The port cannot be opened: it is taken, or not ours to take. The text says which and what to do."""


async def opened(app: web.Application, *, host: str | None, port: int, tls: ssl.SSLContext | None) -> web.AppRunner:
    """What serves the application, to be cleaned up at the end; port 0 takes a free one. Raises `PortError`."""
    list_pages(app)
    runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=_STOPPING_S)
    await runner.setup()
    try:
        await web.TCPSite(runner, host, port, ssl_context=tls).start()
    except OSError as error:
        await runner.cleanup()
        raise PortError(f"{error.strerror or error}: --health-port names another port") from error
    return runner
