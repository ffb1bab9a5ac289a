"""All that one user follows: a feed per kind, shared by all of the user's pages."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Awaitable, Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Any, Final, Generic, TypeVar, cast

from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_client import ApiClient, ApiError, Change, ClientError, Endpoint, Unauthorized
from robotapp_client.api.resources import Resource
from robotapp_console.cluster.event_reader import EventReader, NewestEvents
from robotapp_console.cluster.feed import Feed
from robotapp_console.cluster.kinds import NODE_KIND, TELEMETRY, Kind
from robotapp_console.cluster.rights import Right, Rights
from robotapp_console.views.fleet import measure_links
from robotapp_console.views.history import LinkHistory
from robotapp_console.views.links import NodeLinks
from robotapp_console.views.objects import Telemetry
from robotapp_console.views.snapshot import Refusal, Snapshot, Stale
from robotapp_console.views.texts import clean, parse_timestamp

M = TypeVar("M")
log = logging.getLogger(__name__)

SETTLE_S: Final = 5.0
"""So long a page waits for what it shows; then it shows what there is."""
WRITE_SEEN_S: Final = 1.0
"""So long the answer to a write waits for the watch."""
TICK_S: Final = 10.0
"""Period of what happens without an event: agents fall silent, a half minute of the history ends."""
REVIEW_S: Final = 10.0
"""Period of asking whether the token is still valid, and with it for each right that is older than rights are kept."""
SHARE: Final = 10.0
"""Models that together take a millisecond to build are built at most every ten, so that reports without end take a tenth of a core at most."""
LEAST_PAUSE_S: Final = 0.15
IN_USE_S: Final = 60.0
"""So long a model that nobody asks for counts among those that share the tenth of a core."""
MOST_DEBT_S: Final = 10.0
"""Models of addresses that were not open before, and all models after an edit, are built at once until this other tenth of a core is so
long ahead of its time."""
MOST_WAITING: Final = 16
"""Requests of one user that wait for such a model."""
MOST_SCOPES: Final = 48
"""Namespaces that are followed one by one: those of all streams that a user may have, and of some pages besides."""
SCOPE_IDLE_S: Final = 300.0
"""So long a namespace is followed that no page shows."""
MANAGER: Final = "robotapp-console"
"""Owner of what users write through the console."""
SELF_REVIEWS: Final = Resource(
    "authentication.k8s.io", "v1", "selfsubjectreviews", "SelfSubjectReview", namespaced=False
)


@dataclass(slots=True)
class _BuiltModel(Generic[M]):
    """A model with what it was built of. Times are of the monotonic clock."""

    version: int
    edits: int
    built_s: float
    cost_s: float
    used_s: float
    snapshot: Snapshot
    model: M


class InformerSet:
    """One user's view of the cluster. `signed_out` becomes true when the API server does not accept the token any more."""

    def __init__(
        self,
        endpoint: Endpoint,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.client = ApiClient(endpoint, user_agent=MANAGER, field_manager=MANAGER, max_connections=8, timeout_s=10.0)
        self.rights = Rights(self.client)
        self.version = 0
        """Counts all changes."""
        self.edits = 0
        """Counts the changes that are no report of an agent: somebody or a controller made them, and people wait to see them."""
        self.signed_out = False
        self.streams = 0
        """Pages that follow changes."""
        self.turn = asyncio.Lock()
        """Held while a page is rendered: of many requests of one user each waits for its turn, and other users come between."""
        self.last_used_s = time.monotonic()
        self._feeds: dict[tuple[str, str], Feed] = {}
        self._scopes: dict[str, float] = {}
        """When each namespace that is followed by itself was used last, the longest unused one first."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._feed_tasks: dict[tuple[str, str], asyncio.Task[None]] = {}
        self._listeners: set[asyncio.Event] = set()
        self._round_trips = RoundTrips()
        self._links = NodeLinks(self._round_trips)
        self._history = LinkHistory()
        self._clock, self._sleep = clock, sleep
        self._models: dict[tuple[str, ...], _BuiltModel[Any]] = {}
        self._paid_s = clock()
        """When what the first building of models took will be a tenth of the time."""
        self._first_build = asyncio.Lock()
        self._waiting = 0
        self._events = EventReader(self.client, clock=clock)

    def __repr__(self) -> str:
        return f"<InformerSet {len(self._feeds)} feeds, {self.streams} streams>"

    async def open(self) -> None:
        await self.client.__aenter__()
        self._tasks |= {asyncio.create_task(self._tick_forever()), asyncio.create_task(self._review_forever())}

    async def close(self) -> None:
        """Ends every watch and connection."""
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._wake_listeners()
        await self.client.__aexit__(None, None, None)

    async def use(self, kinds: Iterable[Kind], namespace: str) -> None:
        """Follows these kinds from now on and waits until they are known. Where all namespaces are refused, `namespace` alone is followed."""
        self.last_used_s = time.monotonic()
        page_kinds = tuple(kinds)
        await self._settle([self._follow(kind, "") for kind in page_kinds])
        if namespace:
            refused_kinds = [kind for kind in page_kinds if self._is_narrowed(kind)]
            if refused_kinds:
                self._open_scope(namespace)
            await self._settle([self._follow(kind, namespace) for kind in refused_kinds])

    def _open_scope(self, namespace: str) -> None:
        """Notes that a namespace is followed by itself, and ends the one that was not used for longest where they are too many."""
        self._scopes.setdefault(namespace, 0.0)
        self._touch_scope(namespace)
        if len(self._scopes) > MOST_SCOPES:
            self._end_scope(next(iter(self._scopes)))

    def _touch_scope(self, namespace: str) -> None:
        """Notes that a page shows a namespace, if it is followed by itself."""
        if namespace in self._scopes:
            del self._scopes[namespace]
            self._scopes[namespace] = self._clock()

    def _end_scope(self, namespace: str) -> None:
        del self._scopes[namespace]
        for key in [key for key in self._feeds if key[1] == namespace]:
            del self._feeds[key]
            self._feed_tasks.pop(key).cancel()

    def _end_idle_scopes(self) -> None:
        now_s = self._clock()
        for namespace in [name for name, used_s in self._scopes.items() if now_s - used_s > SCOPE_IDLE_S]:
            self._end_scope(namespace)

    def _follow(self, kind: Kind, namespace: str) -> Feed:
        key = (kind.plural, namespace)
        feed = self._feeds.get(key)
        if feed is None:
            feed = self._feeds[key] = Feed(
                self.client,
                kind,
                namespace,
                changed=self._note_report if kind is TELEMETRY else self._note_edit,
                signed_out=self._sign_out,
                on_change=self._take_telemetry if kind is TELEMETRY else None,
            )
            feed_task = self._feed_tasks[key] = asyncio.create_task(feed.run())
            feed_task.add_done_callback(partial(_log_end, feed))
            feed_task.add_done_callback(self._tasks.discard)
            self._tasks.add(feed_task)
        return feed

    async def _settle(self, feeds: list[Feed]) -> None:
        tasks = [asyncio.ensure_future(feed.settled.wait()) for feed in feeds if not feed.settled.is_set()]
        if tasks:
            _, pending = await asyncio.wait(tasks, timeout=SETTLE_S)
            for task in pending:
                task.cancel()

    def _is_narrowed(self, kind: Kind) -> bool:
        feed = self._feeds.get((kind.plural, ""))
        return kind.resource.namespaced and not kind.whole and feed is not None and bool(feed.refusal)

    def take_snapshot(self, namespace: str, home: str) -> Snapshot:
        """Returns all that is followed. `namespace` is the user's choice, `home` what is shown where all namespaces are refused."""
        stores: dict[str, Any] = {}
        refusals: dict[str, Refusal] = {}
        stale: list[Stale] = []
        fallback_namespace = ""
        for (plural, scope), feed in self._feeds.items():
            if scope:
                continue
            source = feed
            if self._is_narrowed(feed.kind) and (local_feed := self._feeds.get((plural, namespace or home))):
                source, fallback_namespace = local_feed, local_feed.namespace
            if source.is_absent and feed.kind.is_optional:
                continue
            if source.refusal:
                cure = _NOT_INSTALLED if source.is_absent else f"You may not read them: {feed.kind.cure}."
                refusals[plural] = Refusal(feed.kind.words, clean(source.refusal), cure)
                continue
            if source.stale_since_s is not None:
                stale.append(Stale(feed.kind.words, _format_time(source.stale_since_s), clean(source.stale_why, 300)))
            stores[plural] = _select_namespace(source, namespace)
        return Snapshot(
            namespace=namespace or fallback_namespace,
            apps=stores.get("robotapps", {}),
            instances=stores.get("robotappinstances", {}),
            claims=stores.get("robotclaims", {}),
            resource_claims=stores.get("resourceclaims", {}),
            slices=stores.get("resourceslices", {}),
            pools=stores.get("domainpools", {}),
            telemetry=stores.get("nodetelemetries", {}),
            nodes=stores.get("nodes", {}),
            pods=stores.get("pods", {}),
            round_trips=self._round_trips,
            links=self._links,
            history=self._history,
            refusals=refusals,
            stale=tuple(stale),
            now_s=time.time(),
        )

    def build_model(
        self, key: tuple[str, ...], build: Callable[[Snapshot], M], *, namespace: str, home: str
    ) -> tuple[Snapshot, M]:
        """Returns what `build` makes of a snapshot. All pages share it, and it is built no more often than it is cheap."""
        self._touch_scope(namespace or home)
        key = (*key, namespace, home)
        started_s = self._clock()
        entry = cast("_BuiltModel[M] | None", self._models.get(key))
        if entry is not None:
            entry.used_s = started_s
            is_current = entry.version == self.version and started_s - entry.built_s < TICK_S
            if is_current or started_s < self._find_due(entry):
                return entry.snapshot, entry.model
        is_extra = entry is None or started_s < self._find_regular_due(entry)
        version, edits = self.version, self.edits
        snapshot = self.take_snapshot(namespace, home)
        model = build(snapshot)
        ended_s = self._clock()
        if is_extra:
            self._paid_s = max(self._paid_s, ended_s) + SHARE * (ended_s - started_s)
        if entry is None and len(self._models) >= _MOST_MODELS:
            self._models.pop(next(iter(self._models)))
        self._models[key] = _BuiltModel(version, edits, ended_s, ended_s - started_s, ended_s, snapshot, model)
        return snapshot, model

    def _find_due(self, entry: _BuiltModel[Any]) -> float:
        """Returns from when a model may be built anew: after an edit at once, as long as edits do not come without end."""
        if entry.edits != self.edits and self._debt_s <= MOST_DEBT_S:
            return entry.built_s + LEAST_PAUSE_S
        return self._find_regular_due(entry)

    def _find_regular_due(self, entry: _BuiltModel[Any]) -> float:
        """Returns from when a model may be built anew whatever has changed: all that are in use share a tenth of a core."""
        now_s = self._clock()
        cost_s = sum(model.cost_s for model in self._models.values() if now_s - model.used_s < IN_USE_S)
        return entry.built_s + max(LEAST_PAUSE_S, SHARE * cost_s)

    async def wait_for_first_build(self, key: tuple[str, ...], *, namespace: str, home: str) -> bool:
        """Waits until a model that was never built may be built. Returns False at once when too many requests wait already."""
        if (*key, namespace, home) in self._models:
            return True
        if self._waiting >= MOST_WAITING:
            return False
        self._waiting += 1
        try:
            async with self._first_build:
                await self._sleep(max(0.0, self._debt_s - MOST_DEBT_S))
        finally:
            self._waiting -= 1
        return True

    @property
    def _debt_s(self) -> float:
        return self._paid_s - self._clock()

    def pause_s(self, key: tuple[str, ...], *, namespace: str, home: str) -> float:
        """Returns in how many seconds this model may be built anew, for who shows it then."""
        self._touch_scope(namespace or home)
        entry = self._models.get((*key, namespace, home))
        return 0.0 if entry is None else max(0.0, self._find_due(entry) - self._clock())

    def is_behind(self, key: tuple[str, ...], *, namespace: str, home: str) -> bool:
        """Returns whether this model was built before the latest change: whoever shows it must do so once more."""
        entry = self._models.get((*key, namespace, home))
        return entry is not None and entry.version != self.version

    @contextlib.contextmanager
    def listen(self) -> Iterator[asyncio.Event]:
        """Gives an event that is set after every change, for a page that follows them."""
        wake = asyncio.Event()
        self._listeners.add(wake)
        self.streams += 1
        try:
            yield wake
        finally:
            self.streams -= 1
            self._listeners.discard(wake)
            self.last_used_s = time.monotonic()

    async def show_write(self, write: Callable[[], Awaitable[M]]) -> M:
        """Makes a write and waits a moment until a watch shows something of it, so that the next page does."""
        edits_before = self.edits
        with self.listen() as wake:
            result = await write()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(WRITE_SEEN_S):
                    while self.edits == edits_before:
                        wake.clear()
                        await wake.wait()
        if self._debt_s <= MOST_DEBT_S:
            self._models.clear()
        return result

    async def list_events(self, namespace: str, uid: str) -> NewestEvents:
        """Returns the newest events about an object. Raises ApiError when they may not be read; Unauthorized signs out."""
        try:
            return await self._events.read(namespace, uid)
        except Unauthorized:
            self._sign_out()
            raise

    async def fetch_user(self) -> str:
        """Returns the user name that the API server gives the token. Raises Unauthorized for one that is not valid."""
        try:
            review = await self.client.create(SELF_REVIEWS, {})
        except Unauthorized:
            self._sign_out()
            raise
        except ApiError as error:
            if error.status in (
                403,
                404,
            ):  # an older cluster, or one that took the right away: the token is valid all the same
                return ""
            raise
        user = ((review.get("status") or {}).get("userInfo") or {}).get("username", "")
        return clean(str(user), 253)

    def _take_telemetry(self, change: Change) -> bool:
        """Takes the round trips in and returns whether one of them is another than before."""
        report: Telemetry | None = change.new
        if report is None:
            self._links.forget((change.key, *self._round_trips.drop(change.key)))
            return True
        written_s = parse_timestamp(report.written_at)
        if written_s is None:
            return False
        status = report.status
        peers = self._round_trips.receive(
            change.key, status.rtt, seq=status.seq, interval_s=status.interval_seconds, now_s=written_s
        )
        if peers:
            self._links.forget((change.key, *peers))
        return bool(peers)

    async def _review_forever(self) -> None:
        """Notices what a watch does not tell: it goes on for minutes after its token has ended or its right was taken."""
        doubted_feeds = frozenset[Feed]()
        while not self.signed_out:
            await asyncio.sleep(REVIEW_S)
            if not self._feeds:
                continue
            with contextlib.suppress(ClientError):
                await self.fetch_user()
                doubted_feeds = await self._review_rights(doubted_feeds)

    async def _review_rights(self, doubted_feeds: frozenset[Feed]) -> frozenset[Feed]:
        """Refuses the feeds whose right is gone for the second time, and returns those for which it is the first: a server that starts refuses for a moment what it allows."""
        lost_feeds = set[Feed]()
        for feed in [feed for feed in self._feeds.values() if not feed.refusal]:
            right = Right("list", feed.kind.resource, feed.namespace)
            if not await self.rights.is_granted(right, fresh=feed in doubted_feeds):
                lost_feeds.add(feed)
                if feed in doubted_feeds:
                    feed.refuse(f"no right any more to {right.words}")
        return frozenset(lost_feeds - doubted_feeds)

    def _sign_out(self) -> None:
        self.signed_out = True
        self._wake_listeners()

    def _note_edit(self) -> None:
        self.edits += 1
        self._note_report()

    def _note_report(self) -> None:
        self.version += 1
        self._wake_listeners()

    def _wake_listeners(self) -> None:
        for listener in self._listeners:
            listener.set()

    async def _tick_forever(self) -> None:
        while True:
            for node, peers in self._round_trips.expire(time.time()).items():
                self._links.forget((node, *peers))
            if self._feeds.keys() >= {(TELEMETRY.plural, ""), (NODE_KIND.plural, "")}:
                snapshot = self.take_snapshot("", "")
                self._history.record(measure_links(snapshot), snapshot.now_s)
            self._end_idle_scopes()
            if self._listeners:
                self._note_report()
            await asyncio.sleep(TICK_S)


_MOST_MODELS: Final = 64
_NOT_INSTALLED: Final = "The cluster does not have this kind: install RobotApp (docs/installation.md)."


def _log_end(feed: Feed, task: asyncio.Task[None]) -> None:
    """Logs a feed that ended although nobody ended it."""
    if not task.cancelled() and (error := task.exception()) is not None:
        log.error("%r ended: %s", feed, error, exc_info=error)


def _select_namespace(feed: Feed, namespace: str) -> Any:
    if not namespace or not feed.kind.resource.namespaced or feed.kind.whole:
        return feed.store
    return {key: obj for key, obj in feed.store.items() if key.startswith(f"{namespace}/")}


def _format_time(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
