"""A port that can be opened, and one that cannot."""

import socket
import ssl

import pytest
from aiohttp import ClientSession, web

from robotapp_client.serving.port import PortError, opened
from robotapp_client.serving.tls import TlsPort, loaded


def application() -> web.Application:
    async def hello(_: web.Request) -> web.Response:
        return web.Response(text="hello")

    app = web.Application()
    app.router.add_get("/", hello)
    return app


async def test_port_zero_takes_a_free_one_and_serves_over_tls() -> None:
    runner = await opened(application(), host="127.0.0.1", port=0, tls=(await loaded(TlsPort())).context)
    try:
        (address,) = runner.addresses
        unverified = ssl._create_unverified_context()  # noqa: S323 - the certificate was made a moment ago
        async with ClientSession() as http, http.get(f"https://127.0.0.1:{address[1]}/", ssl=unverified) as answer:
            assert await answer.text() == "hello"
    finally:
        await runner.cleanup()


async def test_a_port_that_is_taken_is_named_with_what_to_do() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(PortError, match=rf"{port}.*in use.*--health-port names another"):
            await opened(application(), host="127.0.0.1", port=port, tls=None)
