"""Events (events.k8s.io/v1) that never get in the way: bounded, aggregated, rate-limited, and silent when they fail."""

import asyncio
import itertools
import logging
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import Final

import msgspec

from robotapp_api.values.quantities.buckets import Buckets
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.bodies import encode
from robotapp_client.api.client import ApiClient, Json
from robotapp_client.api.resources import EVENTS
from robotapp_client.api.times import Now, as_micro_time, micro_time, utc_now
from robotapp_client.transport.errors import (
    AlreadyExists,
    ApiError,
    ClientError,
    NamespaceTerminating,
    NotFound,
    ServerError,
    TooManyRequests,
)

log = logging.getLogger(__name__)

QUEUE: Final = 1000
IN_FLIGHT: Final = 16
"""Writes at once; the other half of a client's connections is for writes that a caller waits for."""
REMEMBERED: Final = 4096
SERIES_FLUSH_S: Final = 300.0
"""A repeated event is written again at most this often: counts may lag, the API server may not."""
SERIES_END_S: Final = 360.0
"""Silence after which the same event is a new one; upstream's value."""
BURST: Final = 20
REFILL_S: Final = 60.0
ATTEMPTS: Final = 3
NOTE_BYTES: Final = 1024


@dataclass(slots=True)
class EventStats:
    """Counters since the start. `dropped`: queue full; `limited`: too many of one object; `failed`: given up."""

    created: int = 0
    repeated: int = 0
    dropped: int = 0
    limited: int = 0
    failed: int = 0


class _Metadata(msgspec.Struct, gc=False):
    name: str
    namespace: str


class _Body(msgspec.Struct, rename="camel", omit_defaults=True, gc=False, tag_field="kind", tag="Event"):
    """An Event as it is created."""

    metadata: _Metadata
    event_time: datetime | str
    reporting_controller: str
    reporting_instance: str
    action: str
    reason: str
    regarding: Json
    note: str
    type: str
    api_version: str
    related: Json | None = None


class _Series(msgspec.Struct, gc=False):
    """One event already written and what happened to it since; `key` is None for what cannot happen again."""

    key: "_Key | None"
    namespace: str
    name: str
    body: bytes
    seen: datetime
    seen_at: float
    written_at: float
    count: int = 1
    written: int = 1
    patching: bool = False


def reference(
    *, api_version: str, kind: str, name: str, namespace: str = "", uid: str = "", resource_version: str = ""
) -> Json:
    """An ObjectReference; empty parts are left out."""
    parts = {
        "apiVersion": api_version,
        "kind": kind,
        "namespace": namespace,
        "name": name,
        "uid": uid,
        "resourceVersion": resource_version,
    }
    if namespace and uid and resource_version:  # nearly always: about a pod
        return parts
    return {key: value for key, value in parts.items() if value}


