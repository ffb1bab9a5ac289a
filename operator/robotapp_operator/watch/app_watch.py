"""The watch of RobotApps: kopf in a thread of its own, started again when it ends.

kopf takes every task of its event loop for its own, cancels them all when it ends, and ends on the first refusal that it does
not know. So it has a loop for itself, its end is one sentence in the log, and its events reach the operator's loop one by one.
It goes through connection errors in silence, so its session is ours: each request shows whether the watch is open, and when none
has succeeded for a while kopf is started again, with the certificate authority and the token of that moment.
"""

import asyncio
import contextlib
import logging
import threading
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any, Final
from urllib.parse import quote

import aiohttp
import kopf

from robotapp_client import ApiClient, ClientError
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.client import with_query
from robotapp_client.api.resources import ROBOTAPPS
from robotapp_client.transport.proxy import Proxy
from robotapp_operator.watch.kopf_handlers import register
from robotapp_operator.watch.kopf_settings import kopf_settings

log = logging.getLogger(__name__)

OnEvent = Callable[[str | None, Mapping[str, Any]], None]
"""Gets the type of a watch event and the RobotApp."""
STEADY_S: Final = 10.0
"""A refused watch ends sooner: after this long it counts as open."""
MOST_DELAY_S: Final = 5.0
FAILING_S: Final = 30.0
"""kopf is started again when its requests have failed for so long."""
LOOK_S: Final = 5.0
END_S: Final = 10.0
"""How long the thread may take to end."""


