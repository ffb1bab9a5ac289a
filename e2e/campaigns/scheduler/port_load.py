"""A program that makes work for a scheduler's port: bad tokens, each another one, and full explanations, at fixed rates.

python -m campaigns.scheduler.port_load URL --seconds 5 --path /explain/NAMESPACE/POD --token GOOD --token GOOD …
"""

import argparse
import asyncio
import json
import random
import time
from collections import Counter
from collections.abc import Awaitable, Callable

import aiohttp

from robotapp_testbed.control_plane.servers import unverified

CONNECTIONS = 50
PATIENCE_S = 30.0


class Load:
    """What was answered, by kind and status; 0 is no answer."""

    def __init__(self, http: aiohttp.ClientSession, options: argparse.Namespace) -> None:
        self._http = http
        self._options = options
        self._random = random.Random(options.seed)
        self.answers: dict[str, Counter[str]] = {"bad": Counter(), "full": Counter()}

    async def bad(self) -> None:
        await self._ask("bad", self._options.path, f"made-up-{self._random.getrandbits(256):x}")

    async def full(self) -> None:
        await self._ask("full", f"{self._options.path}?full=1", self._random.choice(self._options.token))

    async def _ask(self, kind: str, path: str, token: str) -> None:
        headers = {"Authorization": f"Bearer {token}"}
        try:
            async with self._http.get(f"{self._options.url}{path}", headers=headers) as answer:
                await answer.read()
                self.answers[kind][str(answer.status)] += 1
        except (aiohttp.ClientError, TimeoutError):
            self.answers[kind]["0"] += 1

    async def at_rate(self, per_s: float, ask: Callable[[], Awaitable[None]]) -> None:
        began_s = time.monotonic()
        async with asyncio.TaskGroup() as group:
            for number in range(int(per_s * self._options.seconds)):
                await asyncio.sleep(began_s + number / per_s - time.monotonic())
                group.create_task(_awaited(ask))


async def _awaited(ask: Callable[[], Awaitable[None]]) -> None:
    await ask()


async def run(options: argparse.Namespace) -> dict[str, Counter[str]]:
    connector = aiohttp.TCPConnector(limit=CONNECTIONS, ssl=unverified())
    timeout = aiohttp.ClientTimeout(total=PATIENCE_S)
    async with aiohttp.ClientSession(connector=connector, timeout=timeout) as http:
        load = Load(http, options)
        async with asyncio.TaskGroup() as group:
            group.create_task(load.at_rate(options.bad, load.bad))
            if options.token:
                group.create_task(load.at_rate(options.full, load.full))
        return load.answers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m campaigns.scheduler.port_load", description=__doc__)
    parser.add_argument("url")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--bad", type=float, default=500.0, help="bad tokens per second")
    parser.add_argument("--full", type=float, default=50.0, help="full explanations per second")
    parser.add_argument("--path", required=True)
    parser.add_argument("--token", action="append", default=[], help="of a user who may see the pod")
    parser.add_argument("--seed", type=int, default=1)
    print(json.dumps(asyncio.run(run(parser.parse_args()))))
