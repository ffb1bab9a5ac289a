"""The peers from EndpointSlices, on the API server made for unit tests."""

import asyncio
import random
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, cast

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, until
from tests.support.virtual_time import run_virtually

from robotapp_agent.shell.endpoints import Endpoints, Peer, is_address
from robotapp_client import ApiClient
from robotapp_client.api.resources import ENDPOINTSLICES


def endpoint(node: str | None, *addresses: str, zone: str = "", **conditions: bool) -> dict[str, Any]:
    found: dict[str, Any] = {"addresses": list(addresses), "conditions": conditions}
    return found | ({"nodeName": node} if node else {}) | ({"zone": zone} if zone else {})


def slice_of(name: str, *endpoints: dict[str, Any], service: str = "robotapp-agent") -> dict[str, Any]:
    return {
        "metadata": {"name": name, "namespace": "robots", "labels": {"kubernetes.io/service-name": service}},
        "addressType": "IPv4",
        "endpoints": list(endpoints),
    }


@asynccontextmanager
async def watching(*slices: dict[str, Any]) -> AsyncIterator[tuple[Endpoints, ApiClient, FakeApiServer]]:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        for each in slices:
            await client.create(ENDPOINTSLICES, each)
        yield Endpoints(client, namespace="robots", service="robotapp-agent", uniform=lambda: 0.0), client, api


async def test_peers_have_the_zone_and_the_addresses_of_both_families() -> None:
    four = slice_of("four", endpoint("robot-1", "10.0.0.1", zone="hall"), endpoint("edge-1", "10.0.0.2"))
    six = slice_of("six", endpoint("robot-1", "fd00::1", zone="hall"))
    other = slice_of("other", endpoint("robot-9", "10.0.0.9"), service="database")
    async with watching(four, six, other) as (peers, _, _):
        await peers.refresh()
        assert set(peers.peers) == {"robot-1", "edge-1"}
        assert peers.peers["robot-1"].zone == "hall"
        assert set(peers.peers["robot-1"].addresses) == {"10.0.0.1", "fd00::1"}
        assert peers.peers["edge-1"] == Peer("", ("10.0.0.2",))
        assert peers.nodes == 2


async def test_an_agent_that_is_not_ready_is_a_peer_and_one_that_ends_stands_behind_its_successor() -> None:
    old = endpoint("robot-1", "10.0.0.1", terminating=True, ready=False)
    new = endpoint("robot-1", "10.0.0.2", terminating=False, ready=False)
    async with watching(slice_of("a", old, new)) as (peers, _, _):
        await peers.refresh()
        assert peers.peers["robot-1"].addresses == ("10.0.0.2", "10.0.0.1")


async def test_entries_without_a_node_or_with_what_is_no_address_are_left_out() -> None:
    bad = [endpoint(None, "10.0.0.1"), endpoint("x" * 300, "10.0.0.1"), endpoint("robot-1", "example", "fe80::1%eth0")]
    async with watching(slice_of("a", *bad, endpoint("robot-2"))) as (peers, _, _):
        await peers.refresh()
        assert peers.peers == {}


async def test_an_outage_leaves_the_last_list_in_use() -> None:
    async with watching(slice_of("a", endpoint("robot-1", "10.0.0.1"))) as (peers, _, api):
        await peers.refresh()
        kept = peers.peers
        asked = len(api.requests)
        api.failing = [500] * 4
        task = asyncio.create_task(peers.run())
        await until(lambda: len(api.requests) >= asked + 4)
        assert peers.peers is kept
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_the_size_of_the_cluster_is_known_from_one_small_request() -> None:
    many = [slice_of(f"s-{number}", endpoint(f"n-{number}", "10.0.0.1")) for number in range(7)]
    async with watching(*many) as (peers, _, api):
        before = len(api.requests)
        assert await peers.count() in (1, 700)  # the fake does not count what remains
        assert len(api.requests) == before + 1


async def test_after_each_list_the_agent_learns_of_it() -> None:
    async with watching(slice_of("a", endpoint("robot-1", "10.0.0.1"))) as (peers, _, _):
        told: list[int] = []
        peers.changed = lambda: told.append(peers.nodes)
        await peers.refresh()
        assert told == [1]


async def test_a_node_without_agent_is_looked_for_once() -> None:
    async with watching(slice_of("a", endpoint("robot-1", "10.0.0.1"))) as (peers, _, _):
        await peers.refresh()
        peers.look_for(["robot-1"])
        assert not peers._sooner.is_set()
        peers.look_for(["robot-1", "robot-2"])
        assert peers._sooner.is_set()
        peers._sooner.clear()
        peers.look_for(["robot-2"])
        assert not peers._sooner.is_set()
        peers.look_for(["robot-3"])
        assert peers._sooner.is_set()


def test_the_list_is_read_every_thirty_seconds_and_ten_after_the_last_time_when_an_agent_answers_no_longer() -> None:
    peers = Endpoints(None, namespace="robots", service="robotapp-agent", uniform=lambda: 0.0)  # type: ignore[arg-type]
    read_s: list[float] = []

    async def refresh() -> None:
        read_s.append(asyncio.get_running_loop().time())

    async def story() -> None:
        peers.refresh = refresh  # type: ignore[method-assign]
        task = asyncio.create_task(peers.run())
        await asyncio.sleep(65)
        peers.look_again()
        await asyncio.sleep(36)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    run_virtually(story())
    assert read_s == [0, 30, 60, 70, 100]


class Lists:
    """Stands for the client: counts the lists that agents read, in virtual time."""

    def __init__(self) -> None:
        self.begun: list[float] = []

    def pages(self, *_: object, **__: object) -> AsyncIterator[tuple[Any, bool]]:
        self.begun.append(asyncio.get_running_loop().time())
        return self._none()

    async def _none(self) -> AsyncIterator[tuple[Any, bool]]:
        return
        yield


def lists_of(agents: int, *, seconds: float, looking_from_s: float = 1e9) -> list[float]:
    """When agents that have just started, in a cluster of as many nodes, read the list."""

    async def story() -> list[float]:
        client, chance = Lists(), random.Random(1)
        found = [Endpoints(cast(Any, client), namespace="x", service="y", uniform=chance.random) for _ in range(agents)]
        for each in found:
            each.nodes = agents
            each.changed = lambda each=each: setattr(each, "nodes", agents)  # type: ignore[misc]
        tasks = [asyncio.create_task(each.run()) for each in found]
        await asyncio.sleep(min(seconds, looking_from_s))
        for each in found:
            each.look_for(["robot-1"])
        await asyncio.sleep(max(0.0, seconds - looking_from_s))
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return client.begun

    return run_virtually(story())


def test_agents_that_start_together_do_not_read_their_list_together() -> None:
    begun = lists_of(1000, seconds=120)
    assert len(begun) == pytest.approx(1000, rel=0.1)
    assert max(Counter(int(at_s / 10) for at_s in begun).values()) <= 10 * 8.4 * 1.5


def test_nor_do_agents_that_look_for_a_node_together() -> None:
    begun = lists_of(1000, seconds=45, looking_from_s=10)
    assert len(begun) >= 1000
    assert max(Counter(int(at_s) for at_s in begun).values()) <= 60


def test_in_a_small_cluster_the_list_is_read_at_once() -> None:
    assert max(lists_of(10, seconds=20)) <= 1.2


def test_addresses_are_those_of_both_families_without_a_zone() -> None:
    assert is_address("10.0.0.1")
    assert is_address("fd00::1")
    assert not any(map(is_address, ("", "edge-1", "10.0.0", "[fd00::1]", "fe80::1%eth0", "1\x00")))
