"""The scheduler's configuration in the API server: read and written with the rights of the user who looks."""

import asyncio
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, Final, NamedTuple

from robotapp_api.model.names import SYSTEM_NAMESPACE, EventReason
from robotapp_client import ApiClient, ClientError
from robotapp_client.api.resources import CONFIGMAPS, EVENTS
from robotapp_client.transport.errors import Conflict, Forbidden, NotFound, Unauthorized
from robotapp_console.cluster.rights import Right, Rights
from robotapp_console.tuning.versions import (
    NAMELESS_AUTHOR,
    UNKNOWN_AUTHOR,
    Version,
    find_previous,
    is_recorded,
    plan_addition,
    read_versions,
)
from robotapp_console.views.app.page import EventRow, build_events
from robotapp_console.views.objects import Event
from robotapp_console.views.texts import clean, parse_timestamp

KEY: Final = "scheduler.yaml"
"""Where the scheduler looks for its configuration in the ConfigMap."""
RELOAD_S: Final = 5.0
"""The scheduler watches the ConfigMap, so it takes a change within a second; after this long the page says that it has not."""
_POLL_S: Final = 0.2
_CLOCKS_S: Final = 2.0
"""The API server writes the time of a write in whole seconds, and the scheduler's clock is another one."""
_ATTEMPTS: Final = 3
_REASONS: Final = frozenset(
    {EventReason.CONFIG_RELOADED, EventReason.CONFIG_INVALID, EventReason.CONFIG_RESTART_NEEDED}
)


class State(StrEnum):
    """A state of the ConfigMap's text: whether the scheduler uses it."""

    RUNNING = "running"
    REFUSED = "refused"
    WAITING = "waiting"
    UNKNOWN = "unknown"
    """The user may not read what the scheduler runs with."""


class Place(NamedTuple):
    """The ConfigMap of the configuration; the other two are named after it, as in the chart."""

    namespace: str = SYSTEM_NAMESPACE
    name: str = "robotapp-scheduler"

    @property
    def history(self) -> str:
        return f"{self.name}-history"

    @property
    def last_good(self) -> str:
        return f"{self.name}-last-good"

    def __str__(self) -> str:
        return f"{self.namespace}/{self.name}"


@dataclass(frozen=True, slots=True)
class StoredConfig:
    """The configuration as the API server has it. A text that may not be read, or is not there, is None, and its problem says why."""

    text: str | None = None
    problem: str = ""
    is_refused: bool = False
    """The user may not read the ConfigMap."""
    version: str = ""
    """resourceVersion of the ConfigMap."""
    written_at: str = ""
    running: str | None = None
    """The text that the scheduler runs with, which its leader keeps."""
    running_problem: str = ""
    history: tuple[Version, ...] = ()
    history_problem: str = ""
    events: tuple[EventRow, ...] = ()
    events_problem: str = ""
    denied: tuple[str, ...] = ()
    """ConfigMaps that the user may not change."""

    @property
    def state(self) -> State:
        """Returns whether the scheduler uses the text."""
        if self.running is None:
            return State.REFUSED if self.refusal else State.UNKNOWN
        if self.text == self.running:
            return State.RUNNING
        return State.REFUSED if self.refusal else State.WAITING

    @property
    def refusal(self) -> EventRow | None:
        """The scheduler's event that it does not use the text; None when there is none since it was written."""
        written_s = parse_timestamp(self.written_at)
        for event in self.events:
            if event.reason != EventReason.CONFIG_RELOADED and written_s is not None:
                seen_s = parse_timestamp(event.at)
                return event if seen_s is not None and seen_s >= written_s - _CLOCKS_S else None
        return None

    @property
    def previous(self) -> Version | None:
        """The version that undo brings back."""
        return find_previous(self.history, self.text) if self.text is not None else None


class StaleError(Exception):
    """Somebody else changed the configuration in the meantime; nothing was written."""


class NotRecordedError(Exception):
    """The configuration was written, and the history was not; the text says why."""


class _ReadMap(NamedTuple):
    """One ConfigMap as the API server gave it."""

    config: dict[str, Any] | None
    problem: str = ""
    is_refused: bool = False


