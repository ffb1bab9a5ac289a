"""The fault proxy does to a client what it says."""

from collections.abc import AsyncIterator, Iterator
from contextlib import suppress

import pytest
from tests.support.apiserver import FakeApiServer, Key
from tests.support.clients import client_for, configmap
from tests.support.proxy import (
    Fault,
    FaultProxy,
    Moment,
    Write,
    answer,
    delay,
    drop,
    garble,
    lose_reply,
    reset,
    truncate,
)

from robotapp_client import AlreadyExists, ApiClient, Conflict, NotFound, ServerError, TooManyRequests, Unreachable
from robotapp_client.api.resources import CONFIGMAPS, LEASES

KEY = Key("/configmaps", "default", "a")


@pytest.fixture
async def api() -> AsyncIterator[FakeApiServer]:
    async with FakeApiServer() as server:
        yield server


@pytest.fixture
def proxy() -> Iterator[FaultProxy]:
    with FaultProxy(seed=1) as started:
        yield started
    assert started.errors == []


@pytest.fixture
async def client(api: FakeApiServer, proxy: FaultProxy) -> AsyncIterator[ApiClient]:
    async with client_for(proxy.route("me", api.endpoint).endpoint) as connected:
        yield connected


async def test_without_faults_it_is_invisible(client: ApiClient, api: FakeApiServer) -> None:
    await client.create(CONFIGMAPS, configmap("a", x="1"))
    assert (await client.get(CONFIGMAPS, "a", namespace="default"))["data"] == {"x": "1"}
    assert KEY in api.store.objects
    with pytest.raises(NotFound):
        await client.get(CONFIGMAPS, "b", namespace="default")


@pytest.mark.parametrize(
    ("fault", "applied"),
    [
        (drop(), False),
        (lose_reply(), True),
        (reset(), False),
        (reset(applied=True), True),
        (truncate(), True),
        (garble(), True),
    ],
    ids=lambda value: value.name if isinstance(value, Fault) else str(value),
)
async def test_a_write_without_an_answer_says_that_it_may_have_been_applied(
    client: ApiClient, api: FakeApiServer, proxy: FaultProxy, fault: Fault, applied: bool
) -> None:
    proxy.add(fault, verbs="create")
    with pytest.raises(Unreachable) as caught:
        await client.create(CONFIGMAPS, configmap("a"))
    assert caught.value.maybe_applied
    assert (KEY in api.store.objects) is applied
    assert [write.applied for write in proxy.ledger.writes()] == [applied]


@pytest.mark.parametrize("applied", [False, True])
async def test_an_injected_error_is_an_answer(
    client: ApiClient, api: FakeApiServer, proxy: FaultProxy, applied: bool
) -> None:
    proxy.add(answer(504, "Timeout", applied=applied), verbs="write")
    with pytest.raises(ServerError) as caught:
        await client.create(CONFIGMAPS, configmap("a"))
    assert caught.value.maybe_applied
    assert (KEY in api.store.objects) is applied


async def test_retry_after_reaches_the_client(client: ApiClient, proxy: FaultProxy) -> None:
    proxy.add(answer(429, "TooManyRequests", retry_after_s=7), verbs="create")
    with pytest.raises(TooManyRequests) as caught:
        await client.create(CONFIGMAPS, configmap("a"))
    assert caught.value.retry_after_s == 7


async def test_a_delay_beyond_the_clients_patience_is_a_timeout(api: FakeApiServer, proxy: FaultProxy) -> None:
    endpoint = proxy.route("hasty", api.endpoint).endpoint
    proxy.add(delay(5), verbs="create")
    async with client_for(endpoint, timeout_s=0.1) as client:
        with pytest.raises(Unreachable) as caught:
            await client.create(CONFIGMAPS, configmap("a"))
    assert caught.value.maybe_applied


