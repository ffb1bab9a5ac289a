"""The way in for requests with a body: first the user's turn, then the body, within bytes and time.

Whoever may ask may also begin to ask and never end. So a user sends one body at a time, a body has a deadline, and all bodies
together have a budget. When that is full, the oldest body that is not complete goes: a complete one was sent in moments.
A page authenticates and authorises its caller, and then enters with `admit`.
"""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Final

from aiohttp import StreamReader, web

from robotapp_client.serving.access import TooManyError
from robotapp_client.serving.pages import problem, too_many

BODY_S: Final = 10.0
BUDGET_BYTES: Final = 8 << 20
CHUNK: Final = 1 << 16
ONE_AT_A_TIME: Final = (
    "another question of yours, or of an account in your namespace, is being answered; ask again later"
)
FULL: Final = "many questions are being answered; ask again later"
AGAIN_S: Final = 1.0
_ACCOUNT: Final = "system:serviceaccount:"


class BodyError(Exception):
    """The body is not taken; `status` is the HTTP status."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.status = status


class _Upload:
    """Bytes of one body. `deadline` while it is not complete."""

    def __init__(self) -> None:
        self.deadline: asyncio.Timeout | None = None
        self.size = 0
        self.is_driven_out = False

    def drive_out(self) -> None:
        """Ends its reader at once."""
        self.is_driven_out = True
        if self.deadline is not None:
            self.deadline.reschedule(asyncio.get_running_loop().time())
        self.deadline = None


class Entrance:
    """One for all pages of a port that read bodies."""

    def __init__(self, *, within_s: float = BODY_S, budget: int = BUDGET_BYTES) -> None:
        self._within_s = within_s
        self._budget = budget
        self._users: set[str] = set()
        self._uploads: dict[_Upload, None] = {}
        """The oldest first."""

    def __repr__(self) -> str:
        return f"<Entrance: {len(self._users)} users, {self.held} of {self._budget} bytes>"

    @property
    def held(self) -> int:
        """Bytes of all bodies, from their first one until they are answered."""
        return sum(upload.size for upload in self._uploads)

    @asynccontextmanager
    async def admit(self, user: str, request: web.Request, *, most: int) -> AsyncIterator[bytes]:
        """The body of a user's request, whose bytes count until the block ends. Raises TooManyError and BodyError."""
        with self.take_turn(user):
            if request.content_length is not None and request.content_length > most:
                raise BodyError(413, f"the body has more than {most >> 20} MiB")
            upload = _Upload()
            self._uploads[upload] = None
            try:
                yield await self._receive(upload, request.content, most)
            finally:
                del self._uploads[upload]

    @contextmanager
    def take_turn(self, user: str) -> Iterator[None]:
        """Gives one request of each user a turn, from before its body until its answer. Raises TooManyError.

        The accounts of a namespace share a turn: who may make one may make a hundred.
        """
        owner = user.rpartition(":")[0] if user.startswith(_ACCOUNT) else user
        if owner in self._users:
            raise TooManyError(ONE_AT_A_TIME, AGAIN_S)
        self._users.add(owner)
        try:
            yield
        finally:
            self._users.discard(owner)

    async def _receive(self, upload: _Upload, content: StreamReader, most: int) -> bytes:
        body = bytearray()
        try:
            async with asyncio.timeout(self._within_s) as upload.deadline:
                async for chunk in content.iter_chunked(CHUNK):
                    if len(body) + len(chunk) > most:
                        raise BodyError(413, f"the body has more than {most >> 20} MiB")
                    self._make_room(len(chunk), upload)
                    body += chunk
                    upload.size = len(body)
        except TimeoutError as error:
            if upload.is_driven_out:
                raise TooManyError(FULL, AGAIN_S) from error
            raise BodyError(408, f"the body was not there within {self._within_s:g} s") from error
        upload.deadline = None
        return bytes(body)

    def _make_room(self, size: int, newcomer: _Upload) -> None:
        """Drives out bodies that are not complete, the oldest first. Raises TooManyError when that is not enough."""
        for upload in list(self._uploads):
            if self.held + size <= self._budget:
                return
            if upload is not newcomer and upload.deadline is not None:
                upload.drive_out()
                upload.size = 0
        if self.held + size > self._budget:
            raise TooManyError(FULL, AGAIN_S)


async def limit_pieces(content: StreamReader, within_s: float) -> AsyncIterator[bytes]:
    """The pieces of a body that is passed on and never held. Raises BodyError when it is not there in time."""
    deadline_s = asyncio.get_running_loop().time() + within_s
    pieces = content.iter_chunked(CHUNK).__aiter__()
    while True:
        try:
            async with asyncio.timeout_at(deadline_s):
                piece = await anext(pieces)
        except StopAsyncIteration:
            return
        except TimeoutError as error:
            raise BodyError(408, f"the body was not there within {within_s:g} s") from error
        yield piece


def refuse(error: TooManyError | BodyError) -> web.Response:
    """Returns the response to a request that was not let in."""
    return too_many(error) if isinstance(error, TooManyError) else problem(error.status, str(error))
