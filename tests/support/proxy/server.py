"""The proxy itself: a thread with an event loop, one plain-HTTP listener per component."""

import asyncio
import contextlib
import json
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import aiohttp
import yaml
from aiohttp import web
from tests.support.proxy.calls import Call, parse
from tests.support.proxy.faults import Fault, Reply, Rule, Rules, drop, verbs_of
from tests.support.proxy.ledger import Ledger, Moment, Write
from tests.support.proxy.streams import OpenWatch, forward
from yarl import URL

from robotapp_api.client.login import Endpoint, load

T = TypeVar("T")
Hook = Callable[[Write, Moment], None]
_HOP = frozenset(
    {"connection", "keep-alive", "transfer-encoding", "content-length", "upgrade", "te", "trailer", "host"}
)


@dataclass(frozen=True, slots=True)
class Route:
    """A component's way through the proxy: give `kubeconfig` to its process or `endpoint` to an ApiClient."""

    component: str
    url: str
    kubeconfig: Path
    endpoint: Endpoint


class FaultProxy:
    """Stands between components and a real API server, misbehaves on demand and keeps the ledger. See the package."""

    def __init__(self, *, seed: int = 0) -> None:
        self.ledger = Ledger()
        self._rules = Rules(seed)
        self._hooks: list[Hook] = []
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="fault-proxy", daemon=True)
        self._closing = contextlib.AsyncExitStack()
        self._folder = tempfile.TemporaryDirectory(prefix="fault-proxy-")
        self._watches: set[OpenWatch] = set()
        self._held: list[tuple[str, str]] = []
        self.errors: list[BaseException] = []

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.cut_watches()
        self._call(self._closing.aclose())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(timeout=10)
        self._loop.close()
        self._folder.cleanup()

    # What tests say

    def route(self, component: str, upstream: Path | Endpoint) -> Route:
        """Open a listener for `component` that forwards as the identity of `upstream` (a kubeconfig or endpoint)."""
        endpoint = load(upstream) if isinstance(upstream, Path) else upstream
        url = self._call(self._listen(component, endpoint))
        path = Path(self._folder.name) / f"{component}.kubeconfig"
        config = {
            "apiVersion": "v1",
            "kind": "Config",
            "clusters": [{"name": "proxy", "cluster": {"server": url}}],
            "users": [{"name": component, "user": {}}],
            "contexts": [
                {"name": "proxy", "context": {"cluster": "proxy", "user": component, "namespace": endpoint.namespace}}
            ],
            "current-context": "proxy",
        }
        path.write_text(yaml.safe_dump(config))
        return Route(component, url, path, load(path))

    def add(
        self,
        fault: Fault,
        *,
        component: str = "",
        verbs: str | Iterable[str] = (),
        resource: str = "",
        path: str = "",
        when: Callable[[Call], bool] | None = None,
        skip: int = 0,
        times: int | None = 1,
        probability: float = 1.0,
    ) -> Rule:
        """Put a fault in force; by default it strikes the first matching call once. `times=None`: until removed.

        `verbs`: get list watch create update patch delete deletecollection, or "write" for all that change something.
        `resource` is "pods" or "pods/binding"; `path` a regular expression; `when` sees the whole call with its body.
        """
        rule = Rule(
            fault,
            component=component,
            verbs=verbs_of(verbs),
            resource=resource,
            path=path,
            when=when,
            skip=skip,
            times=times,
            probability=probability,
        )
        return self._rules.add(rule)

    def remove(self, rule: Rule) -> None:
        self._rules.remove(rule)

    def clear(self) -> None:
        """No more faults (the ledger and hooks stay)."""
        self._rules.clear()

    def on_write(self, hook: Hook) -> Callable[[], None]:
        """Call `hook(write, moment)` before each write goes to the server and after the server has answered it.

        It runs in the proxy's thread and everything waits for it, so a process killed in it dies exactly there: the
        write is not sent, or is applied but not answered. Returns a function that takes the hook out again.
        """
        self._hooks.append(hook)
        return lambda: self._hooks.remove(hook)

    def kill_at(self, component: str, index: int, moment: Moment, kill: Callable[[], None]) -> Callable[[], bool]:
        """Call `kill` once, at the component's write number `index` (events and leases not counted).

        The write is dropped (`before`) or its answer is (`after`). Returns a function saying whether it happened.
        """
        struck = threading.Event()

        def strike(write: Write, at: Moment) -> None:
            if not struck.is_set() and (write.call.component, write.index, at) == (component, index, moment):
                struck.set()
                write.fault = f"killed {moment}"
                kill()

        self._hooks.append(strike)
        return struck.is_set

    def forget_hooks(self) -> None:
        self._hooks.clear()

    def cut_watches(self, *, component: str = "", resource: str = "") -> int:
        """End the open watches that match, now; how many there were."""
        return self._call(self._each_watch(component, resource, lambda watch: watch.cut.set()))

    @contextlib.contextmanager
    def hold_watches(self, *, component: str = "", resource: str = "") -> Iterator[None]:
        """Nothing arrives over the matching watches meanwhile; afterwards everything does. Makes caches stale."""
        self._held.append((component, resource))
        self._call(self._each_watch(component, resource, lambda watch: watch.flowing.clear()))
        try:
            yield
        finally:
            self._held.remove((component, resource))
            self._call(self._each_watch(component, resource, lambda watch: watch.flowing.set()))

    @contextlib.contextmanager
    def partition(self, component: str) -> Iterator[None]:
        """The component is cut off from the API server: open watches end, every request is dropped."""
        rule = self.add(drop(), component=component, times=None)
        self.cut_watches(component=component)
        try:
            yield
        finally:
            self.remove(rule)

    def wait(self, condition: Callable[[], bool], *, timeout_s: float = 30.0, what: str = "condition") -> None:
        """Poll until `condition()`; TimeoutError with the last writes otherwise."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                recent = "\n".join(str(write) for write in self.ledger.writes()[-15:])
                raise TimeoutError(f"{what} not met in {timeout_s} s; last writes:\n{recent}")
            time.sleep(0.02)

    # How it works

    def _call(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(timeout=30)

    async def _each_watch(self, component: str, resource: str, act: Callable[[OpenWatch], None]) -> int:
        matching = [watch for watch in self._watches if _concerns(watch, component, resource)]
        for watch in matching:
            act(watch)
        return len(matching)

    async def _listen(self, component: str, endpoint: Endpoint) -> str:
        session = aiohttp.ClientSession(
            connector=aiohttp.TCPConnector(limit=0, ssl=endpoint.tls or True),
            auto_decompress=False,
            cookie_jar=aiohttp.DummyCookieJar(),
            timeout=aiohttp.ClientTimeout(total=None),
            skip_auto_headers=("Accept-Encoding", "User-Agent", "Content-Type", "Accept"),
            read_bufsize=2**22,
        )
        session._retry_connection = False
        handler = _Handler(self, component, endpoint, session)
        runner = web.ServerRunner(web.Server(handler, handler_cancellation=True, access_log=None), shutdown_timeout=0.5)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        self._closing.push_async_callback(session.close)
        self._closing.push_async_callback(runner.cleanup)
        return f"http://127.0.0.1:{runner.addresses[0][1]}"

    def notify(self, write: Write, moment: Moment) -> None:
        for hook in list(self._hooks):
            try:
                hook(write, moment)
            except BaseException as error:  # noqa: BLE001 - shown by the test that set the hook: `proxy.errors`
                self.errors.append(error)

    def pick(self, call: Call) -> Fault:
        return self._rules.pick(call)

    @contextlib.contextmanager
    def opened(self, call: Call) -> Iterator[OpenWatch]:
        watch = OpenWatch(call)
        if not any(_concerns(watch, *held) for held in self._held):
            watch.flowing.set()
        self._watches.add(watch)
        try:
            yield watch
        finally:
            self._watches.discard(watch)


def _concerns(watch: OpenWatch, component: str, resource: str) -> bool:
    return (not component or watch.call.component == component) and (not resource or watch.call.resource == resource)


@dataclass(frozen=True, slots=True)
class _Handler:
    """One component's requests."""

    proxy: FaultProxy
    component: str
    endpoint: Endpoint
    session: aiohttp.ClientSession

    async def __call__(self, request: web.BaseRequest) -> web.StreamResponse:
        call = parse(self.component, request.method, request.raw_path, request.headers, await request.read())
        fault = self.proxy.pick(call)
        if fault.delay_s:
            await asyncio.sleep(fault.delay_s)
        if call.verb == "watch" and fault.forward and fault.reply is Reply.PASS:
            return await self._watch(request, call, fault)
        write = self.proxy.ledger.enter(call) if call.is_write else None
        if write is not None:
            write.fault = "" if fault.name == "pass" else fault.name
            self.proxy.notify(write, Moment.BEFORE)
            if write.fault == "killed before":
                return _break_off(request)
        if not fault.forward:
            return await self._reply(request, fault, None, write)
        try:
            upstream = await self._forward(request, call)
        except aiohttp.ClientError:
            return _break_off(request)
        if write is not None:
            write.status = upstream.status
            self.proxy.notify(write, Moment.AFTER)
            if write.fault == "killed after":
                return _break_off(request)
        return await self._reply(request, fault, upstream, write)

    async def _forward(self, request: web.BaseRequest, call: Call) -> "_Answer":
        async with self.session.request(
            call.method, self._url(call), data=call.body or None, headers=await self._headers(request)
        ) as response:
            return _Answer(response.status, _passed(response.headers), await response.read())

    async def _watch(self, request: web.BaseRequest, call: Call, fault: Fault) -> web.StreamResponse:
        headers = await self._headers(request)
        headers.pop("Accept-Encoding", None)
        try:
            async with self.session.get(self._url(call), headers=headers) as response:
                if response.status != 200:
                    return web.Response(
                        status=response.status, headers=_passed(response.headers), body=await response.read()
                    )
                out = web.StreamResponse(status=200, headers=_passed(response.headers))
                await out.prepare(request)
                with self.proxy.opened(call) as watch:
                    await forward(watch, _lines(response), out, fault)
                return out
        except (aiohttp.ClientError, ConnectionError):
            return _break_off(request)

    async def _reply(
        self, request: web.BaseRequest, fault: Fault, upstream: "_Answer | None", write: Write | None
    ) -> web.StreamResponse:
        if fault.reply in (Reply.CLOSE, Reply.RESET):
            return _break_off(request, reset=fault.reply is Reply.RESET)
        if fault.reply is Reply.STATUS:
            upstream = _refusal(fault)
        assert upstream is not None
        if write is not None:
            write.answered = upstream.status
        if fault.reply is Reply.GARBLE:
            return web.Response(status=upstream.status, headers=upstream.headers, body=b'{"kind": "Half an obj')
        if fault.reply is Reply.TRUNCATE:
            out = web.StreamResponse(status=upstream.status, headers=upstream.headers)
            out.content_length = len(upstream.body)
            await out.prepare(request)
            await out.write(upstream.body[: len(upstream.body) // 2])
            return _break_off(request)
        return web.Response(status=upstream.status, headers=upstream.headers, body=upstream.body)

    def _url(self, call: Call) -> URL:
        return URL(self.endpoint.server + call.path, encoded=True)

    async def _headers(self, request: web.BaseRequest) -> dict[str, str]:
        headers = {key: value for key, value in request.headers.items() if key.lower() not in _HOP}
        credentials = self.endpoint.credentials
        if credentials.due:
            await credentials.refresh()
        if credentials.authorization:
            headers["Authorization"] = credentials.authorization
        return headers


@dataclass(frozen=True, slots=True)
class _Answer:
    status: int
    headers: dict[str, str]
    body: bytes


def _refusal(fault: Fault) -> _Answer:
    headers = {"Content-Type": "application/json"}
    if fault.retry_after_s is not None:
        headers["Retry-After"] = f"{fault.retry_after_s:g}"
    status = {
        "kind": "Status",
        "apiVersion": "v1",
        "status": "Failure",
        "code": fault.status,
        "reason": fault.reason,
        "message": fault.message,
    }
    return _Answer(fault.status, headers, json.dumps(status).encode())


def _passed(headers: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in headers.items() if key.lower() not in _HOP}


async def _lines(response: aiohttp.ClientResponse) -> AsyncIterator[bytes]:
    rest = b""
    async for chunk in response.content.iter_any():
        *complete, rest = (rest + chunk).split(b"\n")
        for line in complete:
            yield line + b"\n"


def _break_off(request: web.BaseRequest, *, reset: bool = False) -> web.StreamResponse:
    """Close the client's connection under its request, with a reset if asked for."""
    transport = request.transport
    if transport is not None:
        if reset:
            _linger_zero(transport)
        transport.abort()
    return web.Response(status=500)  # goes nowhere


def _linger_zero(transport: asyncio.Transport) -> None:
    import socket
    import struct

    sock = transport.get_extra_info("socket")
    if sock is not None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


__all__ = ["FaultProxy", "Route"]
