"""HTTP in front of the store: verbs, and watches with bookmarks and 410."""

import asyncio
from dataclasses import dataclass
from types import TracebackType
from typing import Self
from urllib.parse import parse_qsl, unquote, urlsplit

import msgspec
from tests.support.apiserver import verbs
from tests.support.apiserver.selectors import Match, match_query
from tests.support.apiserver.store import Json, Refused, Step, Store
from tests.support.apiserver.verbs import Sent, Target
from tests.support.apiserver.wire import TypedConnection

from robotapp_client.transport.kubeconfig import Endpoint


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """An open watch: which changes of the store it shows, and whether the client wants bookmarks.

    One that was opened at a version to come (`after`) shows nothing before it, no bookmark either, as a real one.
    """

    client: TypedConnection
    where: Target
    match: Match
    bookmarks: bool
    after: int = 0

    def send(self, kind: str, obj: Json) -> None:
        self.client.event(kind.encode(), msgspec.json.encode(obj))

    def send_step(self, step: Step) -> None:
        """Sends what the change looks like through the selector: an object that stops matching is gone."""
        if step.version <= self.after:
            return
        if step.key.collection != self.where.collection or self.where.namespace not in (None, step.key.namespace):
            return
        before = step.old is not None and self.match(step.old)
        after = step.new is not None and self.match(step.new)
        if before or after:
            self.send("DELETED" if not after else "MODIFIED" if before else "ADDED", step.last)

    def send_bookmark(self, version: int, annotations: dict[str, str] | None = None) -> None:
        if version < self.after:
            return
        meta: Json = {"resourceVersion": str(version)} | ({"annotations": annotations} if annotations else {})
        self.send("BOOKMARK", {"kind": self.where.kind, "apiVersion": self.where.api_version, "metadata": meta})


