"""Connections of our own against a server that answers byte for byte what a test says."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from tests.support.clients import until
from tests.support.scripted import Play, ScriptedServer

from robotapp_client.transport.connect import NotSentError
from robotapp_client.transport.http11 import Answer, BrokenError
from robotapp_client.transport.http_transport import HttpTransport
from robotapp_client.transport.kubeconfig import Endpoint
from robotapp_client.transport.pool import Connections

REQUEST = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
OK = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\nRetry-After: 7\r\n\r\nok"


def in_pieces(answer: bytes | None) -> Play:
    """An answer in which a bar stands for a pause between two packets; None closes the connection instead."""

    async def play(writer: asyncio.StreamWriter) -> None:
        for piece in (answer or b"").split(b"|"):
            writer.write(piece)
            await writer.drain()
            await asyncio.sleep(0)
        if answer is None:
            writer.close()

    return play


class Script(ScriptedServer):
    """Each request gets the next answer, OK when there is none left; "" is never answered."""

    def __init__(self, *answers: bytes | None) -> None:
        super().__init__(*map(in_pieces, answers), otherwise=in_pieces(OK))


@asynccontextmanager
async def talking_to(script: Script, *, limit: int = 4) -> AsyncIterator[Connections]:
    async with script:
        connections = Connections(script.endpoint, limit=limit)
        try:
            yield connections
        finally:
            await connections.close()


async def ask(connections: Connections, *, timeout_s: float = 60.0) -> Answer:
    return await connections.request(REQUEST, timeout_s=timeout_s)


@pytest.mark.parametrize(
    ("raw", "status", "body"),
    [
        (OK, 200, b"ok"),
        (b"HTTP/1.1 200 OK\r\nContent-|Length: 4\r\n\r\na|b|c|d", 200, b"abcd"),
        (b"HTTP/1.1 201 Created\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n|2\r\nde\r\n0\r\n\r\n", 201, b"abcde"),
        (b"HTTP/1.1 204 No Content\r\n\r\n", 204, b""),
        (b"HTTP/1.1 100 Continue\r\n\r\n" + OK, 200, b"ok"),
        (b"HTTP/1.1 409 Conflict\r\nContent-Length: 1\r\n\r\nx", 409, b"x"),
    ],
)
async def test_an_answer_is_read_however_it_is_framed_and_the_connection_used_again(
    raw: bytes, status: int, body: bytes
) -> None:
    script = Script(raw, OK)
    async with talking_to(script) as connections:
        answer = await ask(connections)
        assert (answer.status, answer.body) == (status, body)
        assert (await ask(connections)).headers["retry-after"] == "7"
    assert script.connections == 1


async def test_headers_are_found_in_any_case_and_absent_ones_are_none() -> None:
    async with talking_to(Script()) as connections:
        headers = (await ask(connections)).headers
    assert headers.get("RETRY-AFTER") == "7"
    assert headers.get("x-other") is None
    assert sorted(headers) == ["content-length", "retry-after"]


@pytest.mark.parametrize(
    ("raw", "found"),
    [
        (OK, {"content-length": "2", "retry-after": "7"}),
        (b"HTTP/1.1 200 OK\r\nConten|t-Length: 2\r\nA: b\r|\n\r\no|k", {"content-length": "2", "a": "b"}),
        (b"HTTP/1.1 103 Early Hints\r\nLink: x\r\n\r\n" + OK, {"content-length": "2", "retry-after": "7"}),
        (b"HTTP/1.1 103 Early Hints\r\nLink: x\r\n\r\n|" + OK, {"content-length": "2", "retry-after": "7"}),
        (b"HTTP/1.1 204 No Content\r\n\r\n" + OK, {}),
        (b"HTTP/1.1 204 No Content\r\n\r\nno HTTP", {}),
    ],
    ids=["at once", "in pieces", "announced", "announced before", "another after it", "garbage after it"],
)
async def test_headers_are_those_of_the_answer_however_its_bytes_arrive(raw: bytes, found: dict[str, str]) -> None:
    async with talking_to(Script(raw)) as connections:
        assert dict((await ask(connections)).headers) == found


@pytest.mark.parametrize(
    "first",
    [
        b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\nConnection: close\r\n\r\nok",
        b"HTTP/1.0 200 OK\r\nContent-Length: 2\r\n\r\nok",
        OK + b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nnot",
    ],
    ids=["close", "HTTP/1.0", "more than asked for"],
)
async def test_a_connection_that_is_not_to_be_used_again_is_not(first: bytes) -> None:
    script = Script(first, OK)
    async with talking_to(script) as connections:
        assert (await ask(connections)).body == b"ok"
        await until(lambda: "0 idle" in repr(connections))
        assert (await ask(connections)).body == b"ok"
    assert script.connections == 2


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (None, "closed the connection"),
        (b"SSH-2.0-OpenSSH\r\n\r\n", "is no HTTP"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\nhalf", "no answer within"),
        (b"", "no answer within"),
    ],
    ids=["closed", "garbage", "half", "silent"],
)
async def test_without_a_whole_answer_the_request_is_broken_and_the_next_one_starts_anew(
    raw: bytes | None, text: str
) -> None:
    script = Script(raw, OK)
    async with talking_to(script) as connections:
        with pytest.raises(BrokenError, match=text):
            await ask(connections, timeout_s=0.2 if "no answer" in text else 60.0)
        assert (await ask(connections)).body == b"ok"
    assert script.connections == 2


async def test_a_server_that_is_not_there_was_sent_nothing() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    connections = Connections(Endpoint(f"http://127.0.0.1:{port}"), limit=1)
    for _ in range(3):  # a failed attempt gives its place back
        with pytest.raises(NotSentError, match="cannot connect"):
            await ask(connections)
    await connections.close()


async def test_who_finds_all_connections_busy_waits_in_line_and_no_longer_than_its_time() -> None:
    script = Script(b"", OK)
    async with talking_to(script, limit=1) as connections:
        slow = asyncio.create_task(ask(connections, timeout_s=1))  # far from the other's, whatever the machine does
        await until(lambda: script.seen)
        with pytest.raises(NotSentError, match="no free connection"):
            await ask(connections, timeout_s=0.05)
        patient = asyncio.create_task(ask(connections))
        with pytest.raises(BrokenError):
            await slow
        assert (await patient).body == b"ok"
    assert len(script.seen) == 2


async def test_what_is_no_longer_permitted_when_its_turn_comes_is_not_sent() -> None:
    script = Script(b"", OK)
    async with talking_to(script, limit=1) as connections:
        slow = asyncio.create_task(ask(connections))
        await until(lambda: script.seen)
        allowed = [True]
        waits = asyncio.create_task(connections.request(REQUEST, timeout_s=60.0, permitted=lambda: allowed[0]))
        await until(lambda: "1 waiting" in repr(connections))
        allowed[0] = False
        slow.cancel()
        with pytest.raises(NotSentError, match="no longer permitted"):
            await waits
        assert (await ask(connections)).body == b"ok"
    assert len(script.seen) == 2


async def test_a_request_that_is_cancelled_ends_its_connection_and_the_next_one_starts_anew() -> None:
    script = Script(b"", OK)
    async with talking_to(script, limit=1) as connections:
        given_up = asyncio.create_task(ask(connections))
        await until(lambda: script.seen)
        patient = asyncio.create_task(ask(connections))
        await asyncio.sleep(0)
        given_up.cancel()
        results = await asyncio.gather(given_up, patient, return_exceptions=True)
        assert isinstance(results[0], asyncio.CancelledError)
        assert isinstance(results[1], Answer)
    assert script.connections == 2


async def test_who_waits_in_line_when_the_client_is_closed_is_told_that_nothing_was_sent() -> None:
    script = Script(b"")
    async with talking_to(script, limit=1) as connections:
        first, second = (asyncio.create_task(ask(connections)) for _ in range(2))
        await until(lambda: script.seen)
        await connections.close()
        results = await asyncio.gather(first, second, return_exceptions=True)
    assert [type(result) for result in results] == [BrokenError, NotSentError]
    assert len(script.seen) == 1


async def test_a_client_closed_while_it_connects_sends_nothing() -> None:
    script = Script()
    async with talking_to(script) as connections:
        early = asyncio.create_task(ask(connections))
        await asyncio.sleep(0)
        await connections.close()
        with pytest.raises(NotSentError):
            await early
    assert script.seen == []


async def test_the_next_in_line_is_sent_before_the_answer_is_looked_at() -> None:
    script = Script()
    async with talking_to(script, limit=1) as connections:
        seen: list[str] = []
        over = asyncio.Event()

        def told(_outcome: object) -> None:
            seen.append(repr(connections).partition(": ")[2])
            if len(seen) == 3:
                over.set()

        for _ in range(3):
            connections.send(REQUEST, told, timeout_s=60.0)
        await over.wait()
    assert seen == ["1 busy, 0 idle, 1 waiting>", "1 busy, 0 idle, 0 waiting>", "0 busy, 1 idle, 0 waiting>"]


async def test_requests_of_many_patiences_each_get_their_own_time_from_one_timer() -> None:
    patiences = (0.3, 0.1, 0.4, 0.2)
    script = Script(*[OK] * len(patiences), *[b""] * len(patiences))
    async with talking_to(script) as connections:
        await asyncio.gather(*(ask(connections) for _ in patiences))  # connecting takes its time on a busy machine
        began_s = time.monotonic()
        ended: dict[float, float] = {}

        async def fail(timeout_s: float) -> None:
            with pytest.raises(BrokenError, match=f"within {timeout_s:g} s"):
                await ask(connections, timeout_s=timeout_s)
            ended[timeout_s] = time.monotonic() - began_s

        await asyncio.gather(*(fail(timeout_s) for timeout_s in patiences))
    assert sorted(ended) == sorted(patiences)
    assert all(seconds >= timeout_s - 0.01 for timeout_s, seconds in ended.items())
    assert script.connections == len(patiences)


async def test_a_cancelled_waiter_passes_its_place_on() -> None:
    script = Script(b"", OK, OK)
    async with talking_to(script, limit=1) as connections:
        first = asyncio.create_task(ask(connections))
        await until(lambda: script.seen)
        impatient, patient = (asyncio.create_task(ask(connections)) for _ in range(2))
        await until(lambda: "2 waiting" in repr(connections))
        impatient.cancel()
        first.cancel()
        results = await asyncio.gather(first, impatient, patient, return_exceptions=True)
        assert isinstance(results[1], asyncio.CancelledError)
        assert isinstance(results[2], Answer)
        assert repr(connections).endswith("0 busy, 1 idle, 0 waiting>")


async def test_many_requests_share_few_connections_and_each_gets_its_own_answer() -> None:
    numbered = [f"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\n{n:03}".encode() for n in range(100)]
    script = Script(*numbered)
    async with talking_to(script, limit=3) as connections:
        bodies = [answer.body for answer in await asyncio.gather(*(ask(connections) for _ in range(100)))]
    assert sorted(bodies) == [f"{n:03}".encode() for n in range(100)]
    assert script.connections == 3


async def test_an_idle_connection_that_grew_old_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    script = Script()
    async with talking_to(script) as connections:
        await ask(connections)
        monkeypatch.setattr("robotapp_client.transport.pool.KEEPALIVE_S", 0.0)
        await ask(connections)
    assert script.connections == 2


@pytest.mark.parametrize("path", ["/a b", "/a\r\nX: y", "/a\x00"])
async def test_a_path_can_never_carry_a_second_request(path: str) -> None:
    async with HttpTransport(Endpoint("http://127.0.0.1:1"), user_agent="x") as transport:
        with pytest.raises(ValueError, match="not an escaped path"):
            await transport.request("GET", path, timeout_s=1)


async def test_a_header_can_never_carry_a_second_one() -> None:
    async with HttpTransport(Endpoint("http://127.0.0.1:1"), user_agent="x\r\nY: z") as transport:
        with pytest.raises(ValueError, match="line break"):
            await transport.request("GET", "/", timeout_s=1)


def test_prefix_and_host_come_from_the_server() -> None:
    assert Connections(Endpoint("https://rancher.example/k8s/clusters/c-1"), limit=1).prefix == "/k8s/clusters/c-1"
    assert Connections(Endpoint("https://[::1]:6443"), limit=1).host_header == "[::1]:6443"
