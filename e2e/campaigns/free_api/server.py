"""What it answers, and how it is told to make pods.

`POST /stub/burst?pods=N&classes=C` shows N new pods as fast as the watch takes them, `POST /stub/pace?pods=N&rate=R` R a
second; `GET /stub/report` says what became of them.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

import msgspec
from tests.support.apiserver.wire import Connection

from campaigns.free_api import objects
from robotapp_client.api import resources

PODS_PER_TURN: Final = 50
PAUSE_S: Final = 0.002
RUNNING_AFTER_S: Final = 0.1
"""From the bind until the kubelet's status comes, for all pods bound meanwhile at once."""
STATUS: Final = b'{"kind":"Status","apiVersion":"v1","metadata":{},"status":"Success","code":201}'
MISSING: Final = b'{"kind":"Status","apiVersion":"v1","status":"Failure","reason":"NotFound","code":404}'
REVIEWS: Final = (
    "/apis/authentication.k8s.io/v1/tokenreviews",
    "/apis/authorization.k8s.io/v1/subjectaccessreviews",
)
GOOD_TOKEN: Final = "good-"
SERVED: Final = [each for each in vars(resources).values() if isinstance(each, resources.Resource)]


class _Target(msgspec.Struct):
    name: str


class _Binding(msgspec.Struct):
    target: _Target


_BINDING = msgspec.json.Decoder(_Binding)


def _reviewed(body: bytes) -> bytes:
    """Tokens that begin so are users of that name, who may do everything."""
    review = msgspec.json.decode(body)
    token = review["spec"].get("token")
    good = token is not None and token.startswith(GOOD_TOKEN)
    known = {"authenticated": good, "user": {"username": token}} if token is not None else {"allowed": True}
    return msgspec.json.encode(review | {"status": known})


