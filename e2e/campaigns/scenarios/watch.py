"""One watch on everything the scenarios wait for, in a thread of its own."""

import asyncio
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, TypeVar

from campaigns.rigs.watching import running
from robotapp_client import ApiClient, Change, Reflector, load
from robotapp_client.api.resources import (
    EVENTS,
    PERSISTENTVOLUMECLAIMS,
    PODS,
    ROBOTAPPS,
    ROBOTCLAIMS,
    Resource,
)

T = TypeVar("T")
Json = dict[str, Any]
WATCHED: Final = (PODS, EVENTS, ROBOTCLAIMS, PERSISTENTVOLUMECLAIMS, ROBOTAPPS)
BEGIN_S: Final = 30.0


class ClusterWatch:
    """The last state of all pods, Events, claims, volume claims and apps. Conditions are checked after every change."""

    def __init__(self, kubeconfig: Path) -> None:
        self._endpoint = load(kubeconfig)
        self._changed = threading.Condition()
        self._objects: dict[str, dict[str, Json]] = {resource.plural: {} for resource in WATCHED}
        self._stop: Callable[[], object] = lambda: None
        self._synced = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._watch()), name="cluster-watch", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        if not self._synced.wait(timeout=BEGIN_S):
            raise TimeoutError(f"the watch on the cluster did not start in {BEGIN_S:.0f} s")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()
        self._thread.join(timeout=10)

    def get(self, resource: Resource, key: str) -> Json | None:
        """One object by `namespace/name`, or by name where its kind has no namespace."""
        with self._changed:
            return self._objects[resource.plural].get(key)

    def all(self, resource: Resource, namespace: str = "") -> list[Json]:
        """All objects of a kind, or those of one namespace."""
        with self._changed:
            found = self._objects[resource.plural].values()
            return [each for each in found if namespace in ("", each["metadata"].get("namespace"))]

    def until(self, look: Callable[[], T], *, within_s: float, what: Callable[[], str]) -> T:
        """The first true value of `look`, which is called after every change. Raises TimeoutError with the text of `what`."""
        deadline_s = time.monotonic() + within_s
        with self._changed:
            while not (found := look()):
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    raise TimeoutError(f"not within {within_s:.0f} s: {what()}")
                self._changed.wait(left_s)
            return found

    async def _watch(self) -> None:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        self._stop = lambda: loop.call_soon_threadsafe(ended.set)
        async with ApiClient(self._endpoint, user_agent="robotapp-scenarios") as client, AsyncExitStack() as stack:
            for reflector in self._reflectors(client):
                await stack.enter_async_context(running(reflector))
            self._synced.set()
            await ended.wait()
        await asyncio.sleep(0.1)  # TLS connections say goodbye in the loop; without one their sockets would be leaked

    def _reflectors(self, client: ApiClient) -> Sequence[Reflector[Json]]:
        return [
            Reflector(client, resource, as_type=dict, on_change=self._note(resource), inactivity_s=300)
            for resource in WATCHED
        ]

    def _note(self, resource: Resource) -> Callable[[Change], None]:
        objects = self._objects[resource.plural]

        def note(change: Change) -> None:
            with self._changed:
                if change.new is None:
                    objects.pop(change.key, None)
                else:
                    objects[change.key] = change.new
                self._changed.notify_all()

        return note
