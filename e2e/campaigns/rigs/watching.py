"""Reflectors beside a test or a bench: in the running loop, or in a thread of their own."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, TypeVar

from robotapp_client import ApiClient, load
from robotapp_client.informer.reflector import Reflector

T = TypeVar("T")
BEGIN_S: Final = 30.0


@asynccontextmanager
async def running(reflector: Reflector[Any]) -> AsyncIterator[None]:
    """While this lasts the reflector runs; everything that exists already was seen before the body begins."""
    task = asyncio.create_task(reflector.run())
    try:
        await reflector.synced.wait()
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class Watching:
    """For classes that are told of changes: `async with` runs their reflector."""

    _reflector: Reflector[Any]

    async def __aenter__(self) -> Self:
        self._running = running(self._reflector)
        await self._running.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._running.__aexit__(None, None, None)


class WatchThread:
    """Runs reflectors in a thread of its own, so that blocking callers get exact times.

    Whoever takes in a change holds `_changed` and notifies it.
    """

    def __init__(self, kubeconfig: Path, name: str) -> None:
        self._endpoint = load(kubeconfig)
        self._changed = threading.Condition()
        self._stop: Callable[[], object] = lambda: None
        self._synced = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._watch()), name=name, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        if not self._synced.wait(timeout=BEGIN_S):
            raise TimeoutError(f"{self._thread.name} did not start within {BEGIN_S:.0f} s")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()
        self._thread.join(timeout=10)

    def wait_for(self, look: Callable[[], T], *, within_s: float, what: Callable[[], str]) -> T:
        """Returns the first true value of `look`, which is called after every change; TimeoutError has the text of `what`."""
        deadline_s = time.monotonic() + within_s
        with self._changed:
            while not (value := look()):
                rest_s = deadline_s - time.monotonic()
                if rest_s <= 0:
                    raise TimeoutError(what())
                self._changed.wait(rest_s)
            return value

    def _reflectors(self, client: ApiClient) -> Sequence[Reflector[Any]]:
        raise NotImplementedError

    async def _watch(self) -> None:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        self._stop = lambda: loop.call_soon_threadsafe(ended.set)
        async with ApiClient(self._endpoint, user_agent="robotapp-test-watch") as client, AsyncExitStack() as stack:
            for reflector in self._reflectors(client):
                await stack.enter_async_context(running(reflector))
            self._synced.set()
            await ended.wait()
        await asyncio.sleep(0.1)  # TLS connections say goodbye in the loop; without one their sockets would be leaked