class AppWatch:
    """`run` reports every event of a RobotApp to `on_event`, until it is cancelled."""

    def __init__(
        self,
        client: ApiClient,
        *,
        namespaces: Sequence[str],
        on_event: OnEvent,
        watch_once: Callable[[], Awaitable[str]] | None = None,
    ) -> None:
        """`watch_once` watches until it cannot, and returns the reason: kopf does unless given."""
        self._client = client
        self._namespaces = namespaces
        self._on_event = on_event
        self._watch_once = watch_once or self._run_kopf
        self._backoff = Backoff(base_s=1.0, cap_s=MOST_DELAY_S, uniform=client.uniform)
        self._began: float | None = None
        self._failing_since: float | None = None
        """When the first of kopf's requests failed after one that did not. Written in kopf's thread, as is the reason."""
        self._failure = ""
        self._stale_since: float | None = None

    def __repr__(self) -> str:
        return f"<AppWatch: stale for {self.stale_s:.0f} s>"

    @property
    def stale_s(self) -> float:
        """Seconds since RobotApps could be watched last; 0 while they are, and before `run`."""
        now = self._client.clock()
        if self._stale_since is None:
            return 0.0
        if not self._is_steady(now):
            return now - self._stale_since
        return self._failing_s(now)

    def _failing_s(self, now: float) -> float:
        since = self._failing_since
        return 0.0 if since is None else now - since

    async def run(self) -> None:
        """Watch for ever; whatever ends a watch is logged in one sentence."""
        self._stale_since = self._client.clock()
        while True:
            reason = await self._refusal() or await self._watch()
            delay_s = self._backoff.next_s()
            log.warning("RobotApps are not watched: %s; next attempt in %.0f s", reason, delay_s)
            await self._client.sleep(delay_s)

    def _is_steady(self, now: float) -> bool:
        return self._began is not None and now - self._began >= STEADY_S

    async def _refusal(self) -> str:
        """Returns why RobotApps cannot be listed now, "" when they can."""
        for namespace in self._namespaces or (None,):
            try:
                await self._client.request("GET", with_query(ROBOTAPPS.path(namespace), {"limit": "1"}))
            except ClientError as error:
                return str(error)
        return ""

    async def _watch(self) -> str:
        """Watches to the end, and returns the reason of it."""
        self._began, self._failing_since = self._client.clock(), None
        try:
            return await self._watch_once()
        finally:
            now = self._client.clock()
            if self._is_steady(now):
                self._backoff.reset()
                self._stale_since = now - self._failing_s(now)
            self._began = None

    async def _run_kopf(self) -> str:
        loop, stop = asyncio.get_running_loop(), threading.Event()
        outcome: asyncio.Future[str] = loop.create_future()

        def report(kind: str | None, body: Mapping[str, Any]) -> None:
            loop.call_soon_threadsafe(self._on_event, kind, body)

        def watch() -> None:
            reason = _watch_until(stop, self._operator(report, stop))
            with contextlib.suppress(RuntimeError):  # the operator's loop has ended before
                loop.call_soon_threadsafe(_settle, outcome, reason)

        thread = threading.Thread(target=watch, name="kopf", daemon=True)
        thread.start()
        try:
            while not outcome.done():
                await asyncio.wait([outcome], timeout=LOOK_S)
                if self._failing_s(self._client.clock()) >= FAILING_S:
                    return self._failure
            return outcome.result()
        finally:
            stop.set()
            await asyncio.wait([outcome], timeout=END_S)

    def _operator(self, report: OnEvent, stop: threading.Event) -> Callable[[], Awaitable[None]]:
        registry = kopf.OperatorRegistry()
        register(registry, report)
        kopf.on.login(registry=registry)(self._login)
        return lambda: kopf.operator(
            registry=registry,
            settings=kopf_settings(),
            standalone=True,
            clusterwide=not self._namespaces,
            namespaces=self._namespaces,
            stop_flag=stop,
        )

    async def _login(self, **_: Any) -> kopf.AiohttpSession:
        """A session in kopf's loop that tells how each request ended."""
        endpoint = self._client.endpoint
        trace = aiohttp.TraceConfig()
        trace.on_request_end.append(self._on_answer)
        trace.on_request_exception.append(self._on_exception)
        session = aiohttp.ClientSession(
            connector=aiohttp.TCPConnector(limit=0, ssl=endpoint.tls or True),
            middlewares=(self._authorize,),
            trace_configs=[trace],
            proxy=_proxy_address(endpoint.proxy) if endpoint.proxy else None,
        )
        return kopf.AiohttpSession(
            server=endpoint.server, default_namespace=endpoint.namespace, aiohttp_session=session
        )

    async def _authorize(
        self, request: aiohttp.ClientRequest, handler: aiohttp.ClientHandlerType
    ) -> aiohttp.ClientResponse:
        """Sends the token as it is now; the operator's own requests refresh it."""
        authorization = self._client.endpoint.credentials.authorization
        if authorization is not None:
            request.headers["Authorization"] = authorization
        return await handler(request)

    async def _on_answer(self, _: object, __: object, params: aiohttp.TraceRequestEndParams) -> None:
        if params.response.status < 400:
            self._failing_since = None
        else:
            self._note_failure(f"{params.url.path} is answered with {params.response.status}")

    async def _on_exception(self, _: object, __: object, params: aiohttp.TraceRequestExceptionParams) -> None:
        if not isinstance(params.exception, asyncio.CancelledError):
            self._note_failure(f"{params.url.path}: {params.exception or type(params.exception).__name__}")

    def _note_failure(self, reason: str) -> None:
        self._failure = reason
        if self._failing_since is None:
            self._failing_since = self._client.clock()


def _watch_until(stop: threading.Event, operator: Callable[[], Awaitable[None]]) -> str:
    """Runs kopf in a loop of its own, and returns why it ended."""

    async def watch() -> None:
        asyncio.get_running_loop().set_exception_handler(_drop_left_overs)
        try:
            await operator()
        finally:
            stop.set()  # kopf waits for it in a thread, which the end of the loop would wait for

    try:
        asyncio.run(watch())
    except Exception as error:  # noqa: BLE001 - kopf wraps what happened into others; the innermost is the reason
        return str(_root_cause(error)) or type(error).__name__
    return "kopf ended by itself"


def _drop_left_overs(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Tasks of a kopf that has ended may hold the same error once more."""
    log.debug("kopf: %s", context.get("message"))


def _root_cause(error: BaseException) -> BaseException:
    while (cause := error.__cause__ or error.__context__) is not None:
        error = cause
    return error


def _settle(outcome: asyncio.Future[str], reason: str) -> None:
    if not outcome.done():
        outcome.set_result(reason)


def _proxy_address(proxy: Proxy) -> str:
    """Returns the address with its credentials, which aiohttp sends as Proxy-Authorization."""
    if not proxy.authorization:
        return str(proxy)
    login = f"{quote(proxy.user, safe='')}:{quote(proxy.password, safe='')}"
    return str(proxy).replace("://", f"://{login}@", 1)
