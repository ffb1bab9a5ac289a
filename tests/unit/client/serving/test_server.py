"""The server below our ports: how many connections there are, which goes, and how long each step may take."""

import asyncio
import socket
import ssl
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.clients import until

from robotapp_client.serving.server import (
    UNREAD_BYTES,
    Connection,
    Limits,
    Server,
    listen,
    read_counted_address,
    read_network,
)
from robotapp_client.serving.tls import TlsPort, loaded
from robotapp_testbed.control_plane.servers import unverified

OFTEN = {"new_per_s": 10_000.0, "new_at_once": 10_000}
NODE = "127.0.0.9"
Peer = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class Echo(asyncio.Protocol):
    """Answers each line; "work" is begun and never ended."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._transport: asyncio.BaseTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        if not data.endswith(b"\n"):
            return
        self._connection.begin()
        if data != b"work\n":
            assert isinstance(self._transport, asyncio.WriteTransport)
            self._transport.write(data)
            self._connection.end()


class Site:
    """A server, and callers that are gone when the test is over."""

    def __init__(self, server: Server, port: int) -> None:
        self.server = server
        self._port = port
        self._writers: list[asyncio.StreamWriter] = []

    async def dial(self, *, source: str = "127.0.0.1", tls: ssl.SSLContext | None = None) -> Peer:
        reader, writer = await asyncio.open_connection("127.0.0.1", self._port, local_addr=(source, 0), ssl=tls)
        self._writers.append(writer)
        return reader, writer

    async def close(self) -> None:
        for writer in self._writers:
            writer.transport.abort()
        await self.server.close()
        assert self.server.connections == 0


@asynccontextmanager
async def served(
    limits: Limits, *, tls: Callable[[], ssl.SSLContext] | None = None, node_addresses: Collection[str] = ()
) -> AsyncIterator[Site]:
    listener = await listen("127.0.0.1", 0)
    server = Server(Echo, limits, tls=tls, node_addresses=node_addresses)
    server.start(listener)
    site = Site(server, listener.getsockname()[1])
    try:
        yield site
    finally:
        await site.close()


async def say(peer: Peer, text: bytes) -> bytes:
    peer[1].write(text)
    return await hear(peer)


async def hear(peer: Peer) -> bytes:
    """What comes next; nothing when the connection is gone."""
    try:
        return await asyncio.wait_for(peer[0].read(100), 10)
    except ConnectionError:
        return b""


async def test_of_too_many_connections_the_oldest_that_is_not_being_answered_goes() -> None:
    async with served(Limits(connections=3, **OFTEN)) as site:
        busy = await site.dial()
        busy[1].write(b"work\n")
        silent = [await site.dial() for _ in range(2)]
        await until(lambda: site.server.connections == 3)
        newest = await site.dial()
        assert await say(newest, b"hello\n") == b"hello\n"
        assert await hear(silent[0]) == b""
        assert await say(silent[1], b"still here\n") == b"still here\n"
        assert site.server.connections == 3


async def test_who_holds_most_loses_first_so_that_a_crowd_cannot_drive_out_a_single_caller() -> None:
    async with served(Limits(connections=4, **OFTEN)) as site:
        kubelet = await site.dial(source="127.0.0.9")
        crowd = [await site.dial(source="127.0.0.2") for _ in range(20)]
        await until(lambda: site.server.connections == 4)
        assert await say(kubelet, b"healthy?\n") == b"healthy?\n"
        assert await hear(crowd[0]) == b""


async def crowd_of(site: Site, addresses: int) -> list[Peer]:
    """A connection from each of so many addresses."""
    return [await site.dial(source=f"127.0.1.{number}") for number in range(1, addresses + 1)]


async def test_a_crowd_of_addresses_cannot_drive_out_the_node() -> None:
    async with served(Limits(connections=8, **OFTEN), node_addresses={NODE}) as site:
        kubelet, stranger = await site.dial(source=NODE), await site.dial(source="127.0.0.3")
        await crowd_of(site, 20)
        await until(lambda: site.server.connections == 8)
        assert await say(kubelet, b"healthy?\n") == b"healthy?\n"
        assert await hear(stranger) == b""


async def test_the_node_takes_places_of_strangers_although_it_holds_more_than_each_of_them() -> None:
    async with served(Limits(connections=8, reserve=3, **OFTEN), node_addresses={NODE}) as site:
        await crowd_of(site, 8)
        probes = [await site.dial(source=NODE) for _ in range(3)]
        assert [await say(probe, b"healthy?\n") for probe in probes] == [b"healthy?\n"] * 3
        assert site.server.connections == 8


async def test_strangers_who_come_through_an_address_of_the_node_take_neither_all_places_nor_another_address_out() -> (
    None
):
    gateway = "127.0.0.8"
    async with served(Limits(connections=8, reserve=3, **OFTEN), node_addresses={NODE, gateway}) as site:
        kubelet = await site.dial(source=NODE)
        masked = [await site.dial(source=gateway) for _ in range(20)]
        crowd = await crowd_of(site, 20)
        await until(lambda: site.server.connections == 8)
        assert await say(kubelet, b"healthy?\n") == b"healthy?\n"
        assert await say(crowd[-1], b"hello\n") == b"hello\n"
        assert await hear(masked[0]) == b""


async def test_all_strangers_together_open_only_so_many_in_a_while_and_the_node_its_own() -> None:
    limits = Limits(new_per_s=0.001, new_at_once=1, strangers=3)
    async with served(limits, node_addresses={NODE}) as site:
        answers = [await say(peer, b"hello\n") for peer in await crowd_of(site, 5)]
        assert answers == [b"hello\n"] * 3 + [b""] * 2
        assert await say(await site.dial(source=NODE), b"hello\n") == b"hello\n"


async def test_one_read_takes_little_of_what_a_peer_has_sent() -> None:
    with await listen("127.0.0.1", 0) as listener, socket.create_connection(listener.getsockname()) as peer:
        listener.setblocking(True)
        peer.settimeout(0.2)
        accepted, _ = listener.accept()
        with accepted:
            with pytest.raises(TimeoutError):  # the kernel takes no more, and nobody reads
                peer.sendall(bytes(64 * UNREAD_BYTES))
            assert 0 < len(accepted.recv(64 * UNREAD_BYTES)) <= 2 * UNREAD_BYTES, (
                "the kernel doubles what it is asked for"
            )


def test_an_address_of_the_node_is_recognised_among_those_of_its_network() -> None:
    node = {"fd00::1", "10.0.0.1"}
    assert read_counted_address("fd00::1", node) == "fd00::1"
    assert read_counted_address("fd00::2", node) == read_counted_address("fd00::3", node) == "fd00::/64"
    assert read_counted_address("::ffff:10.0.0.1", node) == "10.0.0.1"
    assert read_counted_address("fe80::1%eth0", {"fe80::1"}) == "fe80::1"


async def test_one_address_opens_only_so_many_in_a_while_and_others_theirs() -> None:
    async with served(Limits(new_per_s=0.001, new_at_once=5)) as site:
        crowd = [await site.dial(source="127.0.0.2") for _ in range(8)]
        answers = [await say(peer, b"hello\n") for peer in crowd]
        assert answers == [b"hello\n"] * 5 + [b""] * 3
        assert await say(await site.dial(), b"hello\n") == b"hello\n"
        assert site.server.connections == 6


@pytest.mark.parametrize("text", [b"", b"no line"])
async def test_a_head_that_does_not_come_ends_the_connection(text: bytes) -> None:
    async with served(Limits(head_s=0.1)) as site:
        assert await say(await site.dial(), text) == b""


async def test_an_answer_that_does_not_come_ends_the_connection() -> None:
    async with served(Limits(answer_s=0.1)) as site:
        assert await say(await site.dial(), b"work\n") == b""


async def test_silence_after_an_answer_ends_the_connection_and_a_half_request_is_not_silence() -> None:
    async with served(Limits(head_s=0.1, idle_s=3600)) as site:
        peer = await site.dial()
        assert await say(peer, b"hello\n") == b"hello\n"
        assert await say(peer, b"no line") == b""
    async with served(Limits(head_s=3600, idle_s=0.1)) as site:
        peer = await site.dial()
        assert await say(peer, b"hello\n") == b"hello\n"
        assert await hear(peer) == b""


@pytest.mark.parametrize("text", [b"", bytes.fromhex("16030102000100"), b"GET / HTTP/1.1\r\n\r\n"])
async def test_a_handshake_that_is_not_completed_ends_the_connection(text: bytes) -> None:
    tls = (await loaded(TlsPort())).current
    async with served(Limits(handshake_s=0.2), tls=tls) as site:
        peer = await site.dial()
        peer[1].write(text)
        while await hear(peer):
            pass
        await until(lambda: site.server.connections == 0)


async def test_connections_in_their_handshake_count_and_go_like_others() -> None:
    tls = (await loaded(TlsPort())).current
    async with served(Limits(connections=3, **OFTEN), tls=tls) as site:
        crowd = [await site.dial() for _ in range(30)]
        await until(lambda: site.server.connections == 3)
        peer = await site.dial(tls=unverified())
        assert await say(peer, b"hello\n") == b"hello\n"
        assert site.server.connections == 3
        assert await hear(crowd[0]) == b""
        peer[1].close()


async def test_every_address_of_the_machine_is_served_and_counted_as_what_it_is() -> None:
    listener = await listen(None, 0)
    addresses: list[str] = []

    def note(connection: Connection) -> Echo:
        addresses.append(connection.address)
        return Echo(connection)

    server = Server(note, Limits())
    server.start(listener)
    site = Site(server, listener.getsockname()[1])
    try:
        assert await say(await site.dial(), b"hello\n") == b"hello\n"
        assert addresses == ["127.0.0.1"]
    finally:
        await site.close()


@given(st.ip_addresses(v=6), st.integers(0, 2**64 - 1))
def test_all_addresses_of_an_ipv6_host_are_one(address: object, host: int) -> None:
    low = (int(address) >> 64 << 64) | host  # type: ignore[call-overload]
    sibling = socket.inet_ntop(socket.AF_INET6, low.to_bytes(16, "big"))
    if not (sibling.startswith("::ffff:") or str(address).startswith("::ffff:")):
        assert read_network(str(address)) == read_network(sibling)
    assert read_network(f"{sibling}%eth0") == read_network(sibling)


def test_to_import_the_server_loads_neither_aiohttp_nor_the_rest_of_the_client() -> None:
    """It runs beside every robot."""
    code = "import sys, robotapp_client.serving.server; print(*(name for name in sys.modules if name.partition('.')[0] in {'robotapp_client', 'aiohttp', 'msgspec', 'yaml'}))"
    loaded_modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert set(loaded_modules.split()) == {
        "robotapp_client",
        "robotapp_client.serving",
        "robotapp_client.serving.node_addresses",
        "robotapp_client.serving.server",
    }