@dataclass(slots=True)
class ConfigStore:
    """Reads and writes with one user's client."""

    client: ApiClient
    place: Place
    _uid: str = field(default="", init=False)
    _rights: Rights = field(init=False)

    def __post_init__(self) -> None:
        self._rights = Rights(self.client)

    async def read(self) -> StoredConfig:
        """Returns everything that the user may see of the configuration. Raises Unauthorized for a token that is not valid any more."""
        answers = await asyncio.gather(
            *map(self._read_map, (self.place.name, self.place.last_good, self.place.history))
        )
        (config, problem, is_refused), (last_good, last_good_problem, _), (history, history_problem, _) = answers
        denied_names = await self._list_denied()
        if config is None:
            return StoredConfig(problem=problem, is_refused=is_refused, denied=denied_names)
        text = _read_text(config)
        self._uid = config["metadata"].get("uid", "")
        events, events_problem = await self._read_events()
        return StoredConfig(
            text=text,
            problem="" if text is not None else f"ConfigMap {self.place} has no key {KEY}.",
            version=config["metadata"].get("resourceVersion", ""),
            written_at=_read_write_time(config),
            running=None if last_good is None else _read_text(last_good),
            running_problem=last_good_problem,
            history=() if history is None else read_versions(history.get("data") or {}),
            history_problem=history_problem,
            events=events,
            events_problem=events_problem,
            denied=denied_names,
        )

    async def apply(self, stored: StoredConfig, text: str, *, author: str) -> None:
        """Writes the text by server-side apply, if the ConfigMap is still the one that was read. What it replaces is recorded first.

        Raises StaleError, ClientError when the API server refuses or cannot be reached, and NotRecordedError after the write.
        """
        if stored.text is not None and not is_recorded(stored.history, stored.text):
            await self._record(stored.text, at=stored.written_at, by=UNKNOWN_AUTHOR)
        metadata = {"name": self.place.name, "namespace": self.place.namespace, "resourceVersion": stored.version}
        try:
            await self.client.apply(CONFIGMAPS, {"metadata": metadata, "data": {KEY: text}})
        except Conflict as error:
            raise StaleError from error
        try:
            await self._record(text, at=_format_now(), by=author or NAMELESS_AUTHOR)
        except ClientError as error:
            raise NotRecordedError(clean(str(error))) from error

    async def wait_for_reload(self) -> StoredConfig:
        """Returns the state as soon as the scheduler runs with the ConfigMap's text or has said why not, or after RELOAD_S."""
        loop = asyncio.get_running_loop()
        until_s = loop.time() + RELOAD_S
        while True:
            config = await self.read()
            if config.state is not State.WAITING or loop.time() > until_s:
                return config
            await asyncio.sleep(_POLL_S)

    async def _record(self, text: str, *, at: str, by: str) -> None:
        """Adds a version to the history. Raises ClientError."""
        for attempt in range(_ATTEMPTS):
            history = await self.client.get(CONFIGMAPS, self.place.history, namespace=self.place.namespace)
            versions = read_versions(history.get("data") or {})
            change = {
                "metadata": {"resourceVersion": history["metadata"].get("resourceVersion", "")},
                "data": plan_addition(versions, text, at=at, by=by),
            }
            try:
                await self.client.patch(CONFIGMAPS, self.place.history, change, namespace=self.place.namespace)
            except Conflict:
                if attempt == _ATTEMPTS - 1:
                    raise
            else:
                return

    async def _read_map(self, name: str) -> _ReadMap:
        """Returns a ConfigMap, or why it cannot be read. Raises Unauthorized."""
        try:
            return _ReadMap(await self.client.get(CONFIGMAPS, name, namespace=self.place.namespace))
        except NotFound:
            return _ReadMap(None, f"There is no ConfigMap {self.place.namespace}/{name}.")
        except Unauthorized:
            raise
        except ClientError as error:
            return _ReadMap(None, clean(str(error)), isinstance(error, Forbidden))

    async def _read_events(self) -> tuple[tuple[EventRow, ...], str]:
        selector = f"regarding.uid={self._uid}"
        try:
            listing = await self.client.list(
                EVENTS, namespace=self.place.namespace, field_selector=selector, as_type=Event
            )
        except ClientError as error:
            return (), clean(str(error))
        return build_events(event for event in listing.items if event.reason in _REASONS), ""

    async def _list_denied(self) -> tuple[str, ...]:
        """Returns the ConfigMaps that the user may not change. Each is asked for once, however often `read` looks."""
        names = (self.place.name, self.place.history)
        rights = [Right("patch", CONFIGMAPS, self.place.namespace, name) for name in names]
        granted_rights = await self._rights.select_granted(rights)
        return tuple(right.name for right in rights if right not in granted_rights)


def _read_text(config: dict[str, Any]) -> str | None:
    text = (config.get("data") or {}).get(KEY)
    return text if isinstance(text, str) else None


def _read_write_time(config: dict[str, Any]) -> str:
    """Returns when the ConfigMap was written last."""
    times = [str(entry.get("time", "")) for entry in config["metadata"].get("managedFields") or ()]
    return max([*times, str(config["metadata"].get("creationTimestamp") or "")])


def _format_now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
