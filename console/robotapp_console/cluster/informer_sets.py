"""The informer sets of all users: made at the first use, ended a minute after the last."""

import asyncio
import time
from typing import Final

from robotapp_client import Endpoint
from robotapp_console.cluster.informer_set import InformerSet

IDLE_S: Final = 60.0
SWEEP_S: Final = 5.0
MOST_SETS: Final = 200
"""Users at once; each costs up to nine watches on the API server."""


class TooManyUsersError(Exception):
    """Too many users look at once; no further one is taken."""


class InformerSets:
    """Holds the sets by the key of their caller, which is made of the token and does not reveal it. `idle_s` infinite: sets are never ended."""

    def __init__(self, *, idle_s: float = IDLE_S) -> None:
        self._idle_s = idle_s
        self._sets: dict[str, InformerSet] = {}
        self._lock = asyncio.Lock()

    def __repr__(self) -> str:
        return f"<InformerSets {len(self._sets)} users>"

    def __len__(self) -> int:
        return len(self._sets)

    def __contains__(self, key: str) -> bool:
        return key in self._sets

    async def get(self, key: str, endpoint: Endpoint) -> InformerSet:
        """Returns the set of this caller. Raises TooManyUsersError."""
        async with self._lock:
            informers = self._sets.get(key)
            if informers is not None and informers.signed_out:
                await self._sets.pop(key).close()
                informers = None
            if informers is None:
                if len(self._sets) >= MOST_SETS:
                    raise TooManyUsersError
                informers = InformerSet(endpoint)
                await informers.open()
                self._sets[key] = informers
            informers.last_used_s = time.monotonic()
            return informers

    async def drop(self, key: str) -> None:
        """Ends the set of a caller who signed out."""
        async with self._lock:
            informers = self._sets.pop(key, None)
            if informers is not None:
                informers.signed_out = True
                await informers.close()

    async def sweep(self) -> None:
        """Ends the sets that no page uses."""
        async with self._lock:
            now_s = time.monotonic()
            idle = [
                key
                for key, informers in self._sets.items()
                if not informers.streams and (informers.signed_out or now_s - informers.last_used_s > self._idle_s)
            ]
            for key in idle:
                await self._sets.pop(key).close()

    async def sweep_forever(self) -> None:
        while True:
            await asyncio.sleep(min(SWEEP_S, self._idle_s))
            await self.sweep()

    async def close(self) -> None:
        async with self._lock:
            while self._sets:
                _, informers = self._sets.popitem()
                await informers.close()
