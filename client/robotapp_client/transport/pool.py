"""The connection pool: a bounded number of connections to one server, and a queue of requests that find all of them busy."""

import asyncio
import functools
from collections import deque
from collections.abc import Callable
from typing import Final

from robotapp_client.transport.connect import CLOSE_S, GRAIN_S, Dialer, NotSentError
from robotapp_client.transport.http11 import Answer, Connection, Exchange, Outcome, Permitted, always
from robotapp_client.transport.kubeconfig import Endpoint

KEEPALIVE_S: Final = 60.0
"""Idle connections are dropped before the server (Go: 90 s and more) closes them under a request."""
NEVER: Final = float("inf")
CLOSED: Final = "the client is closed"


class Connections:
    """At most `limit` connections to one server; a request that comes when all are busy waits in line."""

    def __init__(self, endpoint: Endpoint, *, limit: int) -> None:
        self._dialer = Dialer(endpoint)
        self.host_header, self.prefix = self._dialer.host_header, self._dialer.prefix
        self._limit = limit
        self._idle: list[Connection] = []
        self._connecting: dict[asyncio.Task[None], Exchange] = {}
        self._claimed = 0
        self._line: deque[Exchange] = deque()
        self._sweep_s = NEVER
        self._sweeper: asyncio.TimerHandle | None = None

    def __repr__(self) -> str:
        waiting = sum(not exchange.dropped for exchange in self._line)
        return f"<Connections {self.host_header}: {self._claimed} busy, {len(self._idle)} idle, {waiting} waiting>"

    async def request(
        self, data: bytes, *, timeout_s: float, permitted: Permitted = always, most_bytes: int = 0
    ) -> Answer:
        """`send`, awaited. Raises NotSentError or BrokenError; cancelling it ends the connection that carries it."""
        ended: asyncio.Future[Outcome] = asyncio.get_running_loop().create_future()
        settle = functools.partial(_settle, ended)
        exchange = self.send(data, settle, timeout_s=timeout_s, permitted=permitted, most_bytes=most_bytes)
        try:
            outcome = await ended
        except asyncio.CancelledError:
            self._drop(exchange)
            raise
        if isinstance(outcome, Answer):
            return outcome
        raise outcome

    def send(
        self,
        data: bytes,
        done: Callable[[Outcome], None],
        *,
        timeout_s: float,
        permitted: Permitted = always,
        most_bytes: int = 0,
    ) -> Exchange:
        """Send `data` on a free connection, now or as soon as there is one. `timeout_s` counts from here.

        `permitted` is called in the moment of sending: while a connection was waited for, its result may have changed.
        """
        now_s = asyncio.get_running_loop().time()
        deadline_s = now_s + timeout_s
        exchange = Exchange(
            data, done, timeout_s=timeout_s, deadline_s=deadline_s, permitted=permitted, most_bytes=most_bytes
        )
        connection = self._pop_idle(now_s)
        if connection is None and self._claimed >= self._limit:
            self._line.append(exchange)
        else:
            self._claimed += 1
            if not self._carry(connection, exchange):
                self._pass_on(connection)
        if deadline_s < self._sweep_s:
            self._sweep_at(deadline_s)
        return exchange

    async def close(self) -> None:
        """End all connections and wait until they are gone."""
        while self._line:
            self._line.popleft().end(NotSentError(CLOSED))
        connecting = dict(self._connecting)
        for task, exchange in connecting.items():
            task.cancel()
            exchange.end(NotSentError(CLOSED))
        if connecting:
            await asyncio.wait(connecting, timeout=CLOSE_S)
        await self._dialer.close()
        if self._sweeper is not None:
            self._sweeper.cancel()

    # --- Whose turn it is -----------------------------------------------------------------------------------------

    def _pop_idle(self, now_s: float) -> Connection | None:
        while self._idle:
            connection = self._idle.pop()  # the one used last is the least likely to have been closed
            if connection.reusable and now_s - connection.idle_since_s < KEEPALIVE_S:
                return connection
            connection.end()
        return None

    def _carry(self, connection: Connection | None, exchange: Exchange) -> bool:
        """A claim's turn: `connection` carries the exchange, or a new one will. False when there is nothing to carry."""
        if exchange.dropped:
            return False
        if connection is None:
            task = asyncio.get_running_loop().create_task(self._carry_anew(exchange))
            self._connecting[task] = exchange
            task.add_done_callback(self._connecting.pop)
            return True
        if exchange.permitted():
            connection.begin(exchange)
            return True
        exchange.end(NotSentError("no longer permitted"))
        return False

    async def _carry_anew(self, exchange: Exchange) -> None:
        loop = asyncio.get_running_loop()
        try:
            connection = await self._dialer.connect(
                lambda: Connection(loop, self._free), timeout_s=exchange.deadline_s - loop.time()
            )
        except NotSentError as error:
            self._pass_on(None)
            exchange.end(error)
            return
        if not connection.reusable:
            self._pass_on(None)
            exchange.end(NotSentError("the connection was closed at once"))
        elif not self._carry(connection, exchange):
            self._free(connection)

    def _free(self, connection: Connection) -> None:
        """It has nothing to do any more."""
        if connection.reusable:
            self._pass_on(connection)
        else:
            connection.end()
            self._pass_on(None)

    def _pass_on(self, connection: Connection | None) -> None:
        """Pass a claim on, with its connection where that is still good, or give it up."""
        while self._line:
            if self._carry(connection, self._line.popleft()):
                return
        self._claimed -= 1
        if connection is not None:
            connection.idle_since_s = asyncio.get_running_loop().time()
            self._idle.append(connection)

    def _drop(self, exchange: Exchange) -> None:
        """Nobody waits for it any more: it is not sent, or its answer is not read."""
        exchange.dropped = True
        for connection in self._carrying():
            if connection.exchange is exchange:
                connection.fail("no caller waits for the answer")
                return

    def _carrying(self) -> list[Connection]:
        return [each for each in self._dialer.open if isinstance(each, Connection) and each.exchange is not None]

    # --- Time -----------------------------------------------------------------------------------------------------

    def _sweep_at(self, deadline_s: float) -> None:
        """One timer for the earliest deadline: nearly all requests are answered long before theirs."""
        if self._sweeper is not None:
            self._sweeper.cancel()
        self._sweep_s = deadline_s
        self._sweeper = asyncio.get_running_loop().call_at(deadline_s, self._sweep)

    def _sweep(self) -> None:
        self._sweep_s, self._sweeper = NEVER, None
        due_s = asyncio.get_running_loop().time() + GRAIN_S
        for exchange in [exchange for exchange in self._line if exchange.deadline_s <= due_s]:
            exchange.end(NotSentError(f"no free connection within {exchange.timeout_s:g} s"))
        for connection in self._carrying():
            carried = connection.exchange
            if carried is not None and carried.deadline_s <= due_s:
                connection.fail(f"no answer within {carried.timeout_s:g} s")
        left = [*self._line, *(connection.exchange for connection in self._carrying())]
        earliest_s = min((each.deadline_s for each in left if each is not None and not each.dropped), default=NEVER)
        if earliest_s < self._sweep_s:
            self._sweep_at(earliest_s)


def _settle(ended: "asyncio.Future[Outcome]", outcome: Outcome) -> None:
    if not ended.done():  # else cancelled in this very moment
        ended.set_result(outcome)
