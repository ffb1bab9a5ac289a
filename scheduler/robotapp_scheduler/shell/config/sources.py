"""Where the configuration's text comes from, a file or a ConfigMap, and where the last good one is kept."""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.informer.reflector import Change, Reflector
from robotapp_client.tools.event_recorder import reference
from robotapp_client.transport.errors import ApiError, ClientError, Forbidden, NotFound
from robotapp_scheduler.config.flags import Options

log = logging.getLogger(__name__)

KEY: Final = "scheduler.yaml"
"""Key of a ConfigMap that holds the configuration."""
POLL_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class Given:
    """What the source holds: a text, or why there is none."""

    text: str = ""
    problem: str = ""


OnGiven = Callable[[Given], None]


class Source(Protocol):
    """`read` once, then `follow` until cancelled; `on_given` is called with every new state, the first one included."""

    @property
    def regarding(self) -> dict[str, Any] | None:
        """The object events about the configuration are attached to, if there is one."""

    async def read(self) -> Given: ...

    async def follow(self, on_given: OnGiven) -> None: ...


class NoSource:
    """The built-in configuration: nothing to read, nothing that changes."""

    regarding = None

    def __repr__(self) -> str:
        return "built-in configuration"

    async def read(self) -> Given:
        return Given()

    async def follow(self, _on_given: OnGiven) -> None:
        return


class FileSource:
    """A file, looked at every two seconds: a mounted ConfigMap is exchanged by a symbolic link, which no watch survives."""

    regarding = None

    def __init__(self, path: Path, *, poll_s: float = POLL_S) -> None:
        self._path = path
        self._poll_s = poll_s

    def __repr__(self) -> str:
        return str(self._path)

    async def read(self) -> Given:
        return await asyncio.to_thread(self._read)

    async def follow(self, on_given: OnGiven) -> None:
        last: Given | None = None
        while True:
            given = await self.read()
            if given != last:
                last = given
                on_given(given)
            await asyncio.sleep(self._poll_s)

    def _read(self) -> Given:
        try:
            return Given(self._path.read_text(encoding="utf-8"))
        except OSError as error:
            return Given(problem=str(error.strerror))
        except UnicodeDecodeError as error:
            return Given(problem=f"not UTF-8: {error}")


class MapSource:
    """A key of a ConfigMap, watched; needs get, list and watch of that one object."""

    def __init__(self, client: ApiClient, namespace: str, name: str) -> None:
        self._client = client
        self._namespace = namespace
        self._name = name
        self._uid = ""

    def __repr__(self) -> str:
        return f"ConfigMap {self._namespace}/{self._name}"

    @property
    def regarding(self) -> dict[str, Any]:
        return reference(api_version="v1", kind="ConfigMap", name=self._name, namespace=self._namespace, uid=self._uid)

    async def read(self) -> Given:
        """Waits for the API server: a scheduler without it has nothing to do."""
        while True:
            try:
                return self._given(await self._client.get(CONFIGMAPS, self._name, namespace=self._namespace))
            except (NotFound, Forbidden) as error:
                return Given(problem=error.message)
            except ClientError as error:
                log.warning("%r cannot be read yet: %s", self, error)
                await self._client.sleep(POLL_S)

    async def follow(self, on_given: OnGiven) -> None:
        def changed(change: Change) -> None:
            on_given(Given(problem="deleted") if change.new is None else self._given(change.new))

        reflector: Reflector[dict[str, Any]] = Reflector(
            self._client,
            CONFIGMAPS,
            as_type=dict,
            on_change=changed,
            namespace=self._namespace,
            field_selector=f"metadata.name={self._name}",
        )
        await reflector.run()

    def _given(self, found: dict[str, Any]) -> Given:
        self._uid = found["metadata"].get("uid", "")
        text = (found.get("data") or {}).get(KEY)
        return Given(problem=f"has no key {KEY}") if text is None else Given(text)


def sources(client: ApiClient, options: Options) -> "tuple[Source, LastGood | None]":
    """What the flags name; a ConfigMap without a namespace is in our own."""
    own = client.endpoint.namespace
    source: Source = NoSource()
    if options.config_map:
        source = MapSource(client, *_placed(options.config_map, own))
    elif options.config is not None:
        source = FileSource(options.config)
    kept = options.last_good_config_map
    return source, LastGood(client, *_placed(kept, own)) if kept else None


def _placed(name: str, own: str) -> tuple[str, str]:
    namespace, slash, rest = name.partition("/")
    return (namespace, rest) if slash else (own, name)


class LastGood:
    """The second ConfigMap: written with every configuration that is in use, read when the given one is bad.

    It must exist (the chart makes it), so that its one name is all we may write.
    """

    def __init__(self, client: ApiClient, namespace: str, name: str) -> None:
        self._source = MapSource(client, namespace, name)
        self._client = client
        self._namespace = namespace
        self._name = name
        self._written = ""

    def __repr__(self) -> str:
        return f"ConfigMap {self._namespace}/{self._name}"

    async def read(self) -> Given:
        return await self._source.read()

    async def write(self, text: str) -> None:
        """Keep this text; failing is logged, and tried again with the next one."""
        if text == self._written:
            return
        try:
            await self._client.patch(CONFIGMAPS, self._name, {"data": {KEY: text}}, namespace=self._namespace)
        except ApiError as error:
            log.warning("the configuration in use cannot be kept in %r: %s", self, error.message)
        except ClientError as error:
            log.warning("the configuration in use cannot be kept in %r: %s", self, error)
        else:
            self._written = text
