"""Connections end with their client, also those whose server does not say goodbye."""

import asyncio
import socket
import ssl
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from tests.support.clients import client_for, until

from robotapp_client import ApiClient, Endpoint, Unreachable
from robotapp_testbed.control_plane.authority import Authority

HEAD = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n"


@contextmanager
def mute_server(folder: Path) -> Iterator[Endpoint]:
    """Over TLS: begins to answer each request and then neither reads nor writes, so no close is ever acknowledged."""
    authority = Authority()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*authority.server(folder, "localhost"))
    trusting = ssl.create_default_context(cadata=authority.pem)
    open_: list[ssl.SSLSocket] = []

    def serve() -> None:
        while True:
            connection, _ = listener.accept()
            if not connection.recv(1, socket.MSG_PEEK):  # the sign to end
                connection.close()
                return
            with suppress(OSError):  # a client that is cancelled is gone before we have answered
                open_.append(context.wrap_socket(connection, server_side=True))
                open_[-1].recv(65536)
                open_[-1].sendall(HEAD)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield Endpoint(f"https://localhost:{listener.getsockname()[1]}", trusting)
        finally:
            socket.create_connection(listener.getsockname()).close()
            thread.join()
            for connection in open_:
                connection.close()


def watched_sockets() -> int:
    """How many sockets the running loop still has to do with."""
    return len(asyncio.get_running_loop()._selector.get_map())  # type: ignore[attr-defined]  # no public way


async def read_for_ever(client: ApiClient, begun: asyncio.Event) -> None:
    async with client.stream("/watch", silence_s=60) as stream:
        begun.set()
        assert await stream.read() == b"", "the server never sends a byte"


async def cancelled_watch(client: ApiClient) -> None:
    begun = asyncio.Event()
    watch = asyncio.create_task(read_for_ever(client, begun))
    await begun.wait()
    watch.cancel()
    await asyncio.gather(watch, return_exceptions=True)


async def cancelled_request(client: ApiClient) -> None:
    idle = watched_sockets()
    request = asyncio.create_task(client.request("GET", "/"))
    await until(lambda: watched_sockets() > idle)
    request.cancel()
    await asyncio.gather(request, return_exceptions=True)


async def timed_out_request(client: ApiClient) -> None:
    with pytest.raises(Unreachable):
        await client.request("GET", "/")


@pytest.mark.parametrize("use", [cancelled_watch, cancelled_request, timed_out_request])
async def test_a_closed_client_leaves_no_connection_whatever_ended_its_calls(
    tmp_path: Path, use: Callable[[ApiClient], Awaitable[None]]
) -> None:
    before = watched_sockets()
    with mute_server(tmp_path) as endpoint:
        async with client_for(endpoint, timeout_s=0.4) as client:
            await use(client)
        assert watched_sockets() == before


async def test_a_client_closed_under_an_open_watch_leaves_no_connection(tmp_path: Path) -> None:
    before = watched_sockets()
    with mute_server(tmp_path) as endpoint:
        async with client_for(endpoint) as client:
            begun = asyncio.Event()
            watch = asyncio.create_task(read_for_ever(client, begun))
            await begun.wait()
        assert watched_sockets() == before
        with pytest.raises(Unreachable):
            await watch