async def test_rules_choose_component_verb_resource_and_turn(
    api: FakeApiServer, client: ApiClient, proxy: FaultProxy
) -> None:
    proxy.add(drop(), component="somebody else", times=None)
    proxy.add(drop(), resource="secrets", times=None)
    proxy.add(drop(), verbs=["delete"], times=None)
    proxy.add(drop(), path="/no/such", times=None)
    proxy.add(drop(), when=lambda call: call.json().get("data") == {"x": "no"}, times=None)
    rule = proxy.add(lose_reply(), verbs="create", resource="configmaps", skip=1)
    await client.create(CONFIGMAPS, configmap("a"))
    with pytest.raises(Unreachable):
        await client.create(CONFIGMAPS, configmap("b"))
    await client.create(CONFIGMAPS, configmap("c"))
    assert rule.struck == 1
    with pytest.raises(Unreachable):
        await client.create(CONFIGMAPS, configmap("d", x="no"))
    proxy.clear()
    await client.delete(CONFIGMAPS, "a", namespace="default")
    assert [key.name for key in api.store.objects] == ["b", "c"]


async def test_chance_is_the_same_for_the_same_seed(api: FakeApiServer) -> None:
    struck = []
    for _ in range(2):
        with FaultProxy(seed=42) as proxy:
            async with client_for(proxy.route("me", api.endpoint).endpoint) as client:
                proxy.add(answer(409, "Conflict"), verbs="write", probability=0.5, times=None)
                for number in range(20):
                    with suppress(Conflict, AlreadyExists):
                        await client.create(CONFIGMAPS, configmap(f"{number}"))
            struck.append([write.fault for write in proxy.ledger.writes()])
    assert struck[0] == struck[1]
    assert 3 < struck[0].count("") < 17


async def test_the_ledger_counts_writes_but_not_leases(client: ApiClient, proxy: FaultProxy) -> None:
    await client.create(LEASES, {"metadata": {"name": "l", "namespace": "default"}})
    await client.create(CONFIGMAPS, configmap("a"))
    await client.patch(CONFIGMAPS, "a", {"data": {"x": "1"}}, namespace="default")
    writes = proxy.ledger.writes(component="me")
    assert [(write.index, write.call.verb, write.call.name, write.status) for write in writes] == [
        (1, "create", "a", 201),
        (2, "patch", "a", 200),
    ]
    assert writes[0].call.user_agent == "robotapp-test"
    assert len(proxy.ledger.writes(routine=True)) == 3
    assert proxy.ledger.writes(resource="configmaps", verb="patch", applied=True) == [writes[1]]


async def test_hooks_see_each_write_before_and_after(client: ApiClient, proxy: FaultProxy) -> None:
    seen: list[tuple[int, Moment, int]] = []

    def hook(write: Write, moment: Moment) -> None:
        seen.append((write.index, moment, write.status))

    forget = proxy.on_write(hook)
    await client.create(CONFIGMAPS, configmap("a"))
    forget()
    await client.create(CONFIGMAPS, configmap("b"))
    assert seen == [(1, Moment.BEFORE, 0), (1, Moment.AFTER, 201)]


@pytest.mark.parametrize(("moment", "applied"), [(Moment.BEFORE, False), (Moment.AFTER, True)])
async def test_a_kill_strikes_exactly_there(
    client: ApiClient, api: FakeApiServer, proxy: FaultProxy, moment: Moment, applied: bool
) -> None:
    killed: list[str] = []
    struck = proxy.kill_at("me", 2, moment, lambda: killed.append("now"))
    await client.create(CONFIGMAPS, configmap("a"))
    assert not struck()
    with pytest.raises(Unreachable):
        await client.create(CONFIGMAPS, configmap("b"))
    assert struck()
    await client.create(CONFIGMAPS, configmap("c"))
    assert killed == ["now"]
    assert (Key("/configmaps", "default", "b") in api.store.objects) is applied


async def test_a_partition_ends_with_its_block(client: ApiClient, proxy: FaultProxy) -> None:
    with proxy.partition("me"), pytest.raises(Unreachable):
        await client.create(CONFIGMAPS, configmap("a"))
    await client.create(CONFIGMAPS, configmap("a"))


def test_waiting_in_vain_shows_the_last_writes(proxy: FaultProxy) -> None:
    proxy.wait(lambda: True)
    with pytest.raises(TimeoutError, match="first write not met"):
        proxy.wait(lambda: False, timeout_s=0.05, what="first write")
