"""HTTP/1.1 over kept-alive connections of our own: what a scheduler needs to write thousands of bindings per second.

A general client was most of the scheduler's CPU. The bytes of an answer are parsed by httptools (llhttp); ours is only
which request uses which connection (`pool`). Nothing is ever sent twice.
"""

import asyncio
import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping

import httptools
import msgspec

from robotapp_client.transport.connect import NotSentError, Speaker

Permitted = Callable[[], bool]


def always() -> bool:
    """Requests that nothing forbids."""
    return True


class BrokenError(Exception):
    """There is no complete answer; whether the request was executed is unknown."""


class TooLongError(BrokenError):
    """The answer is longer than the request allows."""


RawHeaders = list[tuple[bytes, bytes]]


class Headers(Mapping[str, str]):
    """Headers of an answer, decoded when they are read, which is seldom."""

    __slots__ = ("_found", "_read")

    def __init__(self, read: Callable[[], RawHeaders]) -> None:
        self._read = read
        self._found: dict[str, str] | None = None

    def _all(self) -> dict[str, str]:
        if self._found is None:
            self._found = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in self._read()}
        return self._found

    def __getitem__(self, name: str) -> str:
        return self._all()[name.lower()]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())


class Answer(msgspec.Struct, frozen=True):
    """A complete answer of any status; `start` is what arrived up to its first bytes."""

    status: int
    body: bytes
    start: list[bytes]

    @property
    def headers(self) -> Headers:
        """Case-insensitive."""
        return Headers(lambda: _Reading(self.start).found)


class _Reading:
    """Reads the headers of the first answer in `pieces` that is not a mere announcement ("100 Continue" and the like)."""

    def __init__(self, pieces: Iterable[bytes]) -> None:
        self.found: RawHeaders = []
        self._over = False
        self._parser = httptools.HttpResponseParser(self)
        with contextlib.suppress(httptools.HttpParserError):  # of what follows the headers
            self._parser.feed_data(b"".join(pieces))

    def on_header(self, name: bytes, value: bytes) -> None:
        if not self._over:
            self.found.append((name, value))

    def on_headers_complete(self) -> None:
        if self._over:
            return
        self._over = self._parser.get_status_code() >= 200
        if not self._over:
            self.found = []


Outcome = Answer | NotSentError | BrokenError


class Exchange(msgspec.Struct, eq=False):
    """One request and its callback: `done` is called once at the end, and must not raise.

    `dropped`: no caller waits for the end any more.
    """

    request: bytes
    done: Callable[[Outcome], None]
    timeout_s: float
    deadline_s: float
    permitted: Permitted = always
    dropped: bool = False
    most_bytes: int = 0
    """The longest body that is taken into memory; 0: of any length."""

    def __repr__(self) -> str:
        return f"<Exchange {self.request[:40]!r}{', dropped' if self.dropped else ''}>"

    def end(self, outcome: Outcome) -> None:
        """Call back the waiting caller."""
        if not self.dropped:
            self.dropped = True
            self.done(outcome)


class Connection(Speaker):
    """One connection; one request at a time. Methods named on_… are called by the parser.

    `free` is called when a request has ended, before its caller: the next in line loses no time.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, free: Callable[["Connection"], None]) -> None:
        super().__init__(loop)
        self._free = free
        self._parser = httptools.HttpResponseParser(self)
        self._answer: Answer | None = None
        self._start: list[bytes] = []
        self._body: list[bytes] = []
        self._taken_bytes = 0
        self.exchange: Exchange | None = None
        self.reusable = True
        self.idle_since_s = 0.0

    def __repr__(self) -> str:
        return f"<Connection {'reusable' if self.reusable else 'ended'}, {'busy' if self.exchange else 'idle'}>"

    def begin(self, exchange: Exchange) -> None:
        """Send; the connection must be reusable and idle."""
        if self.transport is None or self.exchange is not None:
            raise ValueError(f"{self} cannot carry {exchange}")
        self.exchange = exchange
        self.transport.write(exchange.request)

    def end(self) -> None:
        """Close at once; an answer on its way is not waited for."""
        self.reusable = False
        super().end()

    def fail(self, what: str) -> None:
        """Close at once; a caller that waits for an answer gets the error."""
        self._fail_with(BrokenError(what))

    def _fail_with(self, error: BrokenError) -> None:
        self.end()
        if self.exchange is not None:
            self._over(error)

    def _over(self, outcome: Answer | BrokenError) -> None:
        exchange, self.exchange = self.exchange, None
        self._free(self)
        if exchange is not None:
            exchange.end(outcome)

    # --- asyncio.Protocol ---------------------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        if self.exchange is None:  # no request is open: whatever this is, the next answer must not be mixed up with it
            self.end()
            return
        if not self._body:
            self._start.append(data)
        problem = ""
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserError as error:
            self.end()
            problem = f"the answer is no HTTP: {error}"
        answer, self._answer = self._answer, None
        most = self.exchange.most_bytes
        if 0 < most < (self._taken_bytes if answer is None else len(answer.body)):
            self._body = []
            self._fail_with(TooLongError(f"the answer is longer than {most} bytes"))
        elif answer is not None:
            self._over(answer)
        elif problem:
            self.fail(problem)

    # --- httptools ----------------------------------------------------------------------------------------------

    def on_message_begin(self) -> None:
        if self._answer is not None:
            self.end()  # one answer more than requests: it must not be taken for that of the next request

    def on_body(self, body: bytes) -> None:
        self._body.append(body)
        self._taken_bytes += len(body)

    def on_message_complete(self) -> None:
        status = self._parser.get_status_code()
        if status < 200:  # "100 Continue" and the like announce the answer
            return
        start, body = self._start, self._body
        self._start, self._body, self._taken_bytes = [], [], 0
        if not self._parser.should_keep_alive():
            self.reusable = False
        if self._answer is None:
            self._answer = Answer(status, b"".join(body), start)
