"""HTTP/1.1 for servers of tests: a request in, an answer or the chunks of a watch out, without a coroutine in between."""

import asyncio
import time
from collections.abc import Callable
from email.utils import formatdate
from functools import lru_cache
from typing import Any, Final

import httptools

FULL_BYTES: Final = 1 << 20
JSON_CONTENT: Final = b"Content-Type: application/json\r\n"


@lru_cache(maxsize=1)
def format_date_line(second: int) -> bytes:
    """Returns the header Date for a second since 1970. Agents read their clock's offset from it."""
    return f"Date: {formatdate(second, usegmt=True)}\r\n".encode()


class Connection(asyncio.Protocol):
    """The connection of one client; methods named on_… are called by the parser.

    `on_request` gets the connection, the method, the URL and the body of each request and writes the answer; `on_close`
    gets the connection when it has ended.
    """

    def __init__(
        self, on_request: Callable[[Any, str, str, bytes], None], on_close: Callable[[Any], None] = lambda _: None
    ) -> None:
        self._on_request = on_request
        self._on_close = on_close
        self._parser = httptools.HttpRequestParser(self)
        self._url = b""
        self._body: list[bytes] = []
        self.transport: Any = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport

    def connection_lost(self, _: Exception | None) -> None:
        self._on_close(self)

    @property
    def full(self) -> bool:
        """Whether the client does not keep up."""
        return bool(self.transport.get_write_buffer_size() > FULL_BYTES)

    def abort(self) -> None:
        """Cuts the connection, if there is one yet."""
        if self.transport is not None:
            self.transport.abort()

    def data_received(self, data: bytes) -> None:
        self._parser.feed_data(data)

    def on_url(self, url: bytes) -> None:
        self._url += url

    def on_body(self, body: bytes) -> None:
        self._body.append(body)

    def on_message_complete(self) -> None:
        url, body = self._url.decode(), b"".join(self._body)
        self._url, self._body = b"", []
        self._on_request(self, self._parser.get_method().decode(), url, body)

    def reply(self, status: int, body: bytes) -> None:
        head = b"HTTP/1.1 %d X\r\n" + JSON_CONTENT + format_date_line(int(time.time())) + b"Content-Length: %d\r\n\r\n"
        self.transport.write(head % (status, len(body)) + body)

    def begin_stream(self) -> None:
        self.transport.write(b"HTTP/1.1 200 OK\r\n" + JSON_CONTENT + b"Transfer-Encoding: chunked\r\n\r\n")

    def event(self, kind: bytes, obj: bytes) -> None:
        self.chunk(b'{"type":"%s","object":%s}\n' % (kind, obj))

    def chunk(self, data: bytes) -> None:
        self.transport.write(b"%x\r\n%s\r\n" % (len(data), data))

    def end_stream(self) -> None:
        self.transport.write(b"0\r\n\r\n")


class TypedConnection(Connection):
    """A connection whose `content_type` and `authorization` are those of the request at hand."""

    content_type = ""
    authorization = ""

    def on_message_begin(self) -> None:
        self.content_type = self.authorization = ""

    def on_header(self, name: bytes, value: bytes) -> None:
        match name.lower():
            case b"content-type":
                self.content_type = value.decode()
            case b"authorization":
                self.authorization = value.decode("utf-8", "replace")
