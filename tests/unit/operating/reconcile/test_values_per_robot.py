"""Overrides and configuration of single robots, from the nodes and ConfigMaps to the Deployments and events."""

import asyncio
from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, configmap, until
from tests.support.factories import app_body, component, make_node, robots
from tests.unit.operating.controlling import StubbedController

from robotapp_api.model.names import Annotation, EventReason, Label
from robotapp_claims.rules.instances import Instance
from robotapp_client import ApiClient
from robotapp_client.api.resources import CONFIGMAPS, DEPLOYMENTS, ROBOTAPPS
from robotapp_operator.plan.render.deployments import component_jobs
from robotapp_operator.plan.spec.desired import App, Domain, desired_of, is_edited
from robotapp_operator.plan.spec.objects import Deployment, Job
from robotapp_operator.plan.spec.robot_values import overridden
from robotapp_operator.plan.status.events import PendingEvent
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.reconcile.instances.instance_reconciler import InstanceReconciler
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch import lister
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch

EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}
START = datetime(2026, 5, 1, 12, tzinfo=UTC)
ROS_1 = {"ros": {"distro": "noetic"}}
SLOW = {
    "name": "slow",
    "nodeSelector": {"matchLabels": {"topology.kubernetes.io/zone": "slow"}},
    "components": [{"name": "driver", "image": "reg/driver:slow", "env": [{"name": "SPEED", "value": "1"}]}],
}


class Fleet:
    """A server and one operator's children; the clock is the test's."""

    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()
        self.now = START
        self.events: list[PendingEvent] = []
        self.params = ParamsWatch(client, self.cache, Queue(clock=lambda: 0.0, jitter=lambda: 0.0), pause_s=0.0)
        self.children = InstanceReconciler(
            client,
            self.cache,
            ReconcileState(),
            self.params,
            version="1.0.0",
            clock=lambda: float(self.now.timestamp()),
            now=lambda: self.now,
            announce=self._note,
        )

    def _note(self, _: App, event: PendingEvent) -> None:
        self.events.append(event)

    async def app(self, **spec: Any) -> str:
        body = app_body(**{**ROS_1, "robots": EACH, **spec})
        body["metadata"] = {"name": "teleop", "namespace": "default"}
        return self.cache.update_app(await self.client.create(ROBOTAPPS, body)).uid

    async def reconcile(self, uid: str, robot: str) -> dict[str, Any]:
        """Returns the driver's pod template, once what was written is in the cache."""
        self.now += timedelta(minutes=1)
        assert await self.children.reconcile(uid, robot)
        found: dict[str, Any] = {}
        for item in (await self.client.list(DEPLOYMENTS, as_type=Deployment)).items:
            self.cache.deployments.put(item.metadata.labels[Label.APP_UID], item.metadata.name, item)
            if item.metadata.labels.get(Label.COMPONENT) == "driver" and item.metadata.instance == robot:
                found = item.spec["template"]
        return found


@pytest.fixture
async def fleet() -> AsyncIterator[Fleet]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        made = Fleet(api, client)
        watching = asyncio.create_task(made.params.run())
        yield made
        watching.cancel()
        await asyncio.wait([watching])


def image_of(template: dict[str, Any]) -> str:
    image: str = template["spec"]["containers"][0]["image"]
    return image


async def test_a_robots_node_decides_what_it_runs_and_a_node_out_of_sight_changes_nothing(fleet: Fleet) -> None:
    uid = await fleet.app(components=[component("driver"), component("operator")], overrides=[SLOW])
    fleet.cache.nodes.update({"n-a": make_node("n-a", robot="a", zone="slow"), **robots("b")})
    assert image_of(await fleet.reconcile(uid, "a")) == "reg/driver:slow"
    assert image_of(await fleet.reconcile(uid, "b")) == "reg/driver:1"
    # While which node is the robot's is unknown, its pods stay as they are.
    fleet.cache.nodes["n-a2"] = make_node("n-a2", robot="a")
    assert image_of(await fleet.reconcile(uid, "a")) == "reg/driver:slow"
    fleet.cache.nodes.pop("n-a2")
    fleet.cache.nodes["n-a"] = make_node("n-a", robot="a", zone="quick")
    assert image_of(await fleet.reconcile(uid, "a")) == "reg/driver:1"
    assert fleet.events == []


async def test_another_content_starts_pods_anew_with_an_event_that_names_it(fleet: Fleet) -> None:
    driver = component("driver", envFrom=[{"configMapRef": {"name": "env-$(ROBOTAPP_ROBOT)"}}])
    for robot in ("a", "b"):
        await fleet.client.create(CONFIGMAPS, configmap(f"env-{robot}", speed="1"))
    fleet.cache.nodes.update(robots("a", "b"))
    uid = await fleet.app(components=[driver])
    before = {robot: await fleet.reconcile(uid, robot) for robot in ("a", "b")}
    assert Annotation.CONFIG_HASH not in before["a"]["metadata"].get("annotations", {})
    known = fleet.cache.config_maps["default/env-a"]
    await fleet.client.patch(CONFIGMAPS, "env-a", {"data": {"speed": "2"}}, namespace="default")
    await until(lambda: fleet.cache.config_maps["default/env-a"] != known)
    after = {robot: await fleet.reconcile(uid, robot) for robot in ("a", "b")}
    assert after["a"] != before["a"]
    assert after["b"] == before["b"]
    assert fleet.events == [
        PendingEvent(EventReason.CONFIG_CHANGED, "robot a: driver starts anew: ConfigMap env-a changed", warning=False)
    ]
    assert await fleet.reconcile(uid, "a") == after["a"]
    assert len(fleet.events) == 1


