"""One instance's children against an API server: the protocol's order, fences and turns."""

import asyncio
import hashlib
import itertools
from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, configmap
from tests.support.factories import app_body, make_node
from tests.support.factories import robots as robot_nodes

from robotapp_api.model.names import API_VERSION, Annotation, Label, Reason
from robotapp_claims.rules.objects import Claim
from robotapp_client import ApiClient, Forbidden, NotFound
from robotapp_client.api.resources import (
    CONFIGMAPS,
    DEPLOYMENTS,
    DOMAINPOOLS,
    NODES,
    ROBOTAPPS,
    ROBOTCLAIMS,
    SERVICES,
)
from robotapp_operator.plan.render.parameters import parameter_states
from robotapp_operator.plan.spec.objects import ConfigMap, Deployment, Service
from robotapp_operator.plan.status.events import PendingEvent
from robotapp_operator.queue.work import StartOver
from robotapp_operator.queue.workqueue import Queue
from robotapp_operator.reconcile.instances import instance_reconciler
from robotapp_operator.reconcile.instances.instance_reconciler import InstanceReconciler
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch
from robotapp_operator.watch.out_of_sight import OutOfSight

VERSION = "1.2.0"
MULTICAST = {"ros2": {"discovery": {"mode": "Multicast"}}}


