"""The whole process in one test's loop, against the small API server: from a pod to its Binding, and a clean end."""

import asyncio
import gc
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import aiohttp
import msgspec
import pytest
from prometheus_client.exposition import generate_latest
from tests.support.apiserver import FakeApiServer, Key
from tests.support.claims.objects import app_holder, domain_claim
from tests.support.clients import client_for, until

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.placement.better_node import parse_better_node
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import (
    DEPLOYMENTS,
    DOMAINPOOLS,
    LEASES,
    NODES,
    NODETELEMETRIES,
    PODS,
    REPLICASETS,
    ROBOTAPPS,
    ROBOTCLAIMS,
    Resource,
)
from robotapp_client.tools.restart import RESTORED
from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.flags import Options, parse
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.shell.config.reload import Running
from robotapp_scheduler.shell.process.process import Scheduler


@pytest.fixture(autouse=True)
def what_other_tests_keep_is_not_walked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of tests are loaded beside the scheduler: looking at all their objects takes longer than its work."""
    monkeypatch.setattr(gc, "unfreeze", lambda: None)


def options(**changes: Any) -> Options:
    return replace(parse(["--health-port", "0", "--health-host", "127.0.0.1"], {}), **changes)


def config(*, leader: bool = False) -> configuration.SchedulerConfig:
    document = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": {"leaderElect": leader},
    }
    return configuration.parse(document, catalogue=catalogue())


def node(name: str = "n1", cpu: str = "4") -> dict[str, Any]:
    return {"metadata": {"name": name}, "status": {"allocatable": {"cpu": cpu, "memory": "8Gi", "pods": "110"}}}


def pod(name: str = "p", **spec: Any) -> dict[str, Any]:
    body = {"schedulerName": "ros-aware-scheduler", "containers": [{"name": "c", "image": "i"}], **spec}
    return {"metadata": {"name": name, "namespace": "default"}, "spec": body, "status": {"phase": "Pending"}}


class RunningScheduler:
    """A fake API server with our scheduler at work on it."""

    def __init__(self, server: FakeApiServer, client: ApiClient, scheduler: Scheduler, task: asyncio.Task[int]) -> None:
        self.server = server
        self.client = client
        self.scheduler = scheduler
        self.task = task

    def stored(self, name: str) -> dict[str, Any]:
        return self.server.store.get(Key("/pods", "default", name))

    async def bound(self, name: str) -> str:
        await until(lambda: self.stored(name)["spec"].get("nodeName"), what=f"{name} bound")
        return str(self.stored(name)["spec"]["nodeName"])


ALL_KINDS = (ROBOTAPPS, ROBOTCLAIMS, NODETELEMETRIES)


@asynccontextmanager
async def world(
    *, leader: bool = False, kinds: Sequence[Resource] = (), forbidden: Sequence[Resource] = (), **changes: Any
) -> AsyncIterator[RunningScheduler]:
    """`kinds` of ours that the server has; those nobody may list; `changes` are of the process' flags."""
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        server.forbidden = {kind.path() for kind in forbidden}
        if kinds:
            server.served[ROBOTAPPS.root] = [kind.plural for kind in kinds]
        scheduler = Scheduler(client, Running(config(leader=leader)), options(**changes))
        task = asyncio.create_task(scheduler.run())
        try:
            yield RunningScheduler(server, client, scheduler, task)
        finally:
            scheduler.stop()
            await asyncio.wait_for(task, 60)


async def test_from_pod_to_binding_and_event() -> None:
    async with world() as found:
        await found.client.create(NODES, node())
        await found.client.create(PODS, pod())
        assert await found.bound("p") == "n1"
        await until(lambda: found.scheduler.core.cluster.placed, what="placed")
        await until(lambda: not any(p.assumed for p in found.scheduler.core.cluster.placed.values()), what="confirmed")
        events = "events.k8s.io/events"
        await until(lambda: found.server.store.select(events, None), what="event")
        (event,) = found.server.store.select(events, None)
        assert event["note"] == "Successfully assigned default/p to n1"
        assert len(found.scheduler.core.queue) == 0