class FakeApiServer:
    """`async with FakeApiServer() as api:` then `ApiClient(api.endpoint, ...)`; `api.store` is the truth.

    `bookmark_s` is the period of bookmarks, `compact` on the store makes with_resumption watches fail with 410,
    `end_watches` ends the open ones as a server's time-out does, `break_watches` cuts their connections. `failing` holds
    what the next requests get instead of an answer: a status, or 0 for a connection cut off.
    """

    def __init__(self, *, bookmark_s: float = 60.0) -> None:
        self.store = Store()
        self.requests: list[tuple[str, str]] = []
        self.failing: list[int] = []
        self.served: dict[str, list[str]] = {}
        """Plurals that discovery lists, by path of the group and version; other paths are not found."""
        self.forbidden: set[str] = set()
        """Paths of collections that nobody may list or watch."""
        self.logs: dict[tuple[str, str], list[str]] = {}
        """Lines with their times by pod and container, as the subresource log has them."""
        self._bookmark_s = bookmark_s
        self._clients: set[TypedConnection] = set()
        self._watches: dict[TypedConnection, Watch] = {}
        self.endpoint = Endpoint("")
        self.store.watchers.append(self._spread)

    async def __aenter__(self) -> Self:
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._connect, "127.0.0.1", 0)
        self.endpoint = Endpoint(f"http://127.0.0.1:{self._server.sockets[0].getsockname()[1]}")
        self._timer = loop.call_later(self._bookmark_s, self._send_bookmarks)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        self.end_watches()
        self._server.close()
        while self._clients:
            for client in self._clients:
                client.abort()
            await asyncio.sleep(0)

    @property
    def watching(self) -> int:
        """How many watches are open."""
        return len(self._watches)

    def end_watches(self) -> None:
        while self._watches:
            self._watches.popitem()[0].end_stream()

    def garble_watches(self) -> None:
        """Sends half an event into every open watch."""
        for client in self._watches:
            client.chunk(b'{"type":"MODIFIED","object":{"meta\n')

    def fail_watches(self, status: int) -> None:
        """Sends an ERROR event into every open watch, and ends it."""
        refusal = Refused(status, "Expired" if status == 410 else "InternalError", "as the test wished")
        for watch in self._watches.values():
            watch.send("ERROR", refusal.status())
        self.end_watches()

    def break_watches(self) -> None:
        for client in self._watches:
            client.abort()

    def answer(self, client: TypedConnection, method: str, url: str, body: bytes) -> None:
        """Answers one request; a watch is answered from then on."""
        self.requests.append((method, url))
        status = self.failing.pop(0) if self.failing else None
        if status == 0:
            client.abort()
            return
        address = urlsplit(url)
        query = dict(parse_qsl(address.query, keep_blank_values=True))
        if status is not None:
            client.reply(status, msgspec.json.encode(Refused(status, "Injected", "as the test wished").status()))
            return
        plurals = self.served.get(address.path)
        if plurals is not None and method == "GET":
            client.reply(200, msgspec.json.encode({"resources": [{"name": plural} for plural in plurals]}))
            return
        if address.path in self.forbidden:
            refusal = Refused(403, "Forbidden", f"you may not list {address.path}")
            client.reply(refusal.code, msgspec.json.encode(refusal.status()))
            return
        try:
            where = verbs.target(unquote(address.path))
            if method == "GET" and where.name and address.path.endswith("/log"):
                self._send_log(client, where.name, query)
                return
            if method == "GET" and query.get("watch") in ("1", "true") and not where.name:
                self._begin_watch(client, where, query)
                return
            found = verbs.act(self.store, where, Sent(method, body, client.content_type, query))
            client.reply(201 if method == "POST" else 200, msgspec.json.encode(found))
        except Refused as refusal:
            client.reply(refusal.code, msgspec.json.encode(refusal.status()))
        except msgspec.DecodeError as error:
            client.reply(400, msgspec.json.encode(Refused(400, "BadRequest", str(error)).status()))

    def _send_log(self, client: TypedConnection, pod: str, query: dict[str, str]) -> None:
        """Sends the last lines of a container, from a whole second on where one is named; followed, they end the stream."""
        lines = self.logs.get((pod, query["container"]))
        if lines is None:
            raise Refused(400, "BadRequest", f'container "{query["container"]}" in pod "{pod}" has no log')
        first = max(0, len(lines) - int(query.get("tailLines", len(lines))))
        since = query.get("sinceTime", "")[:19]
        text = "".join(f"{line}\n" for line in lines[first:] if line[:19] >= since).encode()
        if query.get("follow") != "true":
            client.reply(200, text)
            return
        client.begin_stream()
        if text:
            client.chunk(text)
        client.end_stream()

    def _connect(self) -> TypedConnection:
        client = TypedConnection(self.answer, self._forget)
        self._clients.add(client)
        return client

    def _forget(self, client: TypedConnection) -> None:
        self._clients.discard(client)
        self._watches.pop(client, None)

    def _spread(self, step: Step) -> None:
        for watch in self._watches.values():
            watch.send_step(step)

    def _send_bookmarks(self) -> None:
        for watch in self._watches.values():
            if watch.bookmarks:
                watch.send_bookmark(self.store.version)
        self._timer = asyncio.get_running_loop().call_later(self._bookmark_s, self._send_bookmarks)

    def _begin_watch(self, client: TypedConnection, where: Target, query: dict[str, str]) -> None:
        """Sends the objects as they are, or the changes since a version, and whatever follows."""
        after = int(query.get("resourceVersion") or "0")
        watch = Watch(client, where, match_query(query), query.get("allowWatchBookmarks") == "true", after)
        client.begin_stream()
        with_objects = query.get("sendInitialEvents") == "true"
        if with_objects or not query.get("resourceVersion"):
            for obj in self.store.select(where.collection, where.namespace, watch.match):
                watch.send("ADDED", obj)
            if with_objects:
                watch.send_bookmark(self.store.version, {"k8s.io/initial-events-end": "true"})
        else:
            try:
                missed = self.store.since(int(query["resourceVersion"]))
            except Refused as refusal:
                watch.send("ERROR", refusal.status())
                client.end_stream()
                return
            for step in missed:
                watch.send_step(step)
        self._watches[client] = watch
