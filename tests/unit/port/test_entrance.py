"""Bodies: each user's turn comes first, each has a deadline, and all together have a budget."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

import pytest
from aiohttp import web
from tests.support.clients import until

from robotapp_client.serving.access import TooManyError
from robotapp_client.serving.port import open_port
from robotapp_scheduler.port.entrance import BodyError, Entrance, limit_pieces, refuse

MOST = 1000
Uploads = Callable[[str, bytes, int], Awaitable[asyncio.StreamReader]]


class Page:
    """A page that takes bodies of the user that a header names, and answers when it may."""

    def __init__(self, entrance: Entrance) -> None:
        self.entrance = entrance
        self.bodies: list[bytes] = []
        self.open = asyncio.Event()
        self.open.set()

    async def answer(self, request: web.Request) -> web.Response:
        try:
            async with self.entrance.admit(request.headers["User"], request, most=MOST) as body:
                self.bodies.append(body)
                await self.open.wait()
        except (TooManyError, BodyError) as error:
            return refuse(error)
        return web.Response(text="done")


@asynccontextmanager
async def opened(page: Page) -> AsyncIterator[Uploads]:
    """Begins uploads: a user, the bytes that are sent, and the length that is promised."""
    app = web.Application()
    app.router.add_post("/", page.answer)
    port = await open_port(app, host="127.0.0.1", port=0, tls=None)
    writers: list[asyncio.StreamWriter] = []

    async def begin(user: str, body: bytes, length: int) -> asyncio.StreamReader:
        reader, writer = await asyncio.open_connection("127.0.0.1", port.number)
        writers.append(writer)
        writer.write(f"POST / HTTP/1.1\r\nHost: x\r\nUser: {user}\r\nContent-Length: {length}\r\n\r\n".encode() + body)
        return reader

    try:
        yield begin
    finally:
        for writer in writers:
            writer.transport.abort()
        await port.close()


async def read_status(answer: asyncio.StreamReader) -> int:
    line = await asyncio.wait_for(answer.readline(), 10)
    return int(line.split()[1])


async def test_a_whole_body_is_let_in_and_counts_until_it_is_answered() -> None:
    page = Page(Entrance())
    page.open.clear()
    async with opened(page) as begin:
        answer = await begin("amy", b"x" * 10, 10)
        await until(lambda: page.bodies == [b"x" * 10])
        assert page.entrance.held == 10
        page.open.set()
        assert await read_status(answer) == 200
        assert page.entrance.held == 0


async def test_a_users_second_request_is_refused_before_its_body_is_read() -> None:
    page = Page(Entrance())
    async with opened(page) as begin:
        await begin("eve", b"x", MOST)
        await until(lambda: page.entrance.held == 1)
        assert await read_status(await begin("eve", b"", MOST)) == 429
        assert await read_status(await begin("amy", b"x", 1)) == 200


async def test_a_body_that_does_not_come_is_given_up() -> None:
    page = Page(Entrance(within_s=0.1))
    async with opened(page) as begin:
        assert await read_status(await begin("eve", b"x", MOST)) == 408
        assert page.entrance.held == 0
        assert await read_status(await begin("eve", b"x", 1)) == 200


@pytest.mark.parametrize("sent", [b"", b"x" * (MOST + 1)])
async def test_a_body_too_long_is_refused_by_its_promise(sent: bytes) -> None:
    page = Page(Entrance())
    async with opened(page) as begin:
        assert await read_status(await begin("eve", sent, MOST + 1)) == 413
    assert page.bodies == []


async def test_when_the_budget_is_full_the_oldest_body_that_is_not_complete_goes() -> None:
    page = Page(Entrance(budget=2 * MOST))
    async with opened(page) as begin:
        half = []
        for name in ("eve", "mallory"):
            half.append(await begin(name, b"x" * (MOST - 1), MOST))
            await until(lambda: page.entrance.held == len(half) * (MOST - 1))
        assert await read_status(await begin("amy", b"x" * 100, 100)) == 200
        assert await read_status(half[0]) == 429
        assert page.entrance.held == MOST - 1


async def test_bodies_that_are_being_answered_are_not_driven_out() -> None:
    page = Page(Entrance(budget=MOST))
    page.open.clear()
    async with opened(page) as begin:
        first = await begin("amy", b"x" * MOST, MOST)
        await until(lambda: len(page.bodies) == 1)
        assert await read_status(await begin("eve", b"x", 1)) == 429
        page.open.set()
        assert await read_status(first) == 200


async def test_the_pieces_of_a_body_that_is_passed_on_have_one_deadline_together() -> None:
    received = bytearray()

    async def pass_on(request: web.Request) -> web.Response:
        try:
            async for piece in limit_pieces(request.content, 0.2):
                received.extend(piece)
        except BodyError as error:
            return refuse(error)
        return web.Response()

    app = web.Application()
    app.router.add_post("/", pass_on)
    port = await open_port(app, host="127.0.0.1", port=0, tls=None)
    reader, writer = await asyncio.open_connection("127.0.0.1", port.number)
    try:
        writer.write(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 10\r\n\r\nabc")
        assert await read_status(reader) == 408
        assert received == b"abc"
    finally:
        writer.transport.abort()
        await port.close()


async def test_accounts_of_one_namespace_share_a_turn_and_people_have_one_each() -> None:
    entrance = Entrance()
    with entrance.take_turn("system:serviceaccount:tenant:a"), entrance.take_turn("alice"), entrance.take_turn("bob"):
        with pytest.raises(TooManyError), entrance.take_turn("system:serviceaccount:tenant:b"):
            pass
        with entrance.take_turn("system:serviceaccount:other:b"):
            pass
    with entrance.take_turn("system:serviceaccount:tenant:b"):
        pass
