"""A pool of connections that leaves none behind.

aiohttp's own pool forgets a connection as soon as it starts to close: a cancelled watch, a request that timed out, an idle
connection that grew old. Over TLS the end takes a round trip, and 30 s when the server does not answer; closing the pool
meanwhile returns at once, the loop ends, and the socket stays open until the garbage collector finds it.
"""

import asyncio
from typing import Any, Final

import aiohttp
from aiohttp.client_proto import ResponseHandler

CLOSE_TIMEOUT_S: Final = 5.0
"""An aborted connection is gone after a turn or two of the loop; this only keeps a bug from holding up a stop."""


class ConnectionPool(aiohttp.TCPConnector):
    """`close` cuts off what is still open or saying goodbye, and returns when every connection ever opened is gone."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._alive: dict[asyncio.Future[None], asyncio.Transport] = {}

    async def _create_connection(self, *args: Any, **kwargs: Any) -> ResponseHandler:
        protocol = await super()._create_connection(*args, **kwargs)
        transport, gone = protocol.transport, protocol.closed
        if transport is not None and gone is not None:  # not lost already
            self._alive[gone] = transport
            gone.add_done_callback(self._forget)
        return protocol

    def _forget(self, gone: "asyncio.Future[None]") -> None:
        del self._alive[gone]
        if not gone.cancelled():
            gone.exception()  # why it was lost is known to whoever used it; unread, asyncio would log it

    async def close(self, *, abort_ssl: bool = False) -> None:
        # Cut first: aiohttp would detach the bodies being read, and their readers would wait for ever.
        await self._cut()
        await super().close(abort_ssl=abort_ssl)
        await self._cut()  # what was opened meanwhile

    async def _cut(self) -> None:
        for transport in self._alive.values():
            transport.abort()
        if self._alive:
            await asyncio.wait(self._alive, timeout=CLOSE_TIMEOUT_S)
