"""A port that can be opened, and one that cannot."""

import asyncio
import gzip
import socket
import ssl

import pytest
from aiohttp import ClientError, ClientSession, web
from tests.support.clients import until

from robotapp_client.serving.port import Limits, PortError, open_port
from robotapp_client.serving.tls import TlsPort, loaded


def application() -> web.Application:
    async def hello(_: web.Request) -> web.Response:
        return web.Response(text="hello")

    app = web.Application()
    app.router.add_get("/", hello)
    return app


async def test_port_zero_takes_a_free_one_and_serves_over_tls() -> None:
    served = await open_port(application(), host="127.0.0.1", port=0, tls=(await loaded(TlsPort())).current)
    try:
        unverified = ssl._create_unverified_context()  # noqa: S323 - the certificate was made a moment ago
        async with ClientSession() as http, http.get(f"https://127.0.0.1:{served.number}/", ssl=unverified) as answer:
            assert await answer.text() == "hello"
    finally:
        await served.close()


async def test_a_port_that_is_taken_is_named_with_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(PortError, match=rf"{port}.*in use.*--health-port names another"):
            await open_port(application(), host="127.0.0.1", port=port, tls=None)


async def test_a_handler_that_takes_too_long_is_cancelled_with_its_connection() -> None:
    ends: list[str] = []

    async def wait_for_ever(_: web.Request) -> web.Response:
        try:
            await asyncio.Event().wait()
        finally:
            ends.append("cancelled")
        return web.Response()

    app = application()
    app.router.add_post("/slow", wait_for_ever)
    served = await open_port(app, host="127.0.0.1", port=0, tls=None, limits=Limits(answer_s=0.1))
    try:
        async with ClientSession() as http:
            with pytest.raises(ClientError):
                await http.post(f"http://127.0.0.1:{served.number}/slow")
            await until(lambda: ends == ["cancelled"])
            async with http.get(f"http://127.0.0.1:{served.number}/") as answer:
                assert await answer.text() == "hello"
    finally:
        await served.close()


async def test_an_answered_request_counts_no_longer_and_its_connection_serves_the_next_one() -> None:
    served = await open_port(application(), host="127.0.0.1", port=0, tls=None, limits=Limits(answer_s=0.2, head_s=0.2))
    try:
        async with ClientSession() as http:
            for _ in range(3):
                async with http.get(f"http://127.0.0.1:{served.number}/") as answer:
                    assert await answer.text() == "hello"
                assert served.connections == 1
                await asyncio.sleep(0.3)  # longer than any answer may take
    finally:
        await served.close()


async def test_a_body_that_was_made_small_stays_small() -> None:
    sizes: list[int] = []

    async def measure(request: web.Request) -> web.Response:
        sizes.append(len(await request.read()))
        return web.Response()

    app = application()
    app.router.add_post("/", measure)
    served = await open_port(app, host="127.0.0.1", port=0, tls=None)
    body = gzip.compress(bytes(1_000_000))
    try:
        async with ClientSession() as http:
            await http.post(f"http://127.0.0.1:{served.number}/", data=body, headers={"Content-Encoding": "gzip"})
        assert sizes == [len(body)]
    finally:
        await served.close()


@pytest.mark.parametrize("head", ["GET / HTTP/1.1\r\nX: " + 20_000 * "x", "GET / HTTP/1.1\r\n" + 1000 * "X: y\r\n"])
async def test_a_head_too_large_is_refused(head: str) -> None:
    served = await open_port(application(), host="127.0.0.1", port=0, tls=None, limits=Limits(head_s=60))
    reader, writer = await asyncio.open_connection("127.0.0.1", served.number)
    try:
        writer.write(head.encode())
        assert (await asyncio.wait_for(reader.read(), 10)).startswith(b"HTTP/1.0 400") or reader.at_eof()
    finally:
        writer.transport.abort()
        await served.close()
