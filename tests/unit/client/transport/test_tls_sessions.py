"""A second connection to the same server takes up the TLS session of the first."""

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from tests.support.clients import until

from robotapp_client import Endpoint
from robotapp_client.transport.connect import Dialer
from robotapp_client.transport.http11 import Answer, Connection, Exchange, Outcome
from robotapp_client.transport.tls_sessions import SessionResumption, with_resumption
from robotapp_testbed.control_plane.authority import Authority

ANSWER = b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n"


@asynccontextmanager
async def tls_server(folder: Path, authority: Authority, port: int = 0) -> AsyncIterator[int]:
    """Answers every request; gives its port."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while await reader.read(65536):
            writer.write(ANSWER)
        writer.close()

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*authority.server(folder, "localhost"))
    server = await asyncio.start_server(serve, "127.0.0.1", port, ssl=context)
    async with server:
        yield server.sockets[0].getsockname()[1]


async def connected(dialer: Dialer) -> Connection:
    """A connection that has carried a request."""
    loop = asyncio.get_running_loop()
    connection = await dialer.connect(lambda: Connection(loop, lambda _: None), timeout_s=60)
    ended: list[Outcome] = []
    request = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"
    connection.begin(Exchange(request, ended.append, timeout_s=60, deadline_s=loop.time() + 60))
    await until(lambda: bool(ended), what="the answer")
    assert isinstance(ended[0], Answer)
    return connection


def reused(connection: Connection) -> bool:
    assert connection.transport is not None
    return bool(connection.transport.get_extra_info("ssl_object").session_reused)


async def spoken_to(folder: Path, authority: Authority, context: ssl.SSLContext) -> int:
    """The port of a server that is gone again, whose session `context` remembers."""
    async with tls_server(folder, authority) as port:
        dialer = Dialer(Endpoint(f"https://localhost:{port}", context))
        await connected(dialer)
        assert reused(await connected(dialer))
        await dialer.close()
    return port


@pytest.fixture
def authority() -> Authority:
    return Authority()


@pytest.mark.parametrize(("taken_up", "expected"), [(True, [False, True, True]), (False, [False, False, False])])
async def test_who_was_spoken_to_before_is_not_proved_again(
    tmp_path: Path, authority: Authority, *, taken_up: bool, expected: list[bool]
) -> None:
    context = ssl.create_default_context(cadata=authority.pem)
    async with tls_server(tmp_path, authority) as port:
        dialer = Dialer(Endpoint(f"https://localhost:{port}", with_resumption(context) if taken_up else context))
        assert [reused(await connected(dialer)) for _ in range(3)] == expected
        await dialer.close()


async def test_a_connection_that_has_taken_a_session_up_is_not_asked_for_its_own(
    tmp_path: Path, authority: Authority, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[SessionResumption] = []
    remember = SessionResumption.remember
    monkeypatch.setattr(SessionResumption, "remember", lambda spoken: (asked.append(spoken), remember(spoken))[1])
    async with tls_server(tmp_path, authority) as port:
        context = with_resumption(ssl.create_default_context(cadata=authority.pem))
        dialer = Dialer(Endpoint(f"https://localhost:{port}", context))
        assert [reused(await connected(dialer)) for _ in range(4)] == [False, True, True, True]
        assert [spoken.session_reused for spoken in asked] == [False]
        await dialer.close()


async def test_a_server_that_has_forgotten_the_session_is_asked_to_prove_itself(
    tmp_path: Path, authority: Authority
) -> None:
    context = with_resumption(ssl.create_default_context(cadata=authority.pem))
    port = await spoken_to(tmp_path, authority, context)
    async with tls_server(tmp_path, authority, port):
        dialer = Dialer(Endpoint(f"https://localhost:{port}", context))
        assert not reused(await connected(dialer))
        await dialer.close()


async def test_a_stranger_who_takes_the_place_of_the_server_is_refused(tmp_path: Path, authority: Authority) -> None:
    context = with_resumption(ssl.create_default_context(cadata=authority.pem))
    port = await spoken_to(tmp_path, authority, context)
    async with tls_server(tmp_path, Authority(), port):
        dialer = Dialer(Endpoint(f"https://localhost:{port}", context))
        with pytest.raises(Exception, match="certificate verify failed"):
            await connected(dialer)
        await dialer.close()
