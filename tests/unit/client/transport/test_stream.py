"""Streams over connections of their own, against a server that answers byte for byte what a test says."""

import asyncio
import itertools
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_client import Endpoint, Unreachable
from robotapp_client.transport import stream as streaming
from robotapp_client.transport.connect import Dialer
from robotapp_client.transport.stream import Streaming, Streams

REQUEST = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"
HEAD = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\nRetry-After: 7\r\n\r\n"
END = b"0\r\n\r\n"


def piece(data: bytes) -> bytes:
    return b"%x\r\n%s\r\n" % (len(data), data)


@asynccontextmanager
async def answered(*packets: bytes, hang: bool = False, silence_s: float = 5.0) -> AsyncIterator[Streaming]:
    """The stream of a server that sends these packets, one by one, and then closes the connection or says no more."""
    over = asyncio.Event()
    served: list[asyncio.Task[None]] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        served.append(cast("asyncio.Task[None]", asyncio.current_task()))
        with suppress(OSError, asyncio.IncompleteReadError):
            await reader.readuntil(b"\r\n\r\n")
            for packet in packets:
                writer.write(packet)
                await writer.drain()
                await asyncio.sleep(0)
            if hang:
                await over.wait()
        writer.close()
        with suppress(OSError):
            await writer.wait_closed()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        streams = Streams(Dialer(Endpoint(f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}")))
        try:
            async with streams.open(REQUEST, where="GET /x", silence_s=silence_s) as stream:
                yield stream
        finally:
            over.set()
            await streams.close()
            await asyncio.gather(*served)


async def everything(stream: Streaming) -> list[bytes]:
    taken: list[bytes] = []
    await stream.deliver(taken.extend)
    return taken


async def test_the_pieces_of_the_server_come_as_they_were_sent() -> None:
    async with answered(HEAD + piece(b"one\n") + piece(b"two\n"), piece(b"three\n") + END) as stream:
        assert (stream.status, stream.headers["retry-after"]) == (200, "7")
        assert await everything(stream) == [b"one\n", b"two\n", b"three\n"]
        assert "complete" in repr(stream)


@given(cuts=st.lists(st.integers(0, 120), max_size=6))
async def test_the_body_does_not_depend_on_how_the_bytes_arrive(cuts: list[int]) -> None:
    sent = HEAD + piece(b"one\n") + piece(b"two\n") + END
    edges = [0, *sorted(min(cut, len(sent)) for cut in cuts), len(sent)]
    async with answered(*(sent[start:end] for start, end in itertools.pairwise(edges))) as stream:
        assert await stream.read() == b"one\ntwo\n"


async def test_a_refusal_has_a_body_and_an_interim_answer_is_none() -> None:
    refusal = b"HTTP/1.1 410 Gone\r\nContent-Length: 4\r\n\r\ngone"
    async with answered(b"HTTP/1.1 100 Continue\r\n\r\n", refusal + b"more than was announced", hang=True) as stream:
        assert stream.status == 410
        assert await stream.read() == b"gone"


async def test_what_arrived_before_the_connection_broke_is_handed_on_first() -> None:
    async with answered(HEAD + piece(b"one\n") + b"9\r\nhalf") as stream:
        taken: list[bytes] = []
        with pytest.raises(Unreachable, match="GET /x: the server closed the connection"):
            await stream.deliver(taken.extend)
        assert taken == [b"one\n", b"half"]
        with pytest.raises(Unreachable):
            await stream.begin(REQUEST)


@pytest.mark.parametrize("packets", [(HEAD + piece(b"one\n"),), (HEAD, piece(b"one\n"))], ids=["before", "while"])
async def test_who_cannot_take_a_piece_is_told_so_and_gets_no_more(packets: tuple[bytes, ...]) -> None:
    taken: list[list[bytes]] = []

    def take(pieces: list[bytes]) -> None:
        taken.append(pieces)
        raise ValueError("no event")

    async with answered(*packets, *[piece(b"two\n")] * 3, hang=True) as stream:
        with pytest.raises(ValueError, match="no event"):
            await stream.deliver(take)
        await asyncio.wait_for(stream.lost, 60)
        assert len(taken) == 1


async def test_who_stopped_waiting_gets_no_more() -> None:
    taken: list[bytes] = []
    arrived = asyncio.Event()

    def take(pieces: list[bytes]) -> None:
        taken.extend(pieces)
        arrived.set()

    async with answered(HEAD + piece(b"one\n"), hang=True) as stream:
        reader = asyncio.create_task(stream.deliver(take))
        await arrived.wait()
        reader.cancel()
        await asyncio.gather(reader, return_exceptions=True)
        stream.data_received(piece(b"two\n"))
        assert taken == [b"one\n"]


async def test_silence_counts_from_the_last_byte() -> None:
    began_s = asyncio.get_running_loop().time()
    with pytest.raises(Unreachable, match=r"nothing was heard for 0\.1 s"):
        async with answered(HEAD, *[piece(b"tick\n")] * 3, hang=True, silence_s=0.1) as stream:
            await everything(stream)
    assert asyncio.get_running_loop().time() - began_s >= 0.09


@pytest.mark.parametrize("answer", [b"SSH-2.0-x\r\n\r\n", HEAD + b"no number\r\n"], ids=["head", "body"])
async def test_what_is_no_http_is_unreachable(answer: bytes) -> None:
    with pytest.raises(Unreachable, match="no HTTP"):
        async with answered(answer, hang=True) as stream:
            await everything(stream)


async def test_a_server_that_is_not_there_is_unreachable() -> None:
    streams = Streams(Dialer(Endpoint("http://127.0.0.1:9")))
    with pytest.raises(Unreachable, match="GET /x: cannot connect"):
        async with streams.open(REQUEST, where="GET /x", silence_s=1):
            pass


async def test_streams_that_were_closed_while_one_connects_read_nothing() -> None:
    async with answered(HEAD + END) as stream:
        assert stream.transport is not None
        host, port = stream.transport.get_extra_info("peername")
        streams = Streams(Dialer(Endpoint(f"http://{host}:{port}")))
        await streams.close()
        with pytest.raises(Unreachable, match="the client is closed"):
            async with streams.open(REQUEST, where="GET /x", silence_s=1):
                pass


async def test_the_server_waits_while_nobody_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streaming, "FULL_BYTES", 10_000)
    load = [piece(b"x" * 5000) for _ in range(2000)]
    async with answered(HEAD, *load, END, silence_s=0.2) as stream:
        await asyncio.sleep(0.5)  # longer than the silence that is allowed: it is us who do not listen
        assert stream._size < 1_000_000
        assert len(await stream.read()) == 10_000_000
