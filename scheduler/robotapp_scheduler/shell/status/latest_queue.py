"""A queue that keeps only the latest value per key."""

import asyncio
from collections import OrderedDict
from typing import Generic, TypeVar

Key = TypeVar("Key")
Word = TypeVar("Word")


class LatestQueue(Generic[Key, Word]):
    """Words by key, taken in the order in which their keys came; a newer word takes the place of one not yet taken."""

    def __init__(self) -> None:
        self._words: OrderedDict[Key, Word] = OrderedDict()
        self._some = asyncio.Event()

    def __repr__(self) -> str:
        return f"<LatestQueue {len(self)} waiting>"

    def __len__(self) -> int:
        return len(self._words)

    def put(self, key: Key, word: Word) -> None:
        """Never waits."""
        self._words[key] = word
        self._some.set()

    def get(self, key: Key) -> Word | None:
        """The word that waits under the key, None when none does."""
        return self._words.get(key)

    def drop(self, key: Key) -> None:
        """What waits under the key, if anything, is not to be written any more."""
        self._words.pop(key, None)

    async def take(self) -> tuple[Key, Word]:
        """The oldest key with its word, once there is one; several may wait here."""
        while not self._words:
            self._some.clear()
            await self._some.wait()
        return self._words.popitem(last=False)