class ReconciledServer:
    """A server, its client and one operator's memory. No informers: caches hold only what a test puts there, and each look
    at the clock is later than any watch would be, so that nothing is waited for; unless `now_s` stops it.
    """

    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()
        self.memory = ReconcileState()
        queue = Queue(clock=lambda: 0.0, jitter=lambda: 0.0)
        self.params = ParamsWatch(client, self.cache, queue)
        self.now_s: float | None = None
        self._ticks = itertools.count(step=60.0)
        self.events: list[PendingEvent] = []
        self.children = InstanceReconciler(
            client,
            self.cache,
            self.memory,
            self.params,
            version=VERSION,
            clock=lambda: self.now_s or next(self._ticks),
            announce=lambda _, event: self.events.append(event),
        )

    async def pool(self, ids: str = "1-101") -> None:
        await self.client.create(
            DOMAINPOOLS, {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": ids}}
        )

    async def app(self, name: str = "teleop", **spec: Any) -> str:
        body = app_body(name, **{**MULTICAST, **spec})
        body["metadata"] = {"name": name, "namespace": "default"}
        created = await self.client.create(ROBOTAPPS, body)
        return self.cache.update_app(created).uid

    async def edit(self, name: str, **spec: Any) -> None:
        changed = await self.client.patch(ROBOTAPPS, name, {"spec": spec}, namespace="default")
        self.cache.update_app(changed)

    async def deployments(self) -> list[dict[str, Any]]:
        return (await self.client.list(DEPLOYMENTS)).items

    async def mirror(self) -> None:
        """Put children and claims into the cache, as the informers do."""
        for claim in (await self.client.list(ROBOTCLAIMS, as_type=Claim)).items:
            self.cache.claims.put(claim.holder.uid, claim.name, claim)
        for item in (await self.client.list(DEPLOYMENTS, as_type=Deployment)).items:
            self.cache.deployments.put(item.metadata.labels[Label.APP_UID], item.metadata.name, item)
        for service in (await self.client.list(SERVICES, as_type=Service)).items:
            self.cache.services.put(service.metadata.labels[Label.APP_UID], service.metadata.name, service)

    async def claims(self) -> list[dict[str, Any]]:
        return (await self.client.list(ROBOTCLAIMS)).items

    def writes(self) -> int:
        return sum(method != "GET" for method, _ in self.api.requests)


@pytest.fixture
async def world() -> AsyncIterator[ReconciledServer]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield ReconciledServer(api, client)


def domain_of(deployment: dict[str, Any]) -> str:
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    return next(str(item["value"]) for item in container["env"] if item["name"] == "ROS_DOMAIN_ID")


async def test_the_claim_exists_before_the_first_deployment(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    assert await world.children.reconcile(uid, "")
    created = [path for method, path in world.api.requests if method == "POST"]
    kinds = [path.partition("?")[0].rsplit("/", 1)[-1] for path in created]
    assert kinds.index("robotclaims") < kinds.index("deployments")
    (claim,) = await world.claims()
    assert {domain_of(item) for item in await world.deployments()} == {str(claim["spec"]["domain"]["id"])}
    assert world.memory.of(uid).new_domains == {"": claim["spec"]["domain"]["id"]}


async def test_a_new_app_is_read_once_and_children_that_cannot_be_there_are_not_listed(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    world.api.requests.clear()
    assert await world.children.reconcile(uid, "")
    reads = [path.partition("?")[0].split("/")[-1] for method, path in world.api.requests if method == "GET"]
    assert reads == ["teleop", "domainpools", "robotclaims"]


async def test_children_that_a_late_watch_has_not_shown_are_kept_as_they_are(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    before, (claim,) = await world.deployments(), await world.claims()
    world.memory.forget(uid)  # the next operator, which has seen the app and nothing else
    world.api.requests.clear()
    assert await world.children.reconcile(uid, "")
    assert await world.deployments() == before
    assert [item["metadata"]["uid"] for item in await world.claims()] == [claim["metadata"]["uid"]]
    assert [method for method, _ in world.api.requests].count("POST") == 1  # one creation, refused


async def test_an_edit_whose_event_overtakes_the_read_of_the_app_is_what_is_written(
    world: ReconciledServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The request was that of the edit and the owner that of the read: an id of its own was taken, and two rolls."""
    await world.pool()
    await world.children.reconcile(await world.app("teleop"), "")
    await world.mirror()
    viewer, get = await world.app("viewer"), world.client.get
    edited: list[str] = []

    async def overtaken(resource: Any, name: str, **more: Any) -> Any:
        body = await get(resource, name, **more)
        if name == "viewer" and not edited:
            edited.append(name)
            await world.edit("viewer", ros2={"discovery": {"mode": "Multicast"}, "shareWith": [{"name": "teleop"}]})
        return body

    monkeypatch.setattr(world.client, "get", overtaken)
    assert await world.children.reconcile(viewer, "")
    (claim,) = await world.claims()
    assert {domain_of(item) for item in await world.deployments()} == {str(claim["spec"]["domain"]["id"])}


async def test_a_second_run_writes_nothing(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    before = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == before


async def test_what_was_written_is_awaited_before_anything_is_read_again(world: ReconciledServer) -> None:
    """The events of our own writes come one by one, and each adds the key."""
    await world.pool()
    uid = await world.app()
    world.now_s = 100.0
    await world.children.reconcile(uid, "")
    before = len(world.api.requests)
    for item in (await world.client.list(DEPLOYMENTS, as_type=Deployment)).items:
        assert world.children.awaits_s(uid, "") == instance_reconciler.AWAIT_S
        assert await world.children.reconcile(uid, "")
        world.cache.deployments.put(uid, item.metadata.name, item)
    await world.mirror()
    claim = (await world.client.list(ROBOTCLAIMS, as_type=Claim)).items[0]
    world.cache.claims.put(uid, claim.name, claim)
    assert await world.children.reconcile(uid, "")
    assert world.children.awaits_s(uid, "") == 0
    reads = [path for method, path in world.api.requests[before:] if method == "GET"]
    assert not any("labelSelector" in path and "instance" in path for path in reads)


async def test_an_app_that_was_always_suspended_has_its_domain_and_no_deployments_until_it_is_resumed(
    world: ReconciledServer,
) -> None:
    await world.pool()
    uid = await world.app(suspend=True)
    assert await world.children.reconcile(uid, "")
    assert (len(await world.claims()), await world.deployments()) == (1, [])
    await world.mirror()
    before = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == before, "nothing is missing"
    await world.edit("teleop", suspend=False)
    assert await world.children.reconcile(uid, "")
    assert {item["spec"]["replicas"] for item in await world.deployments()} == {1}
    await world.mirror()
    await world.edit("teleop", suspend=True)
    assert await world.children.reconcile(uid, "")
    assert {item["spec"]["replicas"] for item in await world.deployments()} == {0}, "what is there stays, without pods"


async def test_an_edit_does_not_wait_for_the_events_of_the_last_write(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    world.now_s = 100.0
    await world.children.reconcile(uid, "")
    await world.edit("teleop", suspend=True)
    await world.children.reconcile(uid, "")
    assert {item["spec"]["replicas"] for item in await world.deployments()} == {0}


async def test_events_that_never_come_are_awaited_for_seconds_only(world: ReconciledServer) -> None:
    """A Deployment that is deleted between its creation and its event is written again."""
    await world.pool()
    uid = await world.app()
    world.now_s = 100.0
    await world.children.reconcile(uid, "")
    (first, *_) = await world.deployments()
    await world.client.delete(DEPLOYMENTS, first["metadata"]["name"], namespace="default")
    world.now_s += instance_reconciler.AWAIT_S - 0.1
    await world.children.reconcile(uid, "")
    assert len(await world.deployments()) == 1
    world.now_s += 0.1
    await world.children.reconcile(uid, "")
    assert len(await world.deployments()) == 2


async def test_an_app_that_is_gone_is_forgotten_and_nothing_is_written(world: ReconciledServer) -> None:
    uid = await world.app()
    await world.client.delete(ROBOTAPPS, "teleop", namespace="default")
    before = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == before
    assert uid not in world.cache.apps


async def test_an_app_whose_end_was_announced_while_it_was_read_is_not_written_for(
    world: ReconciledServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    await world.pool()
    uid = await world.app()
    get = world.client.get

    async def late(*args: Any, **more: Any) -> Any:
        answer = await get(*args, **more)
        world.cache.forget_app(uid)
        return answer

    monkeypatch.setattr(world.client, "get", late)
    before = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == before
    assert uid not in world.cache.apps


async def test_a_404_that_does_not_name_the_app_is_an_error_and_the_app_is_not_forgotten(
    world: ReconciledServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    uid = await world.app()

    async def not_served(*_: Any, **__: Any) -> Any:
        raise NotFound("the server could not find the requested resource", status=404, reason="NotFound")

    monkeypatch.setattr(world.client, "get", not_served)
    with pytest.raises(NotFound):
        await world.children.reconcile(uid, "")
    assert uid in world.cache.apps


async def test_an_app_replaced_by_another_of_its_name_is_not_written_for(world: ReconciledServer) -> None:
    await world.pool()
    old = await world.app()
    await world.client.delete(ROBOTAPPS, "teleop", namespace="default")
    new = await world.app()
    assert new != old
    assert await world.children.reconcile(old, "")
    assert await world.deployments() == []
    assert set(world.cache.apps) == {new}


async def test_without_a_free_id_nothing_is_created(world: ReconciledServer) -> None:
    await world.pool(ids="7")
    first, second = await world.app("one"), await world.app("two")
    assert await world.children.reconcile(first, "")
    assert await world.children.reconcile(second, "")
    outcome = world.memory.outcome(second, "")
    assert outcome is not None
    assert outcome.reason == Reason.DOMAIN_EXHAUSTED
    assert len(await world.claims()) == 1
    assert {item["metadata"]["labels"]["robotics.io/app"] for item in await world.deployments()} == {"one"}
    assert world.memory.without_domain() == [(second, "")]


async def test_a_template_with_a_lost_domain_and_no_other_to_be_had_stops(world: ReconciledServer) -> None:
    await world.pool(ids="7")
    first = await world.app("one")
    await world.children.reconcile(first, "")
    (claim,) = await world.claims()
    await world.client.delete(ROBOTCLAIMS, claim["metadata"]["name"])
    second = await world.app("two")
    await world.children.reconcile(second, "")
    await world.children.reconcile(first, "")
    replicas = {
        (item["metadata"]["labels"]["robotics.io/app"], item["spec"]["replicas"]) for item in await world.deployments()
    }
    assert replicas == {("one", 0), ("two", 1)}
    stopped = await world.deployments()
    await world.mirror()
    await world.children.reconcile(first, "")
    assert await world.deployments() == stopped, "at rest nothing is written"


async def test_a_template_naming_an_id_that_is_not_held_is_rewritten(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    (claim,) = await world.claims()
    (first, *_) = await world.deployments()
    env = first["spec"]["template"]["spec"]["containers"][0]["env"]
    next(item for item in env if item["name"] == "ROS_DOMAIN_ID")["value"] = "99"
    await world.client.replace(DEPLOYMENTS, first, namespace="default")
    await world.children.reconcile(uid, "")
    assert {domain_of(item) for item in await world.deployments()} == {str(claim["spec"]["domain"]["id"])}


async def test_a_removed_component_is_deleted(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    await world.edit("teleop", components=[{"name": "driver", "image": "x"}])
    await world.children.reconcile(uid, "")
    assert [item["metadata"]["labels"]["robotics.io/component"] for item in await world.deployments()] == ["driver"]


async def test_an_instance_that_is_no_longer_wanted_is_pruned(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    robots = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}}
    world.cache.nodes.update(robot_nodes("amr-07"))
    await world.edit("teleop", robots=robots)
    await world.mirror()
    await world.children.reconcile(uid, "")
    assert await world.deployments() == []
    assert (await world.client.list(SERVICES)).items == []
    await world.children.reconcile(uid, "amr-07")
    assert {item["metadata"]["labels"]["robotics.io/instance"] for item in await world.deployments()} == {"amr-07"}


@pytest.mark.parametrize("revoked", [True, False], ids=["admits others only", "is gone"])
async def test_what_runs_for_the_last_robot_goes_when_the_robot_does(world: ReconciledServer, revoked: bool) -> None:
    await world.pool()
    world.cache.nodes.update(robot_nodes("amr-07"))
    uid = await world.app(robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}})
    await world.children.reconcile(uid, "amr-07")
    await world.mirror()
    assert len(await world.deployments()) == 2
    if revoked:
        only_others = {Annotation.ALLOWED_NAMESPACES.value: "other"}
        world.cache.nodes["n-amr-07"] = make_node("n-amr-07", robot="amr-07", annotations=only_others)
    else:
        await out_of_sight_for_the_grace(world, uid)
    await world.edit("teleop", ros={"distro": "humbel"})
    assert await world.children.reconcile(uid, "amr-07")
    assert await world.deployments() == []


async def out_of_sight_for_the_grace(world: ReconciledServer, uid: str) -> None:
    """The cache loses all nodes. During the grace nothing happens, then it is over."""
    now_s = 0.0
    world.cache.sight = OutOfSight(lambda: now_s)
    world.cache.nodes.clear()
    writes = world.writes()
    assert await world.children.reconcile(uid, "amr-07")
    now_s = 299.0
    assert await world.children.reconcile(uid, "amr-07")
    assert world.writes() == writes
    now_s = 300.0


async def test_nothing_ends_on_an_old_view_of_the_nodes(world: ReconciledServer) -> None:
    """The watch has lost the node, and it is there: a fresh read comes before any end."""
    await world.pool()
    world.cache.nodes.update(robot_nodes("amr-07"))
    uid = await world.app(robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}})
    await world.children.reconcile(uid, "amr-07")
    await world.mirror()
    labels = {"robotics.io/robot": "amr-07"}
    await world.client.create(NODES, {"metadata": {"name": "n-amr-07", "labels": labels}})
    await out_of_sight_for_the_grace(world, uid)
    assert not await world.children.reconcile(uid, "amr-07"), "the key comes again"
    assert len(await world.deployments()) == 2
    await world.client.patch(NODES, "n-amr-07", {"metadata": {"labels": {"robotics.io/robot": None}}})
    assert await world.children.reconcile(uid, "amr-07")
    assert await world.deployments() == []


async def test_an_instance_out_of_sight_follows_its_user(world: ReconciledServer) -> None:
    await world.pool()
    world.cache.nodes.update(robot_nodes("amr-07"))
    uid = await world.app(robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}})
    await world.children.reconcile(uid, "amr-07")
    await world.mirror()
    world.cache.nodes.clear()
    await world.edit("teleop", suspend=True)
    assert await world.children.reconcile(uid, "amr-07")
    assert {item["spec"]["replicas"] for item in await world.deployments()} == {0}


async def test_an_instance_whose_robot_has_no_clear_node_is_not_started_and_one_that_runs_goes_on(
    world: ReconciledServer,
) -> None:
    await world.pool()
    uid = await world.app(robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}})
    world.cache.nodes.update({name: make_node(name, robot="amr-07") for name in ("one", "other")})
    assert await world.children.reconcile(uid, "amr-07")
    assert await world.deployments() == []
    assert await world.claims() == []
    del world.cache.nodes["other"]
    await world.children.reconcile(uid, "amr-07")
    await world.mirror()
    world.cache.nodes["other"] = make_node("other", robot="amr-07")
    assert await world.children.reconcile(uid, "amr-07")
    assert len(await world.deployments()) == 2


async def test_a_refused_spec_leaves_what_runs_alone(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    await world.edit("teleop", ros={"distro": "humbel"})
    before = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == before
    assert len(await world.deployments()) == 2


async def test_a_newer_operators_template_is_left_alone(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    for item in await world.deployments():
        mark = {"metadata": {"annotations": {Annotation.RENDERED_BY: "9.0.0", Annotation.CONTENT_HASH: "theirs"}}}
        await world.client.patch(DEPLOYMENTS, item["metadata"]["name"], mark, namespace="default")
    before = world.writes()
    assert await world.children.reconcile(uid, "")
    assert world.writes() == before


async def test_no_template_is_written_before_the_parameters_file_was_read(world: ReconciledServer) -> None:
    """Else every start of the operator would roll the pods twice: once for a file it has not seen, and back."""
    await world.pool()
    await world.client.create(CONFIGMAPS, configmap("drv", **{"params.yaml": "1"}))
    tuned = {
        "name": "driver",
        "image": "x",
        "args": ["run"],
        "parameters": [{"configMapKeyRef": {"name": "drv", "key": "params.yaml"}}],
    }
    uid = await world.app(components=[tuned])
    watching = asyncio.create_task(world.params.run())
    try:
        assert await world.children.reconcile(uid, "")
        (deployment,) = await world.deployments()
        marks = deployment["spec"]["template"]["metadata"]["annotations"]
        (app,) = [record.app for record in world.cache.apps.values()]
        assert app is not None
        kept = hashlib.sha256(b"1").hexdigest()[:32]  # in place of the file
        read = parameter_states(
            app, "", {"default/drv": msgspec.convert(configmap("drv", **{"params.yaml": kept}), ConfigMap)}
        )
        assert marks[Annotation.PARAMETERS_HASH] == read["driver"].hash
        await world.client.delete(ROBOTAPPS, "teleop", namespace="default")
        await world.children.reconcile(uid, "")
        assert repr(world.params) == "<ParamsWatch: 0 namespaces of 0 apps>"
    finally:
        watching.cancel()


async def test_an_app_that_is_not_accepted_makes_nobody_read_a_config_map(world: ReconciledServer) -> None:
    await world.pool()
    wrong = {
        "name": "driver",
        "image": "x",
        "args": ["run"],
        "parameters": [{"configMapKeyRef": {"name": "absent", "key": "params.yaml"}}],
        "colocateWith": ["nobody"],
    }
    uid = await world.app(components=[wrong])
    watching = asyncio.create_task(world.params.run())
    try:
        assert await world.children.reconcile(uid, "")
        assert not [path for _, path in world.api.requests if "/configmaps" in path]
        assert repr(world.params) == "<ParamsWatch: 0 namespaces of 0 apps>"
    finally:
        watching.cancel()


async def test_ros_1_needs_no_pool(world: ReconciledServer) -> None:
    uid = await world.app(ros={"distro": "noetic"}, ros2=None)
    assert await world.children.reconcile(uid, "")
    assert len(await world.deployments()) == 3
    assert await world.claims() == []


async def test_a_race_that_never_ends_is_given_back_to_the_queue(
    world: ReconciledServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    await world.pool()
    uid = await world.app()
    turns = 0

    async def never(*_: Any, **__: Any) -> Any:
        nonlocal turns
        turns += 1
        raise StartOver("somebody else was faster")

    monkeypatch.setattr("robotapp_operator.reconcile.instances.instance_reconciler.execute", never)
    with pytest.raises(StartOver):
        await world.children.reconcile(uid, "")
    assert turns == 4


async def test_an_existing_claim_is_adopted_after_a_crash(world: ReconciledServer) -> None:
    """The claim was created, the process died before the Deployments."""
    await world.pool()
    uid = await world.app()
    holder = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "namespace": "default",
        "name": "teleop",
        "uid": uid,
        "instance": "",
        "component": "",
    }
    spec = {"domain": {"pool": "default", "scope": "Cluster", "scopeValue": "", "id": 42}, "holder": holder}
    await world.client.create(ROBOTCLAIMS, {"metadata": {"name": "dds.default.c.42"}, "spec": spec})
    await world.children.reconcile(uid, "")
    assert {domain_of(item) for item in await world.deployments()} == {"42"}
    assert len(await world.claims()) == 1


async def test_a_refusal_of_what_is_no_longer_wanted_is_forgotten(
    world: ReconciledServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    await world.pool()
    uid = await world.app()
    await world.children.reconcile(uid, "")
    await world.mirror()
    (record,) = world.cache.apps.values()
    assert record.app is not None
    wanted = [part.model_dump(mode="json", by_alias=True, exclude_defaults=True) for part in record.app.spec.components]
    create = world.client.create

    async def refused(resource: Any, body: Any, **more: Any) -> Any:
        if resource is DEPLOYMENTS:
            raise Forbidden("exceeded quota: q", status=403, reason="Forbidden")
        return await create(resource, body, **more)

    monkeypatch.setattr(world.client, "create", refused)
    await world.edit("teleop", components=[*wanted, {"name": "extra", "image": "x"}])
    assert not await world.children.reconcile(uid, "")
    assert world.memory.of(uid).troubles[""][0] == Reason.QUOTA_REFUSED
    await world.edit("teleop", components=wanted)
    assert await world.children.reconcile(uid, "")
    assert world.memory.of(uid).troubles == {}


async def test_an_app_that_needs_no_domain_any_more_is_not_told_that_it_got_none(world: ReconciledServer) -> None:
    await world.pool(ids="7")
    await world.children.reconcile(await world.app("first"), "")
    uid = await world.app("second")
    await world.children.reconcile(uid, "")
    assert world.memory.of(uid).outcomes[""].reason == Reason.DOMAIN_EXHAUSTED
    await world.edit("second", ros={"distro": "noetic", "version": 1}, ros2=None)
    assert await world.children.reconcile(uid, "")
    assert world.memory.of(uid).outcomes == {}
