"""A local copy of a collection, kept true by list and watch.

The promise: once `synced`, `store` runs through states the server had, and every difference is reported exactly once
through `on_change`, also for objects that vanished while we could not watch. The first list is reported page by page.

Versions count up for ever, unless etcd is restored from a snapshot: then a watch from the version we know is answered with
silence until the new history has passed it, or, if versions were raised at the restore, with 410. So each time a watch is
opened again, the server's version is read first. If it is of another history, lower than ours or higher by leaps, and stays so,
everything is listed again, and an object whose content differs is reported as deleted and added.
"""

import asyncio
import logging
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Generic, TypeVar

import msgspec

from robotapp_client.api.backoff import Backoff
from robotapp_client.api.client import ApiClient, with_query
from robotapp_client.api.nesting import decode_nested
from robotapp_client.api.resources import Resource
from robotapp_client.informer.watch_decoder import (
    ADDED,
    BOOKMARK,
    DELETED,
    MODIFIED,
    Identity,
    Lines,
    Read,
    WatchDecoder,
    WatchEvent,
)
from robotapp_client.transport.errors import (
    ApiError,
    BadRequest,
    ClientError,
    Gone,
    Invalid,
    Silent,
    TooManyRequests,
    Unreachable,
    describe,
    error_from_response,
)

T = TypeVar("T")
log = logging.getLogger(__name__)

INACTIVITY_S: Final = 75.0
"""Bookmarks come once a minute, so after longer silence it is checked: the watch is opened anew where it stands.

Either the connection is dead, or all is quiet: an API server sends no bookmark before its cache has moved past the
version the watch began at, and the cache of a resource in which nothing happens moves as seldom as etcd reports its
progress (every ten minutes by default; kube-apiserver 1.37, cacheWatcher.process; two minutes of silence seen live).
"""
SERVER_TIMEOUT_S: Final = (300.0, 600.0)
STEADY_S: Final = 5.0
"""A watch that lived this long was a good one even if nothing happened in it."""
MOST_DELAY_S: Final = 5.0
"""Longest pause between two attempts without a Retry-After: how long after the server is back we may still be blind."""
RESUMES: Final = 3
"""After so many fruitless attempts to resume, list again: perhaps no server has that version any more."""
BUMP: Final = 10**8
"""Who restores etcd raises its versions by more than this (`--bump-revision`); writes take a day at a thousand per second."""
HISTORY_READS: Final = 3
"""So often the server must be of another history before it is believed: one member of several may lag for a moment."""
HISTORY_PAUSE_S: Final = 0.5


class _ListVersion(msgspec.Struct, rename="camel"):
    resource_version: str = ""


class _Listed(msgspec.Struct):
    """A list, of which only the version is read."""

    metadata: _ListVersion


_read_version: Final = msgspec.json.Decoder(_Listed).decode


def is_other_history(newest: str, known: str) -> bool:
    """Returns whether a server at version `newest` cannot have got there from version `known` by writes.

    Versions that are no numbers cannot be compared.
    """
    return newest.isdecimal() and known.isdecimal() and not 0 <= int(newest) - int(known) < BUMP


class Change(msgspec.Struct, frozen=True, gc=False):
    """`kind` is ADDED (old None), MODIFIED or DELETED (new None; old is the last state we knew)."""

    kind: str
    key: str
    old: Any
    new: Any


@dataclass(slots=True)
class ReflectorStats:
    """Counters since the start, for a metrics collector to read."""

    lists: int = 0
    watches: int = 0
    events: int = 0
    gone: int = 0
    failures: int = 0
    silences: int = 0
    restores: int = 0
    undecodable: int = 0
    callback_failures: int = 0