class EventRecorder:
    """Call `event` from anywhere in the loop's thread; run `run()` as a task to have them written.

    The same event again (same object, type, reason, action and note) becomes a count on the first one. An object gets
    `burst` new events at once and one more every `refill_s` seconds.
    """

    def __init__(
        self,
        client: ApiClient,
        *,
        controller: str,
        instance: str,
        queue: int = QUEUE,
        in_flight: int = IN_FLIGHT,
        burst: int = BURST,
        refill_s: float = REFILL_S,
        flush_s: float = SERIES_FLUSH_S,
        now: Now = utc_now,
        unique: Callable[[], str] | None = None,
    ) -> None:
        self._client = client
        self._controller = controller
        self._instance = instance[:128]
        self._flush_s = flush_s
        self._now = now
        self._unique = unique or _counter()
        self._most = queue
        self._at_once = in_flight
        self._queue: deque[_Series] = deque()
        self._running = False
        self._writing = 0
        self._all_written = asyncio.Event()
        self._retries: set[asyncio.Task[None]] = set()
        self._series: OrderedDict[_Key, _Series] = OrderedDict()
        self._buckets = Buckets(per_s=1 / refill_s, burst=burst, clock=client.clock)
        self.stats = EventStats()

    def __repr__(self) -> str:
        return f"<EventRecorder {self._controller}: {len(self._queue)} queued, {self.stats.created} created>"

    def event(
        self,
        regarding: Json,
        *,
        reason: str,
        note: str,
        action: str,
        warning: bool = False,
        related: Json | None = None,
        once: bool = False,
    ) -> None:
        """Queue one event about `regarding` (an ObjectReference). Never waits, never raises.

        What can happen only `once` to an object is neither remembered, so that it could be counted, nor limited.
        """
        kind = "Warning" if warning else "Normal"
        note = _fit(note)
        at = self._client.clock()
        key: _Key | None = None
        if not once:
            source = (
                regarding.get("uid") or f"{regarding.get('kind')}/{regarding.get('namespace')}/{regarding.get('name')}"
            )
            key = (source, kind, reason, action, note)
            if self._repeated(key, at):
                return
            if self._buckets.wait_s(source) > 0:
                self.stats.limited += 1
                return
        namespace = regarding.get("namespace") or "default"  # where events of cluster-scoped objects live
        name = f"{regarding.get('name', 'unknown')[:220]}.{self._unique()}"
        seen = self._now()
        body = _Body(
            metadata=_Metadata(name, namespace),
            event_time=as_micro_time(seen),
            reporting_controller=self._controller,
            reporting_instance=self._instance,
            action=action,
            reason=reason,
            regarding=regarding,
            note=note,
            type=kind,
            api_version=EVENTS.api_version,
            related=related,
        )
        series = _Series(key, namespace, name, encode(body), seen, at, at)
        if self._put(series) and key is not None:
            self._series[key] = series
            while len(self._series) > REMEMBERED:
                self._series.popitem(last=False)

    def _repeated(self, key: "_Key", at: float) -> bool:
        """Count it on the event with the same text, if there is one."""
        series = self._series.get(key)
        if series is None or at - series.seen_at >= SERIES_END_S:
            return False
        self._series.move_to_end(key)
        series.count += 1
        series.seen, series.seen_at = self._now(), at
        self.stats.repeated += 1
        self._flush(series, at)
        return True

    def _put(self, series: _Series) -> bool:
        if len(self._queue) >= self._most:
            self.stats.dropped += 1
            return False
        self._queue.append(series)
        self._all_written.clear()
        self._next()
        return True

    def _flush(self, series: _Series, at: float) -> None:
        due = series.count > series.written and at - series.written_at >= self._flush_s
        if due and not series.patching:
            series.patching = True  # before it is queued: its turn may be now
            if not self._put(series):
                series.patching = False

    async def run(self) -> None:
        """Write events until cancelled."""
        self._running = True
        try:
            self._next()
            await self._tick()
        finally:
            self._running = False
            for task in self._retries:
                task.cancel()

    async def drain(self, timeout_s: float = 2.0) -> None:
        """Wait until everything queued is written, at most `timeout_s`: for an orderly stop, while `run` still runs."""
        if not self._queue and not self._writing:
            return
        try:
            async with asyncio.timeout(timeout_s):
                await self._all_written.wait()
        except TimeoutError:
            log.info("%s: stopped with events unwritten", self)

    async def _tick(self) -> None:
        while True:
            await self._client.sleep(max(1.0, self._flush_s / 10))
            at = self._client.clock()
            for key, series in list(self._series.items()):
                self._flush(series, at)
                if at - series.seen_at >= SERIES_END_S and series.count == series.written:
                    del self._series[key]

    # --- Writing: at most `in_flight` at once, each with a callback of the client; only a failure costs a task -----------

    def _next(self) -> None:
        while self._running and self._queue and self._writing < self._at_once:
            series = self._queue.popleft()
            self._writing += 1
            if series.patching:
                self._follow(self._patched(series))
                continue
            path = EVENTS.path(series.namespace)
            try:
                self._client.post_soon(path, series.body, partial(self._answered, series))
            except ValueError:  # no path: it must not silence all events that follow
                self._writing -= 1
                self.stats.failed += 1
                log.exception("%s: event lost", self)

    def _answered(self, series: _Series, error: ClientError | None) -> None:
        if error is None:
            self._created(series)
        elif self._running:
            self._follow(self._insist(series, error))
            return
        self._ended()

    def _created(self, series: _Series) -> None:
        series.body = b""
        self.stats.created += 1

    def _ended(self) -> None:
        self._writing -= 1
        if self._queue:
            self._next()
        elif not self._writing:
            self._all_written.set()

    def _follow(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.ensure_future(self._to_the_end(work))
        self._retries.add(task)
        task.add_done_callback(self._retries.discard)

    async def _to_the_end(self, work: Coroutine[None, None, None]) -> None:
        try:
            await work
        except Exception:  # a bug in here must not silence all events that follow
            self.stats.failed += 1
            log.exception("%s: event lost", self)
        finally:
            self._ended()

    async def _patched(self, series: _Series) -> None:
        error = await self._again(series)
        if error is not None:
            await self._insist(series, error)

    async def _insist(self, series: _Series, error: ClientError | None) -> None:
        """Try again what failed once, with back-off, a few times."""
        backoff = Backoff(base_s=0.2, cap_s=5.0, uniform=self._client.uniform)
        while error is not None and not isinstance(error, AlreadyExists):  # of an attempt whose answer was lost
            transient = not isinstance(error, ApiError) or isinstance(error, ServerError | TooManyRequests)
            if not transient or backoff.attempt >= ATTEMPTS - 1:
                self._give_up(series, error)
                return
            least_s = error.pause_s if isinstance(error, ApiError) else 0.0
            await self._client.sleep(backoff.next_s(at_least_s=least_s))
            error = await self._again(series)

    def _give_up(self, series: _Series, error: ClientError) -> None:
        series.patching = False
        if series.key is not None and self._series.get(series.key) is series:
            del self._series[series.key]  # the next occurrence starts over
        if not isinstance(
            error, NotFound | NamespaceTerminating
        ):  # the namespace or the event is gone: it is not needed
            self.stats.failed += 1
            log.warning("%s: event not written: %s", self, error)

    async def _again(self, series: _Series) -> ClientError | None:
        try:
            await (self._patch(series) if series.patching else self._create(series))
        except ClientError as error:
            return error
        return None

    async def _create(self, series: _Series) -> None:
        await self._client.post_raw(EVENTS.path(series.namespace), series.body)
        self._created(series)

    async def _patch(self, series: _Series) -> None:
        count = series.count
        patch = {"series": {"count": count, "lastObservedTime": micro_time(series.seen)}}
        await self._client.patch(EVENTS, series.name, patch, namespace=series.namespace)
        series.written, series.written_at, series.patching = count, self._client.clock(), False


_Key = tuple[str, str, str, str, str]


def _fit(note: str) -> str:
    if 4 * len(note) <= NOTE_BYTES:  # whatever its characters are
        return note
    encoded = note.encode()
    if len(encoded) <= NOTE_BYTES:
        return note
    return encoded[: NOTE_BYTES - 3].decode("utf-8", "ignore") + "…"


def _counter() -> Callable[[], str]:
    """Names that differ between events and between lives of the process, as upstream's do."""
    numbers = itertools.count(time.time_ns())
    return lambda: f"{next(numbers):x}"