class FreeApi:
    """Nodes, running pods, and what is made on demand. Bookmarks are left out: runs are short."""

    def __init__(self, *, nodes: int, placed: int, clock: Callable[[], float] = time.perf_counter) -> None:
        self._nodes = nodes
        self._placed = placed
        self._clock = clock
        self._version = nodes + placed + 1
        self._leases: dict[str, bytes] = {}
        self._next = placed
        self._to_show: deque[tuple[int, int]] = deque()
        self._shapes: dict[int, int] = {}
        self._starting: list[tuple[int, str]] = []
        self._shown_s: dict[int, float] = {}
        self._waited_s: list[float] = []
        self._bound: dict[int, str] = {}
        self._first_s = self._last_s = 0.0
        self._counts = {"rebound": 0, "events": 0, "running": 0, "requests": 0}
        self.watchers: set[Connection] = set()
        self.open = 0

    def connection(self) -> Connection:
        self.open += 1
        return Connection(self.answer, self._forget)

    def _forget(self, client: Connection) -> None:
        self.open -= 1
        self.watchers.discard(client)

    def answer(self, client: Connection, method: str, url: str, body: bytes) -> None:
        parts = urlsplit(url)
        query = {name: values[0] for name, values in parse_qs(parts.query).items()}
        path = parts.path
        self._counts["requests"] += 1
        if path.endswith("/binding"):
            self._bind(client, path, body)
        elif path.startswith("/stub/"):
            self._control(client, path, query)
        elif "/leases" in path:
            self._lease(client, method, path, body)
        elif path in REVIEWS:
            client.reply(201, _reviewed(body))
        elif method == "POST":
            self._counts["events"] += path.endswith("/events")
            client.reply(201, body)
        elif method != "GET":
            client.reply(200, body)
        elif "watch" in query:
            client.begin_stream()
            if path.endswith("/pods"):
                self.watchers.add(client)
        else:
            self._read(client, path, query)

    # --- Reads -----------------------------------------------------------------------------------------------------

    def _read(self, client: Connection, path: str, query: dict[str, str]) -> None:
        if any(path == each.root for each in SERVED):
            names = [{"name": each.plural} for each in SERVED if each.root == path]
            client.reply(200, msgspec.json.encode({"resources": names}))
        elif "labelSelector" in query:  # of our own labels: nobody here has them
            self._page(client, query, 0, objects.node)
        elif path == "/api/v1/nodes":
            self._page(client, query, self._nodes, objects.node)
        elif path == "/api/v1/pods":
            self._page(client, query, self._placed, self._placed_pod)
        elif any(path == each.path() for each in SERVED):
            self._page(client, query, 0, objects.node)
        else:
            client.reply(404, MISSING)

    def _placed_pod(self, index: int) -> bytes:
        version = self._nodes + index + 1
        return objects.pod(objects.RUNNING, index, version=version, node=objects.node_name(index % self._nodes))

    def _page(self, client: Connection, query: dict[str, str], count: int, make: Callable[[int], bytes]) -> None:
        first = int(query.get("continue", "0"))
        last = min(count, first + int(query.get("limit", count)))
        token = str(last) if last < count else ""
        head = b'{"metadata":{"resourceVersion":"%d","continue":"%s"},"items":[' % (self._version, token.encode())
        client.reply(200, head + b",".join(make(index) for index in range(first, last)) + b"]}")

    def _lease(self, client: Connection, method: str, path: str, body: bytes) -> None:
        if method == "GET":
            stored = self._leases.get(path)
            client.reply(200, stored) if stored else client.reply(404, MISSING)
            return
        lease = msgspec.json.decode(body)
        self._version += 1
        lease["metadata"]["resourceVersion"] = str(self._version)
        name = path if method == "PUT" else f"{path}/{lease['metadata']['name']}"
        self._leases[name] = msgspec.json.encode(lease)
        client.reply(200 if method == "PUT" else 201, self._leases[name])

    # --- Pods on demand ----------------------------------------------------------------------------------------------

    def _control(self, client: Connection, path: str, query: dict[str, str]) -> None:
        if path == "/stub/report":
            client.reply(200, msgspec.json.encode(self.report()))
            return
        count, classes = int(query["pods"]), int(query.get("classes", "1"))
        new = [(index, index % classes) for index in range(self._next, self._next + count)]
        self._next += count
        self._shapes.update(new)
        self._shown_s, self._waited_s, self._bound = {}, [], {}
        self._counts = dict.fromkeys(self._counts, 0)
        loop = asyncio.get_running_loop()
        self._first_s = self._clock()
        if path == "/stub/pace":
            start_s, rate = loop.time(), float(query["rate"])
            for number, (index, shape) in enumerate(new):
                loop.call_at(start_s + number / rate, self._show, index, shape)
        else:
            self._to_show.extend(new)
            loop.call_soon(self._go_on)
        client.reply(200, b"{}")

    def _go_on(self) -> None:
        """Show more of a burst, in turns, so that binds are answered in between."""
        full = any(watcher.full for watcher in self.watchers)
        for _ in range(0 if full else min(PODS_PER_TURN, len(self._to_show))):
            self._show(*self._to_show.popleft())
        if self._to_show:
            asyncio.get_running_loop().call_later(PAUSE_S if full else 0.0, self._go_on)

    def _show(self, index: int, shape: int) -> None:
        self._tell(b"ADDED", objects.PENDING, index, shape=shape)
        self._shown_s[index] = self._clock()

    def _tell(self, kind: bytes, template: bytes, index: int, *, shape: int, node: str = "") -> None:
        self._version += 1
        obj = objects.pod(template, index, version=self._version, node=node, shape=shape)
        for watcher in self.watchers:
            watcher.event(kind, obj)

    def _bind(self, client: Connection, path: str, body: bytes) -> None:
        index = objects.pod_index(path.rsplit("/", 2)[1])
        node = _BINDING.decode(body).target.name
        now_s = self._clock()
        if index in self._bound:
            self._counts["rebound"] += 1
        self._bound[index] = node
        self._waited_s.append(now_s - self._shown_s[index])
        self._last_s = now_s
        client.reply(201, STATUS)
        self._tell(b"MODIFIED", objects.BOUND, index, shape=self._shapes[index], node=node)
        if not self._starting:
            asyncio.get_running_loop().call_later(RUNNING_AFTER_S, self._run)
        self._starting.append((index, node))

    def _run(self) -> None:
        started, self._starting = self._starting, []
        for index, node in started:
            self._tell(b"MODIFIED", objects.RUNNING, index, shape=self._shapes[index], node=node)
        self._counts["running"] += len(started)

    def report(self) -> dict[str, Any]:
        """Counts since the last order; `seconds` run from its first pod to the last bind, `waited_ms` are in order of binding."""
        return {
            **self._counts,
            "leases": len(self._leases),
            "open": self.open,
            "watchers": len(self.watchers),
            "bound": len(self._bound),
            "nodes_used": len(set(self._bound.values())),
            "seconds": self._last_s - self._first_s,
            "waited_ms": [round(1000 * each, 3) for each in self._waited_s],
            "cpu_s": time.process_time(),
        }
