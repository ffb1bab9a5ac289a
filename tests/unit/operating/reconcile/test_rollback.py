"""What an operator does after a rollback: templates, and whole specs, are of a version it does not know."""

from collections.abc import AsyncIterator
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.unit.operating.reconcile.test_instance_reconciler import VERSION, ReconciledServer

from robotapp_api.model.names import Annotation
from robotapp_client.api.resources import DEPLOYMENTS


@pytest.fixture
async def world() -> AsyncIterator[ReconciledServer]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield ReconciledServer(api, client)


async def of_the_newer_operator(world: ReconciledServer) -> str:
    """An app whose Deployments a newer operator has written; its uid."""
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    for item in await world.deployments():
        mark = {"metadata": {"annotations": {Annotation.RENDERED_BY: "9.0.0", Annotation.CONTENT_HASH: "theirs"}}}
        await world.client.patch(DEPLOYMENTS, item["metadata"]["name"], mark, namespace="default")
    return uid


@pytest.mark.parametrize(
    "written",
    [{"ros": {"distro": "humbel"}}, {"update": {"operator": "OfANewerSchema"}}, {"components": [{"name": "driver"}]}],
    ids=["refused", "unknown word", "unreadable"],
)
async def test_suspend_stops_an_app_whose_spec_this_version_cannot_run_or_read(
    world: ReconciledServer, written: dict[str, Any]
) -> None:
    """After a rollback a spec may hold what only the newer version knows."""
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    await world.mirror()
    await world.edit("teleop", **written)
    before = {item["metadata"]["name"]: item["spec"]["template"] for item in await world.deployments()}
    assert await world.children.reconcile(uid, "")
    assert {item["spec"]["replicas"] for item in await world.deployments()} == {1}
    await world.edit("teleop", suspend=True)
    assert await world.children.reconcile(uid, "")
    assert {item["spec"]["replicas"] for item in await world.deployments()} == {0}
    assert {item["metadata"]["name"]: item["spec"]["template"] for item in await world.deployments()} == before
    await world.mirror()
    writes = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == writes


async def test_suspend_stops_the_pods_of_a_newer_operators_templates(world: ReconciledServer) -> None:
    uid = await of_the_newer_operator(world)
    await world.edit("teleop", suspend=True)
    assert await world.children.reconcile(uid, "")
    found = await world.deployments()
    assert {item["spec"]["replicas"] for item in found} == {0}
    assert {item["metadata"]["annotations"][Annotation.RENDERED_BY] for item in found} == {"9.0.0"}
    assert world.memory.of(uid).held[""] == ()


async def test_an_edit_that_a_newer_operators_template_holds_back_is_remembered_for_the_status(
    world: ReconciledServer,
) -> None:
    uid = await of_the_newer_operator(world)
    driver = {"name": "driver", "image": "reg/driver:2", "args": ["new"]}
    await world.edit("teleop", components=[{"name": "operator", "image": "reg/operator:1"}, driver])
    assert await world.children.reconcile(uid, "")
    (held,) = world.memory.of(uid).held[""]
    assert (held.newer, held.ours) == ("9.0.0", VERSION)
    containers = [item["spec"]["template"]["spec"]["containers"][0] for item in await world.deployments()]
    assert {(item["name"], item["image"], "args" in item) for item in containers} == {
        ("operator", "reg/operator:1", False),
        ("driver", "reg/driver:2", False),
    }