async def test_everything_that_is_counted_can_be_scraped() -> None:
    async with world() as found:
        await found.client.create(NODES, node())
        await found.client.create(PODS, pod())
        await found.bound("p")
        text = generate_latest(found.scheduler.metrics.registry).decode()
        for name in ("pending_pods", "cache_size", "unschedulable_pods", "config_in_use", "config_reloads_total",
                     "device_slots_free", "rtt_age_seconds", "simulations_total", "plugin_decisions_total"):  # fmt: skip
            assert f"# TYPE scheduler_{name} " in text, name
        assert 'scheduler_cache_size{type="nodes"} 1.0' in text


async def test_pods_whose_group_is_not_there_are_a_queue_of_their_own() -> None:
    async with world() as found:
        await found.client.create(PODS, pod("alone", schedulingGroup={"podGroupName": "team"}))
        await found.client.create(PODS, pod("gated", schedulingGates=[{"name": "example.com/gate"}]))
        await until(lambda: found.scheduler.core.queue.pending()["gated"] == 2, what="both are held")
        text = generate_latest(found.scheduler.metrics.registry).decode()
        for queue, count in {"incomplete": 1, "gated": 1, "pending": 0, "active": 0}.items():
            assert f'scheduler_pending_pods{{queue="{queue}"}} {count}.0' in text


async def test_a_refused_pod_is_told_why_and_bound_when_a_node_appears() -> None:
    async with world() as found:
        await found.client.create(PODS, pod())
        await until(lambda: found.stored("p")["status"].get("conditions"), what="condition")
        (condition,) = found.stored("p")["status"]["conditions"]
        assert (condition["reason"], condition["message"]) == ("Unschedulable", "no nodes available to schedule pods")
        await found.client.create(NODES, node())
        assert await found.bound("p") == "n1"


async def late_app(client: ApiClient) -> None:
    """A driver on the robot and a planner on e1, which is 60 ms from it; e2 would be 8 ms."""
    for name in ("amr", "e1", "e2"):
        await client.create(NODES, {**node(name), "spec": {"unschedulable": name == "amr"}})
    edge = {"topic": "/plan", "from": "planner", "to": "driver", "latency": {"budget": "20ms"}}
    parts = [{"name": "driver", "image": "i", "runsOn": ["Robot"]}, {"name": "planner", "image": "i"}]
    spec = {"components": parts, "edges": [edge], "placement": {"reschedule": {"for": "1s"}}}
    app = await client.create(ROBOTAPPS, {"metadata": {"name": "teleop", "namespace": "default"}, "spec": spec})
    for component, where in (("driver", "amr"), ("planner", "e1")):
        owner = app
        for resource, kind in ((DEPLOYMENTS, "RobotApp"), (REPLICASETS, "Deployment"), (PODS, "ReplicaSet")):
            meta = owner["metadata"]
            obj: dict[str, Any] = {"metadata": {"namespace": "default"}}
            if resource is PODS:
                obj = pod(component, nodeName=where)
            reference = {"apiVersion": "v1", "kind": kind, "name": meta["name"], "uid": meta["uid"], "controller": True}
            labels = {Label.APP_UID: app["metadata"]["uid"], Label.INSTANCE: "amr", Label.COMPONENT: component}
            obj["metadata"] |= {"name": component, "ownerReferences": [reference]}
            obj["metadata"]["labels"] = {str(key): value for key, value in labels.items()}
            owner = await client.create(resource, obj)
    await client.patch(
        ROBOTAPPS, "teleop", {"status": {"observedGeneration": 1}}, namespace="default", subresource="status"
    )
    await client.create(NODETELEMETRIES, {"metadata": {"name": "amr"}})
    rtt = [{"peer": peer, "p50Us": us, "p95Us": us} for peer, us in (("e1", 60_000), ("e2", 8_000))]
    status = {"intervalSeconds": 10, "seq": 1, "rtt": rtt}
    await client.patch(NODETELEMETRIES, "amr", {"status": status}, subresource="status")


