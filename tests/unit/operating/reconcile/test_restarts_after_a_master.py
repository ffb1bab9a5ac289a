"""Nodes of a ROS 1 app are restarted after their master, against an API server."""

from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.unit.operating.reconcile.test_instance_reconciler import ReconciledServer

from robotapp_api.model.names import Annotation, Label
from robotapp_client.api.times import utc_now
from robotapp_operator.plan.diff.master_restarts import MOST_RESTARTS
from robotapp_operator.plan.spec.objects import Deployment, Pod, ReplicaSet
from robotapp_operator.plan.status.conditions import conditions
from robotapp_operator.plan.status.facts import AppFacts
from robotapp_operator.watch.facts.instance_facts import instance_facts
from robotapp_operator.watch.lister import wanted_instances


@pytest.fixture
async def world() -> AsyncIterator[ReconciledServer]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield ReconciledServer(api, client)


async def test_nodes_of_a_master_that_was_replaced_are_restarted_once_with_an_event(world: ReconciledServer) -> None:
    uid = await world.app(ros={"distro": "noetic"}, ros2=None)
    assert await world.children.reconcile(uid, "")
    await world.mirror()
    put_pods(world, uid, master=20, nodes=0)
    before = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() > before
    await world.mirror()
    starts = {
        item["metadata"]["labels"].get(Label.COMPONENT): item["spec"]["template"]["metadata"].get("annotations", {})
        for item in await world.deployments()
    }
    assert starts == {
        None: {},
        "operator": {Annotation.MASTER_STARTS: "2026-01-01T10:20:00Z"},
        "driver": {Annotation.MASTER_STARTS: "2026-01-01T10:20:00Z"},
    }
    (event,) = world.events
    assert event.reason == "MasterRestarted"
    assert event.note.endswith("driver, operator restarted")
    written = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == written


async def test_a_master_that_ends_again_and_again_is_named_in_the_status_with_the_pods_to_delete(
    world: ReconciledServer,
) -> None:
    uid = await world.app(ros={"distro": "noetic"}, ros2=None)
    assert await world.children.reconcile(uid, "")
    for start in range(MOST_RESTARTS + 1):
        await world.mirror()
        put_pods(world, uid, master=start + 10, nodes=start)
        assert await world.children.reconcile(uid, "")
    assert [event.reason for event in world.events] == ["MasterRestarted"] * MOST_RESTARTS
    app = world.cache.apps[uid].app
    assert app is not None
    (instance,) = wanted_instances(app, world.cache)
    facts = instance_facts(app, instance, world.cache, outcome=None, trouble=None, held=(), now_s=0.0, now=utc_now())
    assert facts.cut_off == ("driver", "operator")
    whole = AppFacts(app=app, instances=(facts,), now="2026-01-01T11:00:00Z")
    stalled = next(item for item in conditions(whole) if item["type"] == "Stalled")
    assert (stalled["status"], stalled["reason"]) == ("True", "RestartNeeded")
    assert "the master was started anew since driver, operator started" in stalled["message"]


def put_pods(world: ReconciledServer, uid: str, *, master: int, nodes: int) -> None:
    """Puts a pod of each Deployment into the cache: the master's and the nodes' were made in these minutes."""
    for item in world.cache.deployments.of(uid).values():
        name = item.metadata.labels.get(Label.COMPONENT, "master")
        world.cache.put_replica_set(replica_set(name, item))
        minute = master if name == "master" else nodes
        world.cache.pods.put(uid, name, running_pod(name, item, minute=minute))


def replica_set(name: str, owner: Deployment) -> ReplicaSet:
    return msgspec.convert({"metadata": _owned(f"{name}-rs", owner.metadata.uid, owner)}, ReplicaSet)


def running_pod(name: str, deployment: Deployment, *, minute: int) -> Pod:
    """A ready pod that was made and started in this minute."""
    time = f"2026-01-01T10:{minute:02}:00Z"
    body = {
        "metadata": {**_owned(name, f"{name}-rs-uid", deployment), "creationTimestamp": time},
        "status": {
            "phase": "Running",
            "conditions": [{"type": "Ready", "status": "True"}],
            "containerStatuses": [{"name": name, "state": {"running": {"startedAt": time}}}],
        },
    }
    return msgspec.convert(body, Pod)


def _owned(name: str, owner: str, deployment: Deployment) -> dict[str, Any]:
    references = [{"uid": owner, "controller": True, "kind": "x", "name": "x"}]
    labels = deployment.metadata.labels
    return {"name": name, "namespace": "default", "uid": f"{name}-uid", "labels": labels, "ownerReferences": references}
