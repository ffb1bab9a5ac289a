"""One kind in one scope, followed for one user: its objects, or why they may not be read, or since when they are stale."""

import asyncio
import time
from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any, Final

from robotapp_client import ApiClient, Change, ClientError, Forbidden, NotFound, Reflector, Unauthorized
from robotapp_console.cluster.kinds import Kind

REFUSED_RETRY_S: Final = 15.0
"""A right that was granted shows after this long at the latest."""
CONFIRM_S: Final = 10.0
"""So long a kind that could be read must be refused before it counts as such: a server that starts refuses for a moment what it allows."""


class Feed:
    """Calls `changed` after every difference, also of `refusal` and `stale_since_s`, and `signed_out` when the token is not valid any more.

    `on_change` gets every change first and returns whether it makes a difference that the objects do not show.
    """

    def __init__(
        self,
        client: ApiClient,
        kind: Kind,
        namespace: str,
        *,
        changed: Callable[[], None],
        signed_out: Callable[[], None],
        on_change: Callable[[Change], bool] | None = None,
    ) -> None:
        self.kind = kind
        self.namespace = namespace
        self.refusal = ""
        """The API server's answer to who may not read the kind, or to whom it is not served."""
        self.is_absent = False
        """The cluster does not have the kind."""
        self.stale_since_s: float | None = None
        """Seconds since 1970 at which the server was heard last; None while the watch stands."""
        self.stale_why = ""
        self.settled = asyncio.Event()
        """The objects are known, or why they are not."""
        self._client = client
        self._changed = changed
        self._signed_out = signed_out
        self._on_change = on_change
        self._refused = asyncio.Event()
        self._refused_from_s: float | None = None
        self._started_s = time.time()
        self._reflector = self._make_reflector()

    def __repr__(self) -> str:
        return f"<Feed {self.kind.plural} of {self.namespace or 'all namespaces'}: {len(self.store)} objects>"

    @property
    def store(self) -> Mapping[str, Any]:
        """The objects by key."""
        return self._reflector.store

    async def run(self) -> None:
        """Follows the kind until cancelled. While it may not be read, it is tried again now and then."""
        while True:
            async with asyncio.TaskGroup() as tasks:
                mirror_task = tasks.create_task(self._reflector.run())
                sync_task = tasks.create_task(self._announce_sync())
                await self._refused.wait()
                mirror_task.cancel()
                sync_task.cancel()
            self._drop_objects()
            await asyncio.sleep(REFUSED_RETRY_S)
            self._refused.clear()

    def refuse(self, why: str) -> None:
        """Forgets the objects and ends the watch, which the API server lets go on although the right to it is gone."""
        self.refusal, self.is_absent = why, False
        self._note_contact()
        self._refused.set()
        self._changed()

    def _make_reflector(self) -> Reflector[Any]:
        return Reflector(
            self._client,
            self.kind.resource,
            as_type=self.kind.as_type,
            namespace=self.namespace or None,
            field_selector=self.kind.field_selector,
            on_change=self._take_change,
            kept=self.kind.kept,
            on_problem=self._take_problem,
        )

    def _drop_objects(self) -> None:
        """Forgets what may not be read any more."""
        if self._on_change is not None:
            for key, obj in self.store.items():
                self._on_change(Change("DELETED", key, obj, None))
        self._reflector = self._make_reflector()
        self._changed()

    async def _announce_sync(self) -> None:
        await self._reflector.synced.wait()
        self.refusal = ""
        self.settled.set()
        self._changed()

    def _take_change(self, change: Change) -> None:
        is_difference = self._on_change is not None and self._on_change(change)
        if is_difference or not self._is_repetition(change):
            self._changed()

    def _is_repetition(self, change: Change) -> bool:
        """Returns whether an object was written again with nothing that makes a difference to pages."""
        if change.old is None or change.new is None:
            return False
        return bool(self.kind.compared(change.old) == self.kind.compared(change.new))

    def _take_problem(self, problem: ClientError | None) -> None:
        if isinstance(problem, Unauthorized):
            self._signed_out()
        elif isinstance(problem, Forbidden | NotFound) and self._is_confirmed():
            self.refusal, self.is_absent = problem.message, isinstance(problem, NotFound)
            self._note_contact()
            self._refused.set()
        elif problem is None:
            self._note_contact()
        else:
            self._note_silence(problem)
        self.settled.set()
        self._changed()

    def _is_confirmed(self) -> bool:
        """Returns whether a refusal counts: it is the first answer ever, or has lasted."""
        now_s = time.monotonic()
        if self._refused_from_s is None:
            self._refused_from_s = now_s
        return not self._reflector.synced.is_set() or now_s - self._refused_from_s >= CONFIRM_S

    def _note_contact(self) -> None:
        self.stale_since_s, self.stale_why = None, ""
        self._refused_from_s = None

    def _note_silence(self, problem: ClientError) -> None:
        """Keeps since when nothing was heard, and why; what was known stays."""
        if not isinstance(problem, Forbidden | NotFound):
            self._refused_from_s = None
        if self.stale_since_s is None:
            silence_s = self._reflector.last_contact_s
            self.stale_since_s = time.time() - silence_s if isfinite(silence_s) else self._started_s
            self.stale_why = str(problem)