class Reflector(Generic[T]):
    """Mirror of one resource; `await reflector.run()` in a task, wait for `synced`, read `store`.

    `as_type` is dict or a msgspec Struct whose metadata has name, uid, resource_version and, for namespaced resources,
    namespace. Keys are "namespace/name" or "name". `on_change` is called synchronously after `store` has changed; an
    exception in it is logged and counted, and the next change is delivered all the same. A delete followed by a create
    of the same name (another uid) is reported as DELETED and ADDED even if both happened unseen.
    """

    def __init__(
        self,
        client: ApiClient,
        resource: Resource,
        *,
        as_type: type[T],
        on_change: Callable[[Change], None] | None = None,
        namespace: str | None = None,
        label_selector: str = "",
        field_selector: str = "",
        streaming: bool = False,
        page: int = 500,
        inactivity_s: float = INACTIVITY_S,
        backoff: Backoff | None = None,
        fixed_keys: bool = False,
        kept: Callable[[T], T] | None = None,
        on_problem: Callable[[ClientError | None], None] | None = None,
        on_restored: Callable[[], None] | None = None,
    ) -> None:
        """`fixed_keys` is for `WatchDecoder`. `kept` returns what `store`, and `old` of later changes, have of an object: all of it
        unless given. `new` of a change is always whole. `on_problem` gets each error that ends an attempt, and None when a list
        or watch is answered again; it must not raise. `on_restored` is called when the server has gone back to an older state,
        while `store` still has what was known before.
        """
        self._client = client
        self._resource = resource
        self._namespace = namespace
        self._selectors = {"labelSelector": label_selector, "fieldSelector": field_selector}
        self._decoder: WatchDecoder[T] = WatchDecoder(as_type, namespaced=resource.namespaced, fixed_keys=fixed_keys)
        self._on_change = on_change
        self._kept = kept
        self._on_problem = on_problem
        self._on_restored = on_restored
        self._restored = False
        """The next list is of another history: equal versions need not be equal objects."""
        self._failing = False
        self._streaming = streaming
        self._page = page
        self._inactivity_s = inactivity_s
        self._backoff = backoff or Backoff(base_s=0.2, cap_s=MOST_DELAY_S, uniform=client.uniform)
        self._objects: dict[str, T] = {}
        self._contact: float | None = None
        self._is_open = False
        self._followed_at = client.clock()
        self._initial: dict[str, Read[T]] | None = None
        self._progress = self._answered = False
        self._opened: float | None = None  # when the current watch began
        self._fruitless = 0
        self.store: Mapping[str, T] = MappingProxyType(self._objects)
        self.synced = asyncio.Event()
        self.resource_version = ""
        self._left_version = ""
        """The version that was given up to list again; another history is noticed before that, too."""
        self.stats = ReflectorStats()

    def __repr__(self) -> str:
        scope = self._namespace or "all namespaces" if self._resource.namespaced else "cluster"
        state = f"at {self.resource_version}" if self.resource_version else "must list"
        return f"<Reflector {self._resource.plural} ({scope}): {len(self._objects)} objects, {state}>"

    @property
    def last_contact_s(self) -> float:
        """Seconds since the server last sent anything, infinite before the first time. Alarm above ~180."""
        return float("inf") if self._contact is None else self._client.clock() - self._contact

    @property
    def stale_s(self) -> float:
        """Seconds for which changes on the server may have gone unseen: 0 while a watch is open and not silent for too long."""
        quiet_s = self._client.clock() - self._followed_at
        return 0.0 if self._is_open and quiet_s <= self._inactivity_s else quiet_s

    @property
    def plural(self) -> str:
        """Name of the resource, for metrics and health checks."""
        return self._resource.plural

    async def run(self) -> None:
        """List and watch until cancelled; failures of the server end in a log line and another attempt."""
        while True:
            delay_s = await self._attempt()
            if delay_s > 0:
                await self._client.sleep(delay_s)

    async def _attempt(self) -> float:
        """One list (if needed) and one watch to its end. Returns the pause before the next, in seconds."""
        self._progress = self._answered = False
        self._opened = None
        least_s = 0.0
        at_once = False
        try:
            if self.resource_version or self._left_version:
                await self._check_history()
            if not self.resource_version and not self._streaming:
                await self._list()
            await self._watch()
            at_once = self._was_steady()
        except Gone as error:
            self.stats.gone += 1
            self._answered = True
            at_once = self._fruitless == 0
            self._list_again("history is gone", error)
        except Silent as error:
            self.stats.silences += 1
            at_once = True
            level = logging.DEBUG if self._initial is None else logging.WARNING  # in the midst of a list it is no rest
            log.log(level, "%s: %s, asking again", self, error)
        except ClientError as error:
            self.stats.failures += 1
            least_s = error.pause_s if isinstance(error, ApiError) else 0.0
            log.warning("%s: %s", self, error, extra={"fields": describe(error)})
            self._answered = self._answered and not isinstance(error, TooManyRequests)
            self._report_problem(error)
        finally:
            self._initial = None
        if self._progress or self._was_steady():
            self._fruitless = 0
            self._backoff.reset()
        elif self._answered:  # a server that is down has not refused our version: resume when it is back
            self._fruitless += 1
            if self._fruitless % RESUMES == 0:
                self._list_again("no progress")
        return 0.0 if at_once else self._backoff.next_s(at_least_s=least_s)

    def _was_steady(self) -> bool:
        return self._opened is not None and self._client.clock() - self._opened >= STEADY_S

    def _list_again(self, why: str, error: ClientError | None = None) -> None:
        if self.resource_version:
            log.info("%s: %s, listing again", self, why, extra={"fields": describe(error) if error else {}})
            self._left_version = self.resource_version
        self.resource_version = ""

    async def _check_history(self) -> None:
        """Asks the server for its version, more than once if it differs, and reports a restore when it is not where we were."""
        known = self.resource_version or self._left_version
        newest = await self._read_newest()
        for _ in range(HISTORY_READS - 1):
            if is_other_history(newest, known):
                await self._client.sleep(HISTORY_PAUSE_S)
                newest = await self._read_newest()
        self._left_version = ""
        if not is_other_history(newest, known):
            return
        self.stats.restores += 1
        self._restored = True
        log.warning("%s: the server has another history, at version %s, listing everything again", self, newest)
        self.resource_version = ""
        if self._on_restored is not None:
            self._on_restored()

    async def _read_newest(self) -> str:
        """Returns the version at which the server is."""
        # With the selectors: a right to list may be that of one name.
        path = with_query(self._resource.path(self._namespace), {"limit": "1"} | self._selectors)
        answer = await self._client.request("GET", path)
        try:
            return decode_nested(_read_version, answer.body).metadata.resource_version
        except msgspec.DecodeError as error:
            raise Unreachable(f"the version of a list cannot be read: {error}", maybe_applied=False) from error

    async def _list(self) -> None:
        """At the start every page is taken as it comes, and its objects are freed if the caller does not keep them; later ones all at once."""
        self.stats.lists += 1
        path = with_query(self._resource.path(self._namespace), self._selectors)
        present: set[str] = set()
        changed: list[Read[T]] = []
        version = ""
        async for part, again in self._client.pages(path, self._decoder.page, page=self._page):
            if again:
                present, changed = set(), []
            for read in part.items or ():
                present.add(read[1].key)
                if not self.synced.is_set():
                    self._put(*read)
                elif self._is_changed(read[1]):
                    changed.append(read)
            version = part.metadata.resource_version
        self._contact = self._client.clock()
        self._replace(present, changed)
        self.resource_version = version
        self.synced.set()

    def _is_changed(self, identity: Identity) -> bool:
        known = self._objects.get(identity.key)
        return known is None or self._restored or self._decoder.identify(known) != identity

    def _replace(self, present: Collection[str], changed: Iterable[Read[T]]) -> None:
        """Take `changed` in; what is not `present` vanished while we were not looking."""
        for read in changed:
            self._put(*read)
        for key in [key for key in self._objects if key not in present]:
            self._remove(key)
        self._restored = False

    async def _watch(self) -> None:
        self.stats.watches += 1
        async with self._client.stream(self._watch_path(), silence_s=self._inactivity_s) as stream:
            self._answered = True
            self._contact = self._opened = self._client.clock()
            if stream.status != 200:
                error = error_from_response(stream.status, stream.headers, await stream.read())
                if self._streaming and isinstance(error, BadRequest | Invalid):
                    self._streaming = False  # an older server: list and watch, then
                raise error
            self._report_problem(None)
            self._is_open, self._followed_at = True, self._contact
            lines = Lines()

            def take(pieces: Sequence[bytes]) -> None:
                self._contact = self._followed_at = self._client.clock()
                for line in lines.ended(pieces):
                    self._on_line(line)

            try:
                await stream.deliver(take)
                self._followed_at = self._client.clock()
            finally:
                self._is_open = False

    def _watch_path(self) -> str:
        low, high = SERVER_TIMEOUT_S
        # Spread, or all watches of all our processes would be renewed in the same second for ever.
        timeout_s = int(low + (high - low) * self._client.uniform())
        query = {"watch": "1", "allowWatchBookmarks": "true", "timeoutSeconds": str(timeout_s)} | self._selectors
        if self.resource_version:
            query["resourceVersion"] = self.resource_version
        else:
            query |= {"sendInitialEvents": "true", "resourceVersionMatch": "NotOlderThan"}
            self._initial = {}
            self.stats.lists += 1
        return with_query(self._resource.path(self._namespace), query)

    def _on_line(self, line: bytes) -> None:
        try:
            event = self._decoder.event(line)
        except Gone:
            raise
        except ApiError as error:
            self._list_again("the watch ended with an error", error)
            raise
        self._progress = True
        self.stats.events += 1
        if self._initial is not None:
            self._on_initial(event)
            return
        if event.kind == DELETED:
            self._remove(event.identity.key)
        elif event.kind != BOOKMARK:
            self._put(event.obj, event.identity, event.problem)
        self.resource_version = event.identity.version or self.resource_version

    def _on_initial(self, event: WatchEvent) -> None:
        """A streamed list: nothing is reported until the bookmark that ends it."""
        initial = self._initial
        assert initial is not None  # noqa: S101 - the caller looked
        if event.kind == DELETED:
            initial.pop(event.identity.key, None)
        elif event.kind != BOOKMARK:
            initial[event.identity.key] = (event.obj, event.identity, event.problem)
        elif event.initial_end:
            self._initial = None
            self._replace(initial, initial.values())
            self.resource_version = event.identity.version
            self.synced.set()

    def _put(self, obj: T | None, identity: Identity, problem: str) -> None:
        key = identity.key
        if obj is None:
            self.stats.undecodable += 1
            log.error("%s: %s does not fit the type and keeps its last known state: %s", self, key, problem)
            return
        old = self._objects.get(key)
        if old is not None:
            before = self._decoder.identify(old)
            if before.uid != identity.uid or (self._restored and old != self._kept_of(obj)):
                self._remove(key)
                old = None
            elif before.version == identity.version:
                return
        self._objects[key] = self._kept_of(obj)
        self._report(Change(ADDED if old is None else MODIFIED, key, old, obj))

    def _kept_of(self, obj: T) -> T:
        return obj if self._kept is None else self._kept(obj)

    def _remove(self, key: str) -> None:
        old = self._objects.pop(key, None)
        if old is not None:
            self._report(Change(DELETED, key, old, None))

    def _report_problem(self, problem: ClientError | None) -> None:
        """Reports each problem, and its end once."""
        if self._on_problem is not None and (problem is not None or self._failing):
            self._on_problem(problem)
        self._failing = problem is not None

    def _report(self, change: Change) -> None:
        if self._on_change is None:
            return
        try:
            self._on_change(change)
        except Exception:  # the mirror must go on; a consumer's bug is loud in log and metric
            self.stats.callback_failures += 1
            log.exception("%s: on_change failed for %s %s", self, change.kind, change.key)


def find_staleness(reflectors: Iterable[Reflector[Any]]) -> dict[str, float]:
    """Returns the seconds for which changes may have gone unseen, by resource; of several watches of one, the longest."""
    worst: dict[str, float] = {}
    for reflector in reflectors:
        worst[reflector.plural] = max(worst.get(reflector.plural, 0.0), reflector.stale_s)
    return worst
