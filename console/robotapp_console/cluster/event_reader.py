"""Events about one object: a tenant can write as many as he likes, so only the newest are held, and only so many are read."""

import time
from collections.abc import Callable
from heapq import nlargest
from typing import Final, NamedTuple

from robotapp_client import ApiClient
from robotapp_client.api.client import Page, decoder, with_query
from robotapp_client.api.resources import EVENTS
from robotapp_console.views.app.page import MOST_EVENTS
from robotapp_console.views.objects import Event

EVENTS_KEPT_S: Final = 5.0
PAGE: Final = 500
MOST_PAGES: Final = 20
_MOST_OBJECTS: Final = 64


class NewestEvents(NamedTuple):
    """The newest events, newest first. `is_whole` is false when there are more than were read."""

    events: tuple[Event, ...] = ()
    is_whole: bool = True


class EventReader:
    """Reads the events about an object again after a few seconds."""

    def __init__(self, client: ApiClient, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._client = client
        self._clock = clock
        self._answers: dict[str, tuple[float, NewestEvents]] = {}

    def __repr__(self) -> str:
        return f"<EventReader {len(self._answers)} objects>"

    async def read(self, namespace: str, uid: str) -> NewestEvents:
        """Returns the newest events about the object with this uid. Raises ApiError when they may not be read."""
        self._drop_old_answers()
        if (entry := self._answers.get(uid)) is not None:
            return entry[1]
        answer = await self._fetch(namespace, uid)
        if len(self._answers) >= _MOST_OBJECTS:
            self._answers.pop(next(iter(self._answers)))
        self._answers[uid] = (self._clock(), answer)
        return answer

    def _drop_old_answers(self) -> None:
        now_s = self._clock()
        self._answers = {
            uid: (read_s, answer) for uid, (read_s, answer) in self._answers.items() if now_s - read_s < EVENTS_KEPT_S
        }

    async def _fetch(self, namespace: str, uid: str) -> NewestEvents:
        path = with_query(EVENTS.path(namespace), {"fieldSelector": f"regarding.uid={uid}"})
        newest: list[Event] = []
        pages = 0
        async for part, again in self._client.pages(path, decoder(Page[Event]).decode, page=PAGE):
            if again:
                newest = []
            newest = nlargest(MOST_EVENTS, [*newest, *(part.items or ())], key=lambda event: event.last_seen)
            pages += 1
            if pages == MOST_PAGES and part.metadata.continue_:
                return NewestEvents(tuple(newest), is_whole=False)
        return NewestEvents(tuple(newest))
