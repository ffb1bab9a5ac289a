"""The sockets of the probes on the loopback interface."""

import asyncio
import os
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

import pytest
from tests.support.agent.probes import OTHER_SECRET, SECRET, prober, request_of, ring

from robotapp_agent.probe.keys import KEPT_S, KeyRing
from robotapp_agent.probe.packets import REPLY, REQUEST, SIZE_BYTES, node_id, open_packet, seal
from robotapp_agent.probe.rounds import PROBES, Round, RoundResult
from robotapp_agent.shell.datagrams import READS_PER_S, address_of, arrival_ns
from robotapp_agent.shell.udp import PeerAddress, UdpProbes, slept_ns
from robotapp_testbed.processes.ports import free_ports

SECONDS = 0.5


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as tried:
            tried.bind(("::1", 0))
    except OSError:
        return False
    return True


@asynccontextmanager
async def listening(
    name: str = "b", *, keys: KeyRing | None = None, slept: Callable[[], int] = slept_ns
) -> AsyncIterator[tuple[UdpProbes, int]]:
    (port,) = free_ports(1)
    async with UdpProbes(own_name=name, keys=keys or ring(), port=port, slept_ns=slept) as probes:
        yield probes, port


@pytest.mark.parametrize("address", ["127.0.0.1", "127.0.0.77", "::1"])
async def test_a_node_is_measured_under_each_of_its_addresses(address: str) -> None:
    if ":" in address and not has_ipv6():
        pytest.skip("this machine has no IPv6: sysctl net.ipv6.conf.all.disable_ipv6=0")
    async with listening() as (probes, _):
        result = await all_answered(probes, PeerAddress("b", address))
    assert (result.peer, result.sent) == ("b", 10)
    assert result.p50_us
    assert result.p95_us
    assert 0 < result.p50_us <= result.p95_us < SECONDS * 1e6


@pytest.mark.parametrize("address", ["127.0.0.1", "127.0.0.77"])
async def test_a_reply_leaves_from_the_address_that_its_request_was_sent_to(address: str) -> None:
    async with listening() as (_, port):
        with asker() as file:
            file.sendto(request_of(prober()), (address, port))
            reply, source = await asyncio.to_thread(file.recvfrom, 2048)
    assert source == (address, port)
    assert len(reply) == SIZE_BYTES


async def test_another_node_at_the_address_or_another_key_is_unreachable() -> None:
    async with listening("b") as (probes, _):
        assert (await probes.round([PeerAddress("c", "127.0.0.1")], seconds=SECONDS)).silent == ("c",)
        (result,) = (await probes.round([PeerAddress("c", "127.0.0.1")], seconds=SECONDS)).results
    assert (result.p50_us, result.p95_us, result.jitter_us, result.loss_ppm) == (None, None, None, 1_000_000)


async def test_a_peer_without_a_usable_address_is_left_out_and_more_than_sixteen_are_cut_off() -> None:
    strange = [PeerAddress("x", text) for text in ("", "host.example", "127.0.0.1:80", "300.1.1.1", "10.0.0.1\n")]
    many = [PeerAddress(f"node-{index}", "127.0.0.1") for index in range(20)]
    async with listening() as (probes, _):
        assert await probes.round(strange, seconds=SECONDS) == Round()
        assert len((await probes.round(many, seconds=SECONDS)).silent) == 16


async def test_without_a_key_a_round_is_discarded() -> None:
    async with listening(keys=KeyRing()) as (probes, _):
        measured = await probes.round([PeerAddress("b", "127.0.0.1")], seconds=SECONDS)
    assert measured == Round(discarded="there is no probe key")


async def test_a_round_through_which_the_machine_slept_is_discarded() -> None:
    began_s = time.monotonic()

    def slept() -> int:
        return 3600 * 10**9 if time.monotonic() - began_s > SECONDS / 2 else 0

    async with listening(slept=slept) as (probes, _):
        assert (await probes.round([PeerAddress("c", "127.0.0.1")], seconds=SECONDS)).discarded == (
            "the machine was suspended for 3600 s"
        )
        await all_answered(probes, PeerAddress("b", "127.0.0.1"))


async def test_a_round_in_which_the_agent_stood_still_is_discarded() -> None:
    async with listening() as (probes, _):
        measuring = asyncio.ensure_future(probes.round([PeerAddress("c", "127.0.0.1")], seconds=SECONDS))
        await asyncio.sleep(0)
        time.sleep(2 * SECONDS + 1)  # noqa: ASYNC251 - the event loop is what stands still
        measured = await measuring
    assert measured.discarded.startswith("the agent stood still for ")


async def test_a_port_that_is_taken_is_named() -> None:
    async with listening() as (_, port):
        with pytest.raises(OSError, match=f"UDP port {port} of the probes cannot be opened: Address already in use"):
            async with UdpProbes(own_name="c", keys=ring(), port=port):
                pass


