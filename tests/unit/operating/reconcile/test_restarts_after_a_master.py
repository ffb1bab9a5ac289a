"""Nodes of a ROS 1 app are restarted after their master, against an API server."""

from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.unit.operating.reconcile.test_instance_reconciler import ReconciledServer

from robotapp_api.model.names import Annotation, Label
from robotapp_operator.plan.spec.objects import Deployment, Pod, ReplicaSet


@pytest.fixture
async def world() -> AsyncIterator[ReconciledServer]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield ReconciledServer(api, client)


async def test_nodes_of_a_master_that_was_replaced_are_restarted_once_with_an_event(world: ReconciledServer) -> None:
    events: list[tuple[str, str]] = []
    world.recorder.event = lambda _, **event: events.append((event["reason"], event["note"]))  # type: ignore[method-assign]
    uid = await world.app(ros={"distro": "noetic"}, ros2=None)
    assert await world.children.reconcile(uid, "")
    await world.mirror()
    parts = {
        item.metadata.labels.get(Label.COMPONENT, "master"): item for item in world.cache.deployments.of(uid).values()
    }
    for name, item in parts.items():
        minute = 20 if name == "master" else 0
        world.cache.put_replica_set(replica_set(name, item))
        world.cache.pods.put(uid, name, running_pod(name, item, minute=minute))
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
    (event,) = events
    assert event[0] == "MasterRestarted"
    assert event[1].endswith("driver, operator restarted")
    written = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == written


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
            "containerStatuses": [{"name": "main", "state": {"running": {"startedAt": time}}}],
        },
    }
    return msgspec.convert(body, Pod)


def _owned(name: str, owner: str, deployment: Deployment) -> dict[str, Any]:
    references = [{"uid": owner, "controller": True, "kind": "x", "name": "x"}]
    labels = deployment.metadata.labels
    return {"name": name, "namespace": "default", "uid": f"{name}-uid", "labels": labels, "ownerReferences": references}
