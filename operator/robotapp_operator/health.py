"""Health without a login, metrics for users that may get them, over HTTPS.

A probe that only shows that the process exists would keep a stuck operator alive.
"""

import ssl
from collections.abc import Callable, Mapping
from typing import Final

from aiohttp import web

from robotapp_client.serving.pages import PathGate, list_pages, refused
from robotapp_client.serving.port import Limits, Port, open_port

SILENCE_LIMIT_S: Final = 180.0
"""Bookmarks come every minute: nothing for three minutes means that we look at an old picture."""
OVERDUE_LIMIT_S: Final = 180.0
"""No single key takes that long: the workers hang."""
LIMITS: Final = Limits(connections=32, answer_s=10.0)
"""Kubelet and Prometheus need one connection each; with asyncio each costs 300 kB."""
STALE_LIMIT_S: Final = 60.0
"""Readiness ends when a watch has followed nothing for longer. A restart would not help, so liveness does not."""


class Health:
    """What the probes read.

    `silence_s`: seconds since the quietest watch heard something; `overdue_s`: how long the oldest due key has waited;
    `staleness`: seconds for which changes may have gone unseen, by resource; `synced`: caches are filled, or we stand by.
    """

    def __init__(
        self,
        *,
        silence_s: Callable[[], float],
        overdue_s: Callable[[], float],
        synced: Callable[[], bool],
        staleness: Callable[[], Mapping[str, float]] = dict,
        metrics: Callable[[], bytes],
        gate: PathGate,
    ) -> None:
        self._silence_s = silence_s
        self._overdue_s = overdue_s
        self._synced = synced
        self._staleness = staleness
        self._metrics = metrics
        self._gate = gate
        self._port: Port | None = None

    async def start(self, port: int, tls: Callable[[], ssl.SSLContext]) -> None:
        """Raises `PortError` when the port cannot be opened."""
        app = web.Application()
        app.add_routes(
            [
                web.get("/healthz", self._healthz),
                web.get("/readyz", self._readyz),
                web.get("/metrics", self._metrics_page),
            ]
        )
        list_pages(app)
        self._port = await open_port(app, host=None, port=port, tls=tls, limits=LIMITS)

    async def stop(self) -> None:
        if self._port:
            await self._port.close()

    async def _healthz(self, _: web.Request) -> web.Response:
        silence_s = self._silence_s()
        if silence_s > SILENCE_LIMIT_S:
            return web.Response(status=503, text=f"a watch has been silent for {silence_s:.0f} s\n")
        overdue_s = self._overdue_s()
        if overdue_s > OVERDUE_LIMIT_S:
            return web.Response(status=503, text=f"work has been due for {overdue_s:.0f} s\n")
        return web.Response(text="ok\n")

    async def _readyz(self, _: web.Request) -> web.Response:
        stale = {name: age_s for name, age_s in self._staleness().items() if age_s > STALE_LIMIT_S}
        if stale:
            names = ", ".join(f"{name} ({age_s:.0f} s)" for name, age_s in sorted(stale.items()))
            return web.Response(status=503, text=f"changes go unseen, of {names}; the log says why\n")
        if self._synced():
            return web.Response(text="ok\n")
        unread = ", ".join(sorted(name for name, age_s in self._staleness().items() if age_s > 0))
        return web.Response(status=503, text=f"caches are filling: {unread}\n")

    async def _metrics_page(self, request: web.Request) -> web.Response:
        refusal = await refused(self._gate, request, "get", "/metrics")
        return refusal or web.Response(
            body=self._metrics(), headers={"Content-Type": "text/plain; version=0.0.4; charset=utf-8"}
        )