async def test_strangers_get_no_answer() -> None:
    stranger = prober(keys=ring(OTHER_SECRET))
    hostile = [os.urandom(SIZE_BYTES), request_of(stranger), request_of(prober("a"), "c"), b"", bytes(1400)]
    async with listening() as (_, port):
        with asker() as file:
            for number in range(20):
                for data in hostile:
                    file.sendto(data, ("127.0.0.1", port))
                good = request_of(prober(secret=bytes([number])))
                file.sendto(good, ("127.0.0.1", port))
                reply = await asyncio.to_thread(file.recv, 2048)
                opened = open_packet(reply, kind=REPLY, receiver=node_id("a"), keys=ring())
                assert opened
                assert (
                    seal(opened._replace(kind=REQUEST, sender=opened.receiver, receiver=opened.sender, held_us=0))
                    == good
                )


async def test_a_flood_by_one_who_knows_the_key_id_is_read_slowly_and_the_port_answers_again() -> None:
    request = request_of(prober())
    forged = request[:-1] + bytes([request[-1] ^ 1])
    async with listening() as (probes, port):
        with asker() as file:
            for _ in range(int(READS_PER_S) * 3):
                file.sendto(forged, ("127.0.0.1", port))
        await all_answered(probes, PeerAddress("b", "127.0.0.1"))


async def test_a_flood_by_a_stranger_keeps_no_place_in_the_queue() -> None:
    flood = [os.urandom(SIZE_BYTES) for _ in range(int(READS_PER_S) * 2)]
    sender = prober()
    async with listening() as (_, port), asyncio.timeout(60):
        with asker() as file:
            file.setblocking(False)
            while True:
                # A queue that the flood has filled has no place for what comes behind it.
                for data in (*flood, request_of(sender)):
                    file.sendto(data, ("127.0.0.1", port))
                with suppress(TimeoutError):
                    reply = await asyncio.wait_for(asyncio.get_running_loop().sock_recv(file, 2048), SECONDS)
                    assert len(reply) == SIZE_BYTES
                    return


async def test_a_key_is_answered_from_the_update_that_brings_it_to_the_one_that_drops_it() -> None:
    keys = ring(SECRET)
    async with listening(keys=keys) as (_, port):
        assert await answered(port, OTHER_SECRET, SECRET) == [SECRET]
        keys.update({"key-0": SECRET, "key-1": OTHER_SECRET}, now_s=1)
        assert await answered(port, OTHER_SECRET, SECRET) == [OTHER_SECRET, SECRET]
        for now_s in (2, 2 + KEPT_S):
            keys.update({"key-1": OTHER_SECRET}, now_s=now_s)
        assert await answered(port, SECRET, OTHER_SECRET) == [OTHER_SECRET]


async def test_the_port_is_free_after_the_block() -> None:
    async with listening() as (_, port):
        pass
    async with UdpProbes(own_name="b", keys=ring(SECRET), port=port):
        pass


@pytest.mark.parametrize(
    ("queued_ns", "arrived_ns"),
    [(0, 5000), (400, 4600), (-1, 5000), (3600 * 10**9, 5000), (-3600 * 10**9, 5000), (1_700_000_000 * 10**9, 5000)],
)
def test_a_wall_clock_that_jumped_moves_no_arrival(queued_ns: int, arrived_ns: int) -> None:
    wall_ns = 1_700_000_000 * 10**9
    assert arrival_ns(wall_ns - queued_ns, now_ns=5000, wall_ns=wall_ns) == arrived_ns


@pytest.mark.parametrize(
    ("text", "family"), [("10.0.0.1", socket.AF_INET), ("fd00::1", socket.AF_INET6), ("[fd00::1]", None), ("a", None)]
)
def test_the_family_of_an_address(text: str, family: socket.AddressFamily | None) -> None:
    found = address_of(text, 1)
    assert (found[0] if found else None) == family


async def answered(port: int, *secrets: bytes) -> list[bytes]:
    """The secrets of the replies when a prober with each of these sends a request, in order. The last one has to be answered."""
    found: list[bytes] = []
    with asker() as file:
        for secret in secrets:
            file.sendto(request_of(prober(keys=ring(secret), secret=os.urandom(16))), ("127.0.0.1", port))
        while secrets[-1] not in found:
            data = await asyncio.to_thread(file.recv, 2048)
            reply = open_packet(data, kind=REPLY, receiver=node_id("a"), keys=ring(SECRET, OTHER_SECRET))
            assert reply
            found.append(reply.key.secret)
    return found


def asker() -> socket.socket:
    file = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    file.settimeout(60)
    return file


async def all_answered(probes: UdpProbes, peer: PeerAddress) -> RoundResult:
    """The first round without a loss: other programs of this machine can hold ours up for longer than a reply may take."""
    async with asyncio.timeout(60):
        while True:
            for result in (await probes.round([peer], seconds=SECONDS)).results:
                if result.answered == PROBES:
                    return result