async def test_a_better_node_is_proposed_for_a_pod_whose_budget_is_exceeded() -> None:
    async with world(kinds=ALL_KINDS) as found:
        await late_app(found.client)

        def proposed() -> str:
            return str((found.stored("planner")["metadata"].get("annotations") or {}).get(Annotation.BETTER_NODE, ""))

        await until(proposed, what="a proposal")
        better = parse_better_node(proposed())
        assert (better.node, better.before_us, better.after_us) == ("e2", 60_000.0, 8_000.0)


async def test_what_would_be_is_decided_in_a_copy_of_the_whole_process_and_nothing_is_written() -> None:
    question = {"nodeLoss": ["e1"], "rtt": [{"one": "amr", "other": "e2", "rtt": "12ms"}]}
    async with world(kinds=ALL_KINDS, insecure_explain=True, better_nodes=False) as found:
        await late_app(found.client)
        core = found.scheduler.core
        await until(
            lambda: core.cluster.rtt.measured_us("amr", "e2", 95) and len(core.cluster.placed) == 2, what="seen"
        )
        before = {key: each["metadata"]["resourceVersion"] for key, each in found.server.store.objects.items()}
        async with aiohttp.ClientSession() as session:
            where = f"https://127.0.0.1:{found.scheduler.port}/what-if"
            async with session.post(where, json=question, ssl=False) as response:
                assert response.status == 200, await response.text()
                answer = await response.json()
        (moved,) = answer["pods"]
        assert (moved["component"], moved["outcome"], moved["from"], moved["to"]) == ("planner", "Moves", "e1", "e2")
        (edge,) = answer["edges"]
        assert (edge["before"]["rttMs"], edge["before"]["verdict"]) == (60.0, "Exceeded")
        assert (edge["after"]["rttMs"], edge["after"]["verdict"]) == (12.0, "Met")
        assert {key: each["metadata"]["resourceVersion"] for key, each in found.server.store.objects.items()} == before
        assert {each.name: each.node for each in core.cluster.placed.values()} == {"driver": "amr", "planner": "e1"}
        assert core.cluster.rtt.measured_us("amr", "e2", 95) == 8_000.0


WANTS_A_DOMAIN = {Annotation.DDS_DOMAIN.value: "auto"}


