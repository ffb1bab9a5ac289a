"""The proxy itself: a thread with an event loop, one plain-HTTP listener per component."""

import asyncio
import contextlib
import tempfile
import threading
import time
from collections.abc import Callable, Coroutine, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import aiohttp
import yaml
from aiohttp import web
from tests.support.proxy.calls import Call
from tests.support.proxy.faults import Fault, Rule, Rules, drop, verbs_of
from tests.support.proxy.handler import Handler
from tests.support.proxy.ledger import Ledger, Moment, Write
from tests.support.proxy.pool import ConnectionPool
from tests.support.proxy.streams import OpenWatch

from robotapp_client.transport.kubeconfig import Endpoint, load

T = TypeVar("T")
Hook = Callable[[Write, Moment], None]


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
            connector=ConnectionPool(limit=0, ssl=endpoint.tls or True),
            auto_decompress=False,
            cookie_jar=aiohttp.DummyCookieJar(),
            timeout=aiohttp.ClientTimeout(total=None),
            skip_auto_headers=("Accept-Encoding", "User-Agent", "Content-Type", "Accept"),
            read_bufsize=2**22,
        )
        session._retry_connection = False
        handler = Handler(self, component, endpoint, session)
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
