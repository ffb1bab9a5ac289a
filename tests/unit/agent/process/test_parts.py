"""Rounds of probes: who is probed where, and what becomes known, with a stand-in for the sockets."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import pytest
from tests.support.virtual_time import run_virtually

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.rounds import Round, RoundSummary
from robotapp_agent.process import parts
from robotapp_agent.process.parts import Rounds
from robotapp_agent.report.knowledge import Knowledge
from robotapp_agent.shell.endpoints import Peer
from robotapp_agent.shell.udp import PeerAddress


class Net:
    """Takes the place of UdpProbes. `dark` addresses do not answer; `discarded` rounds do not count."""

    def __init__(self) -> None:
        self.dark: set[str] = set()
        self.discarded = ""
        self.rounds: list[tuple[float, list[PeerAddress]]] = []
        self.refused: OSError | None = None
        self.looked_again = 0
        self._summary = RoundSummary()

    def __call__(self, **_: object) -> "Net":
        return self

    async def __aenter__(self) -> Self:
        if self.refused is not None:
            raise self.refused
        return self

    async def __aexit__(self, *_: object) -> None:
        return

    def look_again(self) -> None:
        self.looked_again += 1

    async def round(self, peers: Sequence[PeerAddress], *, seconds: float) -> Round:
        self.rounds.append((seconds, list(peers)))
        await asyncio.sleep(seconds)
        if self.discarded:
            return Round(discarded=self.discarded)
        return self._summary.round({peer.name: [None if peer.address in self.dark else 1000] * 10 for peer in peers})


PEERS = {"own": Peer("", ("10.0.0.1",)), "other": Peer("", ("10.0.0.2", "fd00::2"))}


@pytest.fixture
def net(monkeypatch: pytest.MonkeyPatch) -> Net:
    found = Net()
    monkeypatch.setattr(parts, "UdpProbes", found)
    return found


def rounds_of(net: Net, *, seconds: float, interval_s: int = 100, uniform: float = 1.0) -> tuple[Knowledge, Net]:
    knowledge = Knowledge(arch="arm64", realtime=False, seq=0, fixed_interval_s=interval_s)

    async def story() -> None:
        rounds = Rounds(
            "own", knowledge, lambda: None, peers=lambda: PEERS, look_again=net.look_again, uniform=lambda: uniform
        )
        task = asyncio.create_task(rounds.probe(KeyRing(), 7311))
        await asyncio.sleep(seconds)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    run_virtually(story())
    return knowledge, net


def test_the_first_round_is_short_and_the_others_take_an_interval(net: Net) -> None:
    knowledge, _ = rounds_of(net, seconds=130)
    assert [seconds for seconds, _ in net.rounds] == [10, 100, 100]
    assert knowledge.seq == 2
    assert [trip.peer for trip in knowledge.readings().round_trips or ()] == ["other"]


def test_the_second_round_is_shorter_by_chance(net: Net) -> None:
    rounds_of(net, seconds=130, uniform=0.25)
    assert [seconds for seconds, _ in net.rounds] == [10, 32.5, 100]


def test_a_peer_that_does_not_answer_is_probed_at_its_other_address(net: Net) -> None:
    net.dark = {"10.0.0.2"}
    knowledge, _ = rounds_of(net, seconds=130)
    assert [peers[0].address for _, peers in net.rounds] == ["10.0.0.2", "fd00::2", "fd00::2"]
    (trip,) = knowledge.readings().round_trips or ()
    assert trip.p50_us == 1000


def test_addresses_are_looked_for_after_the_first_round_without_an_answer_and_the_node_is_unreachable_after_the_second(
    net: Net,
) -> None:
    net.dark = {"10.0.0.2", "fd00::2"}
    knowledge, _ = rounds_of(net, seconds=50)
    assert (knowledge.readings().round_trips, net.looked_again) == ((), 1)
    net.rounds.clear()
    knowledge, _ = rounds_of(net, seconds=330)
    (trip,) = knowledge.readings().round_trips or ()
    assert trip.unreachable
    assert net.looked_again == 1


def test_a_round_that_is_discarded_counts_but_changes_no_round_trip(net: Net) -> None:
    net.discarded = "the machine was suspended for 90 s"
    knowledge, _ = rounds_of(net, seconds=130)
    assert knowledge.seq == 2
    assert knowledge.readings().round_trips == ()


def test_a_port_that_is_taken_leaves_the_agent_alive_without_round_trips(net: Net) -> None:
    net.refused = OSError(98, "UDP port 7311 of the probes cannot be opened: Address already in use")
    knowledge, _ = rounds_of(net, seconds=15)
    assert knowledge.seq == 1
    assert knowledge.readings().round_trips is None


async def test_keys_are_read_again_and_again(tmp_path: Path) -> None:
    (tmp_path / "key-1").write_bytes(b"k" * 32)
    ring = KeyRing()
    task = asyncio.create_task(parts.read_keys(ring, tmp_path))
    await asyncio.sleep(0)
    assert ring.signing is not None
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
