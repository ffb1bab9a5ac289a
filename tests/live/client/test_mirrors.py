"""Reflectors, elections and events: what both servers do over time."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from tests.live.client.conftest import Place
from tests.support.clients import configmap, until

from robotapp_client import Change, NotFound, Reflector
from robotapp_client.api.resources import CONFIGMAPS, EVENTS, LEASES
from robotapp_client.tools.event_recorder import EventRecorder, reference
from robotapp_client.tools.leader_election import LeaderElection


@asynccontextmanager
async def running(*work: Any) -> AsyncIterator[None]:
    tasks = [asyncio.ensure_future(each) for each in work]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


@pytest.mark.parametrize("streaming", [False, True], ids=["list+watch", "streaming list"])
async def test_a_mirror_follows_what_its_selector_lets_through(place: Place, streaming: bool) -> None:
    mine = {"mine": "yes"}
    told: list[str] = []

    def note(change: Change) -> None:
        told.append(f"{change.kind} {change.key.partition('/')[2]}")

    client, namespace = place.client, place.namespace
    await client.create(CONFIGMAPS, configmap("before", namespace=namespace, labels=mine))
    mirror = Reflector(
        client,
        CONFIGMAPS,
        as_type=dict,
        namespace=namespace,
        label_selector="mine=yes",
        streaming=streaming,
        on_change=note,
    )
    async with running(mirror.run()):
        await asyncio.wait_for(mirror.synced.wait(), 60)
        await client.create(CONFIGMAPS, configmap("a", namespace=namespace, labels=mine))
        await client.create(CONFIGMAPS, configmap("other", namespace=namespace))
        await client.patch(CONFIGMAPS, "a", {"data": {"x": "1"}}, namespace=namespace)
        await client.patch(CONFIGMAPS, "other", {"metadata": {"labels": mine}}, namespace=namespace)
        await client.patch(CONFIGMAPS, "a", {"metadata": {"labels": {"mine": "no"}}}, namespace=namespace)
        await client.delete(CONFIGMAPS, "before", namespace=namespace)
        await until(lambda: len(told) >= 6)
        assert told == [
            "ADDED before",
            "ADDED a",
            "MODIFIED a",
            "ADDED other",
            "DELETED a",
            "DELETED before",
        ]
        assert list(mirror.store) == [f"{namespace}/other"]
        assert mirror.stats.failures == mirror.stats.gone == 0


async def test_leadership_is_handed_over_at_a_stop_and_after_a_death(place: Place) -> None:
    said: list[str] = []

    def candidate(name: str) -> LeaderElection:
        return LeaderElection(
            place.client,
            place.namespace,
            "test",
            name,
            lease_duration_s=30,
            renew_deadline_s=20,
            retry_period_s=0.1,
        )

    def run(name: str) -> asyncio.Task[None]:
        return asyncio.ensure_future(candidate(name).run(lambda: said.append(name), lambda: said.append(f"-{name}")))

    first = run("a")
    await until(lambda: said == ["a"])
    second = run("b")
    await asyncio.sleep(0.5)
    assert said == ["a"]
    first.cancel()
    await until(lambda: said == ["a", "b"], timeout_s=20)  # less than the lease lasts
    # A death: the holder's name stays and nobody renews.
    lease = await place.client.get(LEASES, "test", namespace=place.namespace)
    second.cancel()
    await asyncio.gather(first, second, return_exceptions=True)
    released = await place.client.get(LEASES, "test", namespace=place.namespace)
    assert "holderIdentity" not in released["spec"]
    lease["spec"]["leaseDurationSeconds"] = 2
    lease["metadata"]["resourceVersion"] = released["metadata"]["resourceVersion"]
    await place.client.replace(LEASES, lease)
    third = run("c")
    await until(lambda: said == ["a", "b", "c"])
    assert (await place.client.get(LEASES, "test", namespace=place.namespace))["spec"]["leaseTransitions"] == 2
    third.cancel()
    await asyncio.gather(third, return_exceptions=True)


async def test_events_are_accepted_and_counted(place: Place) -> None:
    recorder = EventRecorder(place.client, controller="robotics.io/test", instance="me", flush_s=0)
    pod = reference(api_version="v1", kind="Pod", namespace=place.namespace, name="p", uid="u")
    async with running(recorder.run()):
        recorder.event(pod, reason="Placed", note="p runs on n1", action="Binding")
        await recorder.drain()
        recorder.event(pod, reason="Placed", note="p runs on n1", action="Binding")
        recorder.event(pod, reason="Placed", note="p runs on n1", action="Binding")
        await recorder.drain()
        await until(lambda: recorder.stats.failed or recorder.stats.created == 1)
    assert recorder.stats.failed == 0
    events = (await place.client.list(EVENTS, namespace=place.namespace)).items
    ours = [event for event in events if event["reportingController"] == "robotics.io/test"]
    assert [(event["note"], event["series"]["count"]) for event in ours] == [("p runs on n1", 3)]


async def test_an_event_in_a_namespace_that_is_gone_is_dropped_in_silence(place: Place) -> None:
    if place.fake is not None:
        return  # the small server knows no namespaces
    recorder = EventRecorder(place.client, controller="robotics.io/test", instance="me")
    async with running(recorder.run()):
        gone = reference(api_version="v1", kind="Pod", namespace="no-such-namespace", name="p", uid="u")
        recorder.event(gone, reason="Placed", note="n", action="Binding")
        await recorder.drain()
    assert (recorder.stats.created, recorder.stats.failed) == (0, 0)
    with pytest.raises(NotFound):
        await place.client.get(EVENTS, "p", namespace="no-such-namespace")
