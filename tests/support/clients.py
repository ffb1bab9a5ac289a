"""Clients for tests: short patience, known name."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

from robotapp_client import ApiClient, Endpoint
from robotapp_client.transport.errors import ClientError


def client_for(endpoint: Endpoint, **overrides: Any) -> ApiClient:
    """An ApiClient whose requests give up after two seconds instead of thirty."""
    settings: dict[str, Any] = {"user_agent": "robotapp-test", "field_manager": "robotapp-test", "timeout_s": 2.0}
    return ApiClient(endpoint, **(settings | overrides))


async def posted_soon(client: ApiClient, path: str, body: bytes) -> None:
    """`post_soon`, awaited; raises what it was told."""
    told: asyncio.Future[ClientError | None] = asyncio.get_running_loop().create_future()
    client.post_soon(path, body, told.set_result)
    error = await told
    if error is not None:
        raise error


def configmap(
    name: str, *, namespace: str = "default", labels: dict[str, str] | None = None, **data: str
) -> dict[str, Any]:
    meta: dict[str, Any] = {"name": name, "namespace": namespace}
    if labels:
        meta["labels"] = labels
    return {"apiVersion": "v1", "kind": "ConfigMap", "metadata": meta, "data": data}


async def until(condition: Callable[[], object], *, timeout_s: float = 30.0, what: str = "condition") -> None:
    """Poll in the loop until `condition()` is true."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"{what} not met in {timeout_s} s")
        await asyncio.sleep(0.005)


class FakeTime:
    """A clock that only `sleep` moves; `slept` records every pause in seconds."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.slept: list[float] = []

    def clock(self) -> float:
        return self.now_s

    async def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now_s += seconds
        await asyncio.sleep(0)

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments that make an ApiClient live in this time, with jitter off."""
        return {"clock": self.clock, "sleep": self.sleep, "uniform": lambda: 0.0}
