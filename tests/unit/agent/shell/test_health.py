"""The liveness check over real sockets."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from robotapp_agent.process.health import LIMITS, MOST_BYTES, Health
from robotapp_testbed.processes import ports


@asynccontextmanager
async def serving(silent: list[str]) -> AsyncIterator[int]:
    (port,) = ports.free_ports(1)
    task = asyncio.create_task(Health(lambda: silent).serve(port))
    for _ in range(1000):
        try:
            (await asyncio.open_connection("127.0.0.1", port))[1].close()
            break
        except ConnectionRefusedError:
            await asyncio.sleep(0.01)
    yield port
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def ask(port: int, request: bytes) -> bytes:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(request)
    try:
        return await reader.read()
    except ConnectionResetError:
        return b""
    finally:
        writer.close()


async def test_it_answers_while_all_parts_give_signs_of_life() -> None:
    silent: list[str] = []
    async with serving(silent) as port:
        assert (await ask(port, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")).startswith(b"HTTP/1.1 200 OK")
        silent.append("rounds")
        answer = await ask(port, b"GET /healthz HTTP/1.1\r\n\r\n")
        assert answer.startswith(b"HTTP/1.1 503")
        assert b"no sign of life from: rounds" in answer


@pytest.mark.parametrize(
    "request_", [b"GET / HTTP/1.1\r\n\r\n", b"POST /healthz HTTP/1.1\r\n\r\n", b"\x00\xff\r\n\r\n"]
)
async def test_nothing_else_is_here(request_: bytes) -> None:
    async with serving([]) as port:
        assert (await ask(port, request_)).startswith(b"HTTP/1.1 404")


async def test_a_request_without_an_end_gets_no_answer_and_harms_nobody() -> None:
    async with serving([]) as port:
        assert await ask(port, b"x" * (4 * MOST_BYTES)) == b""
        assert b"200 OK" in await ask(port, b"GET /healthz HTTP/1.1\r\n\r\n")


async def test_callers_that_keep_silent_do_not_keep_the_kubelet_from_its_answer() -> None:
    async with serving([]) as port:
        idle = [await asyncio.open_connection("127.0.0.1", port) for _ in range(3 * LIMITS.connections)]
        assert b"200 OK" in await ask(port, b"GET /healthz HTTP/1.1\r\n\r\n")
        for _, writer in idle:
            writer.close()
