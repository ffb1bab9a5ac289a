"""What is written and evicted, in which order, and what another operator makes of it after a crash."""

import json
from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.apiserver.store import Key
from tests.support.clients import client_for
from tests.support.factories import UID, app_body, component, make_node, telemetry

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.placement.better_node import BetterNode
from robotapp_claims.rules.instances import Instance
from robotapp_claims.rules.objects import Claim, TelemetryDevice
from robotapp_client import ApiClient, ServerError
from robotapp_client.api.resources import DEPLOYMENTS, PODS
from robotapp_client.tools.event_recorder import EventRecorder
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment, Pod, ReplicaSet
from robotapp_operator.queue.work import StartOver
from robotapp_operator.reconcile.mover import LOST_S, REFUSED_S, SETTLED_S, STAYS_S, Mover, concerns
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import instances_by_name

START = datetime(2026, 5, 1, 12, tzinfo=UTC)
EDGE = {"topic": "/t", "from": "planner", "to": "driver", "latency": {"budget": "30ms"}}
FOR_S = 15.0
CAMERA = {"name": "cam", "type": "usb", "interface": "cam"}


class Scene:
    """A planner on node far and a driver on node amr, 60 ms apart; node near is 8 ms away. Time is the test's."""

    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api, self.client = api, client
        self.now_s = 1000.0
        self.round = 0
        self.events: list[tuple[str, str]] = []
        self.devices: dict[str, list[TelemetryDevice]] = {}
        self.start()

    def start(self) -> None:
        """An operator that knows nothing but what the server has."""
        self.cache, self.memory = Cache(), ReconcileState()
        observer = Observer(self.cache, self.memory, clock=lambda: self.now_s, on_change=lambda *_: None)
        recorder = EventRecorder(self.client, controller="c", instance="i")
        recorder.event = lambda _, **event: self.events.append((event["reason"], event["note"]))  # type: ignore[method-assign]
        self.observer = observer
        self.mover = Mover(
            self.client,
            self.cache,
            self.memory,
            observer,
            recorder,
            enqueue=lambda *_: None,
            clock=lambda: self.now_s,
            now=lambda: START + timedelta(seconds=self.now_s),
        )
        for name in ("far", "near", "third", "amr"):
            self.cache.nodes[name] = make_node(name)

    async def app(self, *, on_loss: str = "", reschedule: dict[str, Any] | None = None, **fields: Any) -> None:
        planner = component("planner", **fields)
        if on_loss:
            planner["devices"] = [CAMERA | {"onLoss": on_loss}]
        self.body = app_body(
            components=[planner, component("driver")],
            edges=[EDGE],
            placement={"reschedule": reschedule or {"when": "BudgetExceeded"}},
        )
        for name, node in (("planner", "far"), ("driver", "amr")):
            labels = {Label.APP_UID.value: UID, Label.COMPONENT.value: name, Label.INSTANCE.value: ""}
            owner = {"apiVersion": "v", "kind": "RobotApp", "name": "teleop", "uid": UID, "controller": True}
            meta = {"name": name, "namespace": "default", "labels": labels, "ownerReferences": [owner]}
            body = {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": meta, "spec": {"replicas": 1}}
            await self.client.create(DEPLOYMENTS, body)
            await self.pod(name, node)
        await self.mirror()

    async def pod(self, name: str, node: str) -> None:
        """A new one; its predecessor has ended."""
        for item in (await self.client.list(PODS)).items:
            if item["metadata"]["name"] == name:
                self.api.store.delete(Key("/pods", "default", name), {}, graceful=False)
        labels = {Label.APP_UID.value: UID, Label.COMPONENT.value: name, Label.INSTANCE.value: ""}
        owner = {"apiVersion": "apps/v1", "kind": "ReplicaSet", "name": name, "uid": f"rs-{name}", "controller": True}
        meta = {"name": name, "namespace": "default", "labels": labels, "ownerReferences": [owner]}
        await self.client.create(
            PODS, {"apiVersion": "v1", "kind": "Pod", "metadata": meta, "spec": {"nodeName": node}}
        )

    async def mirror(self) -> None:
        """As the informers do."""
        self.cache.update_app(self.body)
        for item in (await self.client.list(DEPLOYMENTS, as_type=Deployment)).items:
            self.cache.deployments.put(UID, item.metadata.name, item)
            chain = {
                "uid": f"rs-{item.metadata.name}",
                "ownerReferences": [{"uid": item.metadata.uid, "controller": True}],
            }
            self.cache.put_replica_set(msgspec.convert({"metadata": chain}, ReplicaSet))
        pods = {pod.metadata.name: pod for pod in (await self.client.list(PODS, as_type=Pod)).items}
        for name in {*self.cache.pods.of(UID), *pods}:
            if name in pods:
                self.cache.pods.put(UID, name, pods[name])
            else:
                self.cache.pods.drop(UID, name)
        self.round += 1
        for node, ms in (("far", 60), ("near", 8)):
            report = telemetry(node, self.round, amr=ms)
            report.status.devices = self.devices.get(node, [])
            self.cache.put_telemetry(report, now_s=self.now_s)
        self.cache.touch(UID, "")

    async def propose(self, node: str = "near") -> None:
        better = BetterNode(node, "/t to driver", 60_000, 8_000, START + timedelta(days=30))
        patch = {"metadata": {"annotations": {Annotation.BETTER_NODE.value: better.text()}}}
        await self.client.patch(PODS, "planner", patch, namespace="default")

    async def look(self, *, later_s: float = 0.0) -> float | None:
        self.now_s += later_s
        await self.mirror()
        return await self.mover.look(UID, "")

    async def with_proposal(self, **app: Any) -> None:
        """The app's edge is over its budget, and its planner is proposed node near."""
        await self.app(**app)
        await self.propose()
        await self.look()

    async def late_with_proposal(self, **app: Any) -> None:
        """The same, and `for` is over: the planner is moved if it may be."""
        await self.with_proposal(**app)
        await self.look(later_s=FOR_S)

    async def pods(self) -> list[str]:
        """Those that are not on their way out."""
        metas = [item["metadata"] for item in (await self.client.list(PODS)).items]
        return sorted(meta["name"] for meta in metas if not meta.get("deletionTimestamp"))

    async def annotation(self, key: Annotation) -> Any:
        item = await self.client.get(DEPLOYMENTS, "planner", namespace="default")
        text = (item["metadata"].get("annotations") or {}).get(key.value)
        return json.loads(text) if text else None

    def stays(self) -> str:
        return self.memory.of(UID).instance("").stays

    def device_stays(self) -> str:
        return self.memory.of(UID).instance("").device_stays

    async def plug(self, *, present: bool, node: str = "far") -> None:
        """The camera of a node; the planner's pod holds that of node far."""
        self.devices[node] = [TelemetryDevice(id="usb-cam", type="usb", interface="cam", present=present)]
        self.cache.reported_devices += 1
        await self.mirror()
        pod = self.cache.pods.of(UID).get("planner")
        if node != "far" or pod is None:
            return
        self._claim("usb-cam", pod.metadata.uid, UID)

    def also_holds(self, *, pods: int) -> None:
        """Other apps' pods on node far, whose devices are gone."""
        for number in range(pods):
            device = f"other-{number}"
            self.devices["far"].append(TelemetryDevice(id=device, type="usb", interface="cam", present=False))
            self._claim(device, f"pod-{number}", f"app-{number}")

    def _claim(self, device: str, pod: str, app_uid: str) -> None:
        holder = {
            "apiVersion": "robotics.io/v1alpha1",
            "kind": "RobotApp",
            "namespace": "default",
            "name": "teleop",
            "uid": app_uid,
            "component": "planner",
        }
        claim = {
            "metadata": {"name": f"dev.n.{device}"},
            "spec": {"device": {"node": "far", "type": "usb", "id": device}, "holder": holder},
            "status": {"pod": pod},
        }
        self.cache.claims.put(app_uid, f"dev.n.{device}", msgspec.convert(claim, Claim))


@pytest.fixture
async def world() -> AsyncIterator[Scene]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield Scene(api, client)


async def test_a_move_is_recorded_first_then_the_pod_is_evicted_and_its_user_is_told(world: Scene) -> None:
    await world.app()
    await world.propose()
    assert await world.look() == FOR_S, "the budget must have been exceeded for a while"
    assert await world.pods() == ["driver", "planner"]
    world.api.requests.clear()
    evictions = _evictions(world)
    await world.look(later_s=FOR_S)
    writes = [f"{method} {path.rpartition('/')[2]}" for method, path in world.api.requests if method != "GET"]
    assert [write.partition("?")[0] for write in writes] == ["POST eviction", "PATCH planner", "POST eviction"]
    assert [is_trial(sent) for sent in evictions] == [True, False]
    assert await world.pods() == ["driver"]
    assert len((await world.annotation(Annotation.MOVES))["times"]) == 1
    assert world.events == [], "where its successor goes the scheduler decides"
    await world.look()
    await world.pod("planner", "near")
    for _ in range(2):
        await world.look()
        assert world.events == [
            ("Rescheduled", "planner moved from far to near: /t planner -> driver 60ms of 30ms before, 8ms expected")
        ]


@pytest.mark.parametrize(
    ("node", "text"),
    [
        ("third", "planner moved from far to third (near was proposed): /t planner"),
        ("far", "planner was evicted from far and came back, near was proposed: /t planner"),
    ],
)
async def test_the_event_names_the_node_that_the_successor_is_on(world: Scene, node: str, text: str) -> None:
    await world.late_with_proposal()
    await world.pod("planner", node)
    await world.look()
    ((reason, note),) = world.events
    assert reason == "Rescheduled"
    assert note.startswith(text)


async def test_what_a_proposal_may_name_tells_nothing_about_nodes_that_do_not_admit_the_namespace(world: Scene) -> None:
    """Whoever may annotate a pod writes it: with texts that differ they could ask for the robots of others, and whether they are on."""
    await world.app()
    closed = {Annotation.ALLOWED_NAMESPACES: "team-b"}
    world.cache.nodes["secret-on"] = make_node("secret-on", annotations=closed)
    world.cache.nodes["secret-off"] = make_node("secret-off", annotations=closed, ready=False)
    await world.look()
    world.now_s += FOR_S
    told = set()
    for node in ("secret-on", "secret-off", "nowhere"):
        await world.propose(node)
        await world.look()
        told.add(world.stays().replace(node, "NODE"))
    assert told == {"planner would have 8ms on NODE, but that node takes no pods of this namespace now"}


async def test_who_did_not_opt_in_stays_and_is_told_so(world: Scene) -> None:
    await world.late_with_proposal(reschedule={"when": "Never"})
    assert await world.pods() == ["driver", "planner"]
    assert "placement.reschedule.when is Never" in world.stays()
    facts = world.observer.instance(*read_instance(world))
    assert facts.stays == world.stays()


async def test_an_app_that_goes_to_another_scheduler_is_no_longer_told_why_it_stays(world: Scene) -> None:
    await world.late_with_proposal(reschedule={"when": "Never"})
    assert world.stays()
    world.body["spec"] |= {"schedulerName": "default-scheduler", "placement": {}}
    world.body["metadata"]["generation"] = 2
    await world.mirror()
    app, own = world.cache.apps[UID].app, world.memory.of(UID).instance("")
    assert concerns(app, own) if app is not None else False
    assert await world.look() is None
    assert (world.stays(), concerns(app, own)) == ("", False)


async def test_an_operator_that_ended_after_the_record_evicts_the_same_pod_and_counts_once(world: Scene) -> None:
    await world.with_proposal()
    world.now_s += FOR_S
    await world.mirror()
    post = world.client.post_raw

    async def dies(path: str, body: bytes) -> bytes:
        if is_trial(body):
            return await post(path, body)
        raise KeyboardInterrupt

    world.client.post_raw = dies  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        await world.mover.look(UID, "")
    world.client.post_raw = post  # type: ignore[method-assign]
    before = await world.annotation(Annotation.MOVES)
    assert len(before["times"]) == 1
    world.start()
    await world.look()
    await world.look(later_s=FOR_S)
    assert await world.pods() == ["driver"]
    assert await world.annotation(Annotation.MOVES) == before


async def test_a_new_operator_keeps_the_cooldown_of_its_predecessor(world: Scene) -> None:
    await world.late_with_proposal()
    await world.pod("planner", "far")  # the scheduler chose the same node again
    await world.propose()
    world.start()
    await world.look()
    await world.look(later_s=FOR_S)
    assert await world.pods() == ["driver", "planner"]
    assert "placement.reschedule.cooldown" in world.stays()
    assert await world.look() == STAYS_S, "the cooldown ends without an event"
    await world.look(later_s=120)
    assert await world.pods() == ["driver"]
    assert len((await world.annotation(Annotation.MOVES))["times"]) == 2


async def test_a_record_ahead_of_our_clock_is_written_with_the_present_and_ends_with_the_cooldown(world: Scene) -> None:
    await world.app()
    await world.propose()
    ahead = json.dumps({"times": ["2099-01-01T00:00:00Z"], "pod": "another"})
    await world.client.patch(
        DEPLOYMENTS, "planner", {"metadata": {"annotations": {Annotation.MOVES: ahead}}}, namespace="default"
    )
    assert await world.look() == SETTLED_S
    (time,) = (await world.annotation(Annotation.MOVES))["times"]
    assert time.startswith("2026-05-01T12:16:40")
    await world.look(later_s=1)
    await world.look(later_s=FOR_S)
    assert "placement.reschedule.cooldown, until 2026-05-01T12:18:40Z" in world.stays()
    await world.look(later_s=120)
    assert await world.pods() == ["driver"]


async def test_a_pod_that_a_disruption_budget_keeps_is_not_counted_and_tried_again(world: Scene) -> None:
    await world.with_proposal()
    world.now_s += FOR_S
    for _ in range(3):
        await world.mirror()
        refused = _refuse_eviction(world)
        assert await world.mover.look(UID, "") == REFUSED_S
        refused()
        assert "planner is not moved to near: Cannot evict pod" in world.stays()
    assert await world.annotation(Annotation.MOVES) is None, "another may replace the pod, and nothing was moved then"
    assert world.events == []
    await world.look()
    assert await world.pods() == ["driver"]
    assert len((await world.annotation(Annotation.MOVES))["times"]) == 1


async def test_a_disruption_budget_that_comes_in_between_has_the_move_counted_once(world: Scene) -> None:
    await world.with_proposal()
    world.now_s += FOR_S
    for _ in range(3):
        await world.mirror()
        refused = _refuse_eviction(world, trials=False)
        assert await world.mover.look(UID, "") == REFUSED_S
        refused()
    assert len((await world.annotation(Annotation.MOVES))["times"]) == 1
    await world.look()
    assert await world.pods() == ["driver"]
    assert len((await world.annotation(Annotation.MOVES))["times"]) == 1


async def test_where_a_webhook_cannot_be_tried_the_pod_is_evicted_all_the_same(world: Scene) -> None:
    await world.with_proposal()
    world.now_s += FOR_S
    await world.mirror()
    refused = _refuse_eviction(world, 400, 'admission webhook "w.example.org" does not support dry run', trials=True)
    await world.mover.look(UID, "")
    refused()
    assert await world.pods() == ["driver"]
    assert len((await world.annotation(Annotation.MOVES))["times"]) == 1


async def test_a_pod_that_several_disruption_budgets_cover_stays_and_its_user_is_told_so(world: Scene) -> None:
    """The API server answers 500 then: not a server in trouble, which is tried again without a word."""
    await world.with_proposal()
    world.now_s += FOR_S
    await world.mirror()
    text = "This pod has more than one PodDisruptionBudget, which the eviction subresource does not support."
    refused = _refuse_eviction(world, 500, text)
    assert await world.mover.look(UID, "") == REFUSED_S
    assert world.stays() == f"planner is not moved to near: {text}"
    refused()
    refused = _refuse_eviction(world, 503, "etcd is away")
    with pytest.raises(ServerError):
        await world.mover.look(UID, "")
    refused()


async def test_of_a_pod_that_was_replaced_meanwhile_nobody_is_told_that_it_moved(world: Scene) -> None:
    await world.with_proposal()
    world.now_s += FOR_S
    await world.mirror()
    await world.pod("planner", "far")
    await world.mover.look(UID, "")
    assert await world.pods() == ["driver", "planner"], "the eviction was meant for its predecessor"
    assert world.events == []


async def test_on_a_robot_that_is_out_of_reach_nothing_is_evicted(world: Scene) -> None:
    await world.with_proposal()
    world.cache.nodes["far"] = make_node("far", ready=False)
    await world.look(later_s=FOR_S)
    assert await world.pods() == ["driver", "planner"]


async def test_another_writer_of_the_deployment_makes_it_start_over(world: Scene) -> None:
    await world.app(on_loss="Restart")
    await world.plug(present=False)
    await world.look()
    world.now_s += LOST_S
    await world.mirror()
    await world.client.patch(DEPLOYMENTS, "planner", {"metadata": {"annotations": {"a": "b"}}}, namespace="default")
    with pytest.raises(StartOver):
        await world.mover.look(UID, "")


def read_instance(world: Scene) -> tuple[App, Instance]:
    """Returns the app and its one instance, as the caches show them."""
    app = world.cache.apps[UID].app
    assert app is not None
    return app, instances_by_name(app, world.cache)[""]


def is_trial(eviction: bytes) -> bool:
    return json.loads(eviction)["deleteOptions"].get("dryRun") == ["All"]


def _evictions(world: Scene) -> list[bytes]:
    """Bodies of the evictions that are sent from now on."""
    real, sent = world.client.post_raw, []

    async def noted(path: str, body: bytes) -> bytes:
        assert path.partition("?")[0].endswith("/eviction")
        sent.append(body)
        return await real(path, body)

    world.client.post_raw = noted  # type: ignore[method-assign, assignment]
    return sent


def _refuse_eviction(
    world: Scene,
    status: int = 429,
    message: str = "Cannot evict pod as it would violate the pod's disruption budget.",
    *,
    trials: bool | None = None,
) -> Any:
    """Until the result is called. trials: refuse dry runs alone (True) or all but dry runs (False)."""
    real = world.client.post_raw

    async def refuse(path: str, body: bytes) -> bytes:
        assert path.partition("?")[0].endswith("/eviction")
        if trials is not None and is_trial(body) is not trials:
            return await real(path, body)
        raise world.client.error_of(_Answer(status, message))  # type: ignore[arg-type]

    world.client.post_raw = refuse  # type: ignore[method-assign, assignment]

    def restore() -> None:
        world.client.post_raw = real  # type: ignore[method-assign]

    return restore


class _Answer:
    def __init__(self, status: int, message: str) -> None:
        self.status, self.headers = status, {"content-type": "application/json"}
        self.body = json.dumps({"kind": "Status", "code": status, "message": message}).encode()