async def test_an_instance_that_ends_has_its_config_maps_followed_no_more(fleet: Fleet) -> None:
    driver = component("driver", envFrom=[{"configMapRef": {"name": "env-$(ROBOTAPP_ROBOT)"}}])
    for robot in ("a", "b"):
        await fleet.client.create(CONFIGMAPS, configmap(f"env-{robot}", speed="1"))
    fleet.cache.nodes.update(robots("a", "b"))
    uid = await fleet.app(components=[driver])
    for robot in ("a", "b"):
        await fleet.reconcile(uid, robot)
    assert set(fleet.cache.config_maps) == {"default/env-a", "default/env-b"}
    del fleet.cache.nodes["n-b"]
    fleet.cache.nodes["n-b"] = make_node("n-b")
    await fleet.children.reconcile(uid, "b")
    assert set(fleet.cache.config_maps) == {"default/env-a"}


async def test_a_nodes_new_label_wakes_the_instance_whose_overrides_it_changes_and_no_other() -> None:
    world = StubbedController()
    world.cache.update_app(app_body(robots=EACH, overrides=[SLOW]))
    world.cache.nodes.update(robots("a", "b"))
    await world.handle(Key(Work.APP, "uid-1"))
    world.due(60)
    world.cache.nodes["n-a"] = make_node("n-a", robot="a", zone="slow")
    await world.handle(Key(Work.ROBOTS, "uid-1"))
    assert {key for key in world.due(60) if key.work == Work.CHILDREN} == {Key(Work.CHILDREN, "uid-1", "a")}


async def test_a_change_that_waits_is_looked_at_when_its_time_has_come_and_not_again_and_again(fleet: Fleet) -> None:
    await fleet.client.create(CONFIGMAPS, configmap("speeds", max="0"))
    fleet.cache.nodes.update(robots("a"))
    uid = await fleet.app(components=[component("driver", envFrom=[{"configMapRef": {"name": "speeds"}}])])
    templates = [await fleet.reconcile(uid, "a")]
    for number in range(1, 6):  # a minute apart, so that the fourth restart has to wait for two
        before = fleet.cache.config_maps["default/speeds"]
        await fleet.client.patch(CONFIGMAPS, "speeds", {"data": {"max": str(number)}}, namespace="default")
        await until(lambda before=before: fleet.cache.config_maps["default/speeds"] != before)
        templates.append(await fleet.reconcile(uid, "a"))
    assert templates[5] == templates[4] != templates[3]
    assert len(fleet.events) == 4
    due_s = fleet.children.due_s(uid, "a")
    assert 0 < due_s <= 120
    fleet.now += timedelta(seconds=due_s)
    assert fleet.children.due_s(uid, "a") == 0
    assert await fleet.reconcile(uid, "a") != templates[5]
    assert len(fleet.events) == 5


async def test_overrides_of_one_robot_leave_what_is_computed_for_all_of_the_app(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The spec is checked once for all robots, however many variants of it there are."""
    checked: list[App] = []
    check = lister.problems_alone

    def count(app: App) -> Any:
        checked.append(app)
        return check(app)

    monkeypatch.setattr(lister, "problems_alone", count)
    uid = await fleet.app(components=[component("driver")], overrides=[SLOW])
    fleet.cache.nodes.update({"n-a": make_node("n-a", robot="a", zone="slow"), **robots("b")})
    for _ in range(3):
        for robot in ("a", "b"):
            await fleet.reconcile(uid, robot)
    assert len(checked) == 1


def put_job(cache: Cache, app: App, robot: str, *, verdict: str = "Complete", domain: int = 7) -> Job:
    """Puts the driver's Job of a robot into the cache, as it was made for the robot's overrides."""
    (child,) = component_jobs(desired_of(app, robot), domain=Domain(domain), parameters={}, running=True)
    body = child.body(app, version="1.0.0")
    body["metadata"] |= {"uid": f"job-{robot}"}
    body["status"] = {"conditions": [{"type": verdict, "status": "True"}] if verdict else []}
    job = msgspec.convert(body, Job)
    cache.jobs.put(app.uid, child.ref.name, job)
    return job


def test_a_job_of_a_robot_out_of_sight_is_not_run_again_without_the_robots_overrides() -> None:
    cache = Cache()
    body = app_body(components=[component("driver", job={})], robots=EACH, overrides=[SLOW])
    app = cache.update_app(body).app
    assert app is not None
    job = put_job(cache, overridden(app, {"driver": ("slow",)}), "amr-1")
    seen = lister.app_of_instance(app, Instance("amr-1", missing=True), cache)
    assert seen.spec.components[0].image == "reg/driver:slow"
    assert not is_edited(seen, "driver", job)