@pytest.mark.parametrize(
    ("kinds", "forbidden", "named"),
    [
        ((ROBOTAPPS, ROBOTCLAIMS), (), "nodetelemetries"),
        ((ROBOTAPPS, NODETELEMETRIES), (), "robotclaims"),
        (ALL_KINDS, (ROBOTCLAIMS,), "robotclaims"),
    ],
    ids=["no NodeTelemetry", "no RobotClaim", "no right to list RobotClaims"],
)
async def test_without_a_kind_of_ours_plain_pods_are_placed_and_ros_pods_wait_with_the_reason(
    kinds: tuple[Resource, ...], forbidden: tuple[Resource, ...], named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robotapp_scheduler.shell.informers.informers.CRD_POLL_S", 0.05)
    monkeypatch.setattr("robotapp_scheduler.core.cycle.group_gates.KINDS_REPORT_AFTER_S", 0.0)
    async with world(kinds=kinds, forbidden=forbidden) as found:
        await found.client.create(NODES, node())
        await found.client.create(PODS, pod("plain"))
        ros = pod("ros")
        ros["metadata"]["annotations"] = WANTS_A_DOMAIN
        await found.client.create(PODS, ros)
        assert await found.bound("plain") == "n1"
        await until(lambda: found.stored("ros")["status"].get("conditions"), what="a condition")
        (condition,) = found.stored("ros")["status"]["conditions"]
        assert condition["reason"] == "WaitingForKinds"
        assert f"waiting for {named}.robotics.io" in condition["message"]
        status, text = await readyz(found)
        assert (status, f"[-]kind-{named} failed" in text) == (503, True)
        found.server.forbidden.clear()
        found.server.served[ROBOTAPPS.root] = [kind.plural for kind in ALL_KINDS]
        await found.client.create(DOMAINPOOLS, {"metadata": {"name": "default"}, "spec": {"ids": "1-3"}})
        assert await found.bound("ros") == "n1"
        assert found.scheduler.feed.missing_kinds() == ()


async def readyz(found: RunningScheduler) -> tuple[int, str]:
    where = f"https://127.0.0.1:{found.scheduler.port}/readyz"
    async with aiohttp.ClientSession() as session, session.get(where, ssl=False) as response:
        return response.status, await response.text()


async def test_without_any_kind_of_ours_the_scheduler_is_ready_and_ros_pods_wait() -> None:
    async with world() as found:
        await found.client.create(NODES, node())
        await found.client.create(PODS, pod("plain"))
        assert await found.bound("plain") == "n1"
        assert await readyz(found) == (200, "ok")
        ros = pod("ros")
        ros["metadata"]["annotations"] = WANTS_A_DOMAIN
        await found.client.create(PODS, ros)
        await until(lambda: found.scheduler.core.queue.pending()["gated"] == 1, what="it is held")


async def test_a_poison_node_is_counted_and_the_next_one_is_used() -> None:
    async with world() as found:
        await found.client.create(NODES, node("poison", cpu="a lot"))
        await found.client.create(NODES, node("good"))
        await found.client.create(PODS, pod())
        assert await found.bound("p") == "good"
        assert found.scheduler.metrics.poison_objects.labels("nodes")._value.get() >= 1


async def test_a_leader_gives_its_lease_back_when_it_is_stopped() -> None:
    async with world(leader=True) as found:
        await until(found.scheduler._leading.is_set, what="leading")
        namespace = found.client.endpoint.namespace
        lease = await found.client.get(LEASES, "robotapp-scheduler", namespace=namespace)
        assert lease["spec"]["holderIdentity"]
        found.scheduler.stop()
        assert await asyncio.wait_for(asyncio.shield(found.task), 60) == 0
        lease = await found.client.get(LEASES, "robotapp-scheduler", namespace=namespace)
        assert not lease["spec"].get("holderIdentity")


KEPT, LOST = domain_claim(5), domain_claim(6, app_holder("lost"))
"""The snapshot from which etcd is restored has the first one only."""


async def see_restore(found: RunningScheduler, monkeypatch: pytest.MonkeyPatch) -> None:
    """Etcd goes back to a snapshot with one of the claims. The scheduler ends no sooner than its cache has forgotten the other."""
    store, held = found.server.store, found.scheduler.domains.held
    store.put(ROBOTCLAIMS, msgspec.to_builtins(KEPT))
    snapshot = store.snapshot()
    store.version += 1000  # more than the sweep writes before a watch is opened again
    store.put(ROBOTCLAIMS, msgspec.to_builtins(LOST))
    staleness = found.scheduler.feed.staleness
    await until(lambda: len(held()) == 2 and staleness().get(ROBOTCLAIMS.plural) == 0, what="both claims are watched")

    async def drain(_timeout_s: float) -> None:
        await until(lambda: len(held()) == 1, what="the cache forgets")
        assert LOST.name in {taken.name for taken in found.scheduler._taken_claims()}

    monkeypatch.setattr(found.scheduler.loop, "drain", drain)
    store.restore(snapshot)
    found.server.break_watches()


async def test_a_claim_that_a_restore_lost_is_made_again_although_the_cache_has_forgotten_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with world(kinds=ALL_KINDS) as found:
        await see_restore(found, monkeypatch)
        assert await asyncio.wait_for(asyncio.shield(found.task), 60) == RESTORED
        assert found.server.store.find(ROBOTCLAIMS, LOST.name) is not None


async def test_a_scheduler_that_was_told_to_end_does_not_start_again_after_a_restore(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with world(kinds=ALL_KINDS) as found:
        await see_restore(found, monkeypatch)
        await until(found.scheduler._stop.is_set, what="the restore is noticed")
        found.scheduler.stop()
        assert await asyncio.wait_for(asyncio.shield(found.task), 60) == 0
        assert found.server.store.find(ROBOTCLAIMS, LOST.name) is not None
