"""What the operator publishes beside statuses: fleet view, probe lists, open gates, health."""

from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from typing import Any

import aiohttp
import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.claims import objects
from tests.support.clients import client_for
from tests.support.factories import app_body, domain_claim, make_node, make_pod, robots

from robotapp_api.model.names import FLEET_CONFIG_MAP, OPERATOR_MANAGER, SCHEDULING_GATE, Label
from robotapp_claims.rules.objects import Pool
from robotapp_client import ApiClient, NotFound
from robotapp_client.api.resources import CONFIGMAPS, DOMAINPOOLS, NODETELEMETRIES, PODS, ROBOTCLAIMS
from robotapp_client.serving.access import Access, Caller
from robotapp_client.serving.tls import TlsPort, loaded
from robotapp_operator.health import Health
from robotapp_operator.plan.spec.objects import Telemetry
from robotapp_operator.queue.workqueue import Queue
from robotapp_operator.reconcile.domain_pools import Pools
from robotapp_operator.reconcile.fleet_view import FleetView
from robotapp_operator.reconcile.metrics import Metrics
from robotapp_operator.reconcile.probe_targets import Probes
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.reconcile.scheduling_gates import Gates
from robotapp_operator.watch.cache import Cache


class ViewedServer:
    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()

    def place(self, component: str, node: str, *, robot: str = "", name: str = "", **fields: Any) -> None:
        labels = {Label.COMPONENT.value: component, Label.INSTANCE.value: robot}
        meta = {"labels": labels, **fields.pop("metadata", {})}
        self.cache.pods.put(
            "uid-1", f"{component}-{robot}-{name}", make_pod(component, node=node, metadata=meta, **fields)
        )

    async def view(self) -> dict[str, str]:
        found = {item["metadata"]["name"]: item for item in (await self.client.list(CONFIGMAPS)).items}
        data: dict[str, str] = found.get(FLEET_CONFIG_MAP, {}).get("data", {})
        return data

    def writes(self) -> int:
        return sum(method != "GET" for method, _ in self.api.requests)


@pytest.fixture
async def world() -> AsyncIterator[ViewedServer]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield ViewedServer(api, client)


async def test_a_pools_status_is_written_when_it_changed_and_only_then(world: ViewedServer) -> None:
    pools = Pools(world.client, world.cache, now=lambda: datetime(2026, 1, 1, tzinfo=UTC))
    body = {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": "1-3"}}
    await world.client.create(DOMAINPOOLS, body)

    async def published() -> tuple[str, int]:
        """USED, and the writes it took."""
        world.cache.pools["default"] = await world.client.get(DOMAINPOOLS, "default", as_type=Pool)
        before = world.writes()
        await pools.publish("default")
        stored = await world.client.get(DOMAINPOOLS, "default")
        return stored["status"]["used"], world.writes() - before

    assert await published() == ("0/3", 1)
    world.cache.claims.put("uid-1", "c", domain_claim(1))
    assert await published() == ("1/3", 1)
    assert await published() == ("1/3", 0)
    await world.client.delete(DOMAINPOOLS, "default")
    world.cache.claims.drop("uid-1", "c")
    before = world.writes()
    await pools.publish("default")
    assert world.writes() == before + 1, "refused, and settled by the watch"
    world.cache.pools.clear()
    await pools.publish("default")
    assert (await world.client.list(DOMAINPOOLS)).items == []


async def test_a_pools_status_is_never_written_to_another_pool_of_the_same_name(world: ViewedServer) -> None:
    pools = Pools(world.client, world.cache, now=lambda: datetime(2026, 1, 1, tzinfo=UTC))
    for ids in ("1-3", "1-9"):
        body = {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": ids}}
        created = await world.client.create(DOMAINPOOLS, body)
        world.cache.pools.setdefault("default", msgspec.convert(created, Pool))
        if ids == "1-3":
            await world.client.delete(DOMAINPOOLS, "default")
    await pools.publish("default")
    assert "status" not in await world.client.get(DOMAINPOOLS, "default")


@pytest.mark.parametrize(
    ("quota", "status"),
    [
        ({}, "True"),
        ({"default": 3}, "True"),
        ({"default": 0}, "False"),
        ({"default": 0, "namespaces": {"team-a": 0}}, "False"),
        ({"default": 0, "namespaces": {"team-a": 2}}, "True"),
        ({"namespaces": {"team-a": 0}}, "True"),
    ],
)
async def test_a_pool_that_no_namespace_may_use_says_so(
    world: ViewedServer, quota: dict[str, Any], status: str
) -> None:
    pools = Pools(world.client, world.cache, now=lambda: datetime(2026, 1, 1, tzinfo=UTC))
    body = {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": "1-3", "quota": quota}}
    await world.client.create(DOMAINPOOLS, body)
    world.cache.pools["default"] = await world.client.get(DOMAINPOOLS, "default", as_type=Pool)
    await pools.publish("default")
    condition = (await pool_conditions(world))["Usable"]
    assert condition["status"] == status
    if status == "False":
        assert condition["reason"] == "QuotaIsZero"
        assert "leave it out for no limit" in condition["message"]


async def pool_conditions(world: ViewedServer, name: str = "default") -> dict[str, Any]:
    pool = await world.client.get(DOMAINPOOLS, name)
    return {condition["type"]: condition for condition in pool["status"]["conditions"]}


@pytest.mark.parametrize(
    ("claimed", "nearly", "full"),
    [(0, "False", "False"), (7, "False", "False"), (8, "True", "False"), (10, "True", "True")],
)
async def test_a_pool_says_when_it_is_nearly_full_and_when_it_is_full(
    world: ViewedServer, claimed: int, nearly: str, full: str
) -> None:
    pools = Pools(world.client, world.cache, now=lambda: datetime(2026, 1, 1, tzinfo=UTC))
    await world.client.create(DOMAINPOOLS, {"metadata": {"name": "default"}, "spec": {"ids": "1-10"}})
    world.cache.pools["default"] = await world.client.get(DOMAINPOOLS, "default", as_type=Pool)
    for number in range(1, claimed + 1):
        claim = objects.domain_claim(number)
        world.cache.claims.put("app-1", claim.name, claim)
    await pools.publish("default")
    conditions = await pool_conditions(world)
    assert (conditions["NearlyFull"]["status"], conditions["Full"]["status"]) == (nearly, full)
    metrics = Metrics()
    metrics.watch(Queue(clock=lambda: 0.0, jitter=lambda: 0.0), world.cache, world.client)
    text = metrics.render().decode()
    assert f'robotapp_operator_pool_claimed_ids{{pool="default"}} {claimed}.0' in text
    assert 'robotapp_operator_pool_ids{pool="default"} 10.0' in text


async def test_pools_of_one_network_with_common_ids_name_each_other_and_who_gives_way(world: ViewedServer) -> None:
    pools = Pools(world.client, world.cache, now=lambda: datetime(2026, 1, 1, tzinfo=UTC))
    for name, ids, created in (
        ("default", "1-50", "2026-01-01T00:00:00Z"),
        ("renamed", "40-60", "2026-02-01T00:00:00Z"),
    ):
        await world.client.create(DOMAINPOOLS, {"metadata": {"name": name}, "spec": {"ids": ids}})
        pool = await world.client.get(DOMAINPOOLS, name, as_type=Pool)
        meta = msgspec.structs.replace(pool.metadata, creation_timestamp=created)
        world.cache.pools[name] = msgspec.structs.replace(pool, metadata=meta)
    for name in ("default", "renamed"):
        await pools.publish(name)
    older = (await pool_conditions(world, "default"))["Overlapping"]
    younger = (await pool_conditions(world, "renamed"))["Overlapping"]
    assert (older["status"], younger["status"]) == ("True", "True")
    assert "renamed (ids 40-50)" in older["message"]
    assert younger["message"].startswith("DomainPool renamed gives no new ids, because DomainPool default (ids 40-50)")


async def test_a_pools_condition_keeps_its_time_while_its_status_stands(world: ViewedServer) -> None:
    today = datetime(2026, 1, 1, tzinfo=UTC)
    pools = Pools(world.client, world.cache, now=lambda: today)
    created = await world.client.create(
        DOMAINPOOLS, {"metadata": {"name": "default"}, "spec": {"scope": "Cluster", "ids": "1-3"}}
    )

    async def since() -> str:
        world.cache.pools["default"] = await world.client.get(DOMAINPOOLS, "default", as_type=Pool)
        await pools.publish("default")
        return str((await pool_conditions(world))["Usable"]["lastTransitionTime"])

    assert created
    assert await since() == "2026-01-01T00:00:00Z"
    today += timedelta(days=1)
    world.cache.claims.put("uid-1", "c", domain_claim(1))
    assert await since() == "2026-01-01T00:00:00Z"
    await world.client.patch(DOMAINPOOLS, "default", {"spec": {"quota": {"default": 0}}})
    assert await since() == "2026-01-02T00:00:00Z"


async def test_the_fleet_view_is_written_once_and_follows(world: ViewedServer) -> None:
    fleet = FleetView(world.client, world.cache)
    world.cache.update_app(app_body())
    world.cache.claims.put("uid-1", "c", domain_claim(7))
    world.place("driver", "amr-07")
    await fleet.publish("default")
    assert await world.view() == {"app.teleop": "domain=7 driver@amr-07 operator@-"}
    before = world.writes()
    await fleet.publish("default")
    assert world.writes() == before
    world.place("operator", "edge-1")
    await fleet.publish("default")
    assert await world.view() == {"app.teleop": "domain=7 driver@amr-07 operator@edge-1"}


async def test_the_fleet_view_goes_with_the_last_app_and_comes_back_when_deleted(world: ViewedServer) -> None:
    fleet = FleetView(world.client, world.cache)
    world.cache.update_app(app_body())
    await fleet.publish("default")
    await world.client.delete(CONFIGMAPS, FLEET_CONFIG_MAP, namespace="default")
    fleet.forget()
    await fleet.publish("default")
    assert await world.view()
    world.cache.forget_app("uid-1")
    await fleet.publish("default")
    assert (await world.client.list(CONFIGMAPS)).items == []


async def test_config_maps_that_an_operator_before_this_one_needed_are_deleted(world: ViewedServer) -> None:
    ours = {Label.MANAGED_BY.value: OPERATOR_MANAGER}
    for suffix, labels in (("", ours), ("-2", ours), ("-3", ours), ("-4", {})):
        meta = {"name": f"{FLEET_CONFIG_MAP}{suffix}", "namespace": "default", "labels": labels}
        await world.client.create(CONFIGMAPS, {"metadata": meta, "data": {"app.old": "domain=3"}})
    world.cache.update_app(app_body())
    assert await FleetView(world.client, world.cache).publish("default")
    left = {item["metadata"]["name"] for item in (await world.client.list(CONFIGMAPS)).items}
    assert left == {FLEET_CONFIG_MAP, f"{FLEET_CONFIG_MAP}-4"}, "the last one is somebody else's"
    assert await world.view() == {"app.teleop": "driver@- operator@-"}


async def test_bare_annotated_pods_are_shown_others_are_not(world: ViewedServer) -> None:
    marks = {"scheduler.robotics.io/dds-domain": "auto", "granted.robotics.io/dds-domain": "9"}
    world.cache.bare_pods.put("default", "lidar", make_pod("lidar", node="edge-1", metadata={"annotations": marks}))
    world.cache.bare_pods.put("default", "web", make_pod("web", node="edge-1"))
    await FleetView(world.client, world.cache).publish("default")
    assert await world.view() == {"pod.lidar": "domain=9 lidar@edge-1"}


async def test_a_config_map_of_somebody_else_is_left_alone(world: ViewedServer) -> None:
    body = {"metadata": {"name": FLEET_CONFIG_MAP, "namespace": "default"}, "data": {"a": "b"}}
    await world.client.create(CONFIGMAPS, body)
    world.cache.update_app(app_body())
    await FleetView(world.client, world.cache).publish("default")
    assert await world.view() == {"a": "b"}


async def test_agents_are_asked_for_the_pairs_in_use_and_no_longer_when_they_are_not(world: ViewedServer) -> None:
    edges = [{"topic": "/t", "from": "operator", "to": "@robot"}, {"topic": "/u", "from": "operator", "to": "driver"}]
    robot = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "r"}}}
    world.cache.update_app(app_body(edges=edges, robots=robot))
    world.cache.nodes.update(robots("r"))
    world.place("operator", "edge-1", robot="r")
    world.place("driver", "n-r", robot="r")
    for node in ("edge-1", "n-r"):
        stored = await world.client.create(NODETELEMETRIES, {"metadata": {"name": node}})
        world.cache.telemetry[node] = msgspec.convert(stored, Telemetry)
    probes = Probes(world.client, world.cache)
    await probes.publish()
    found = await world.client.get(NODETELEMETRIES, "edge-1")
    assert found["spec"]["probe"] == ["n-r"]
    before = world.writes()
    await probes.publish()
    assert world.writes() == before
    world.cache.forget_app("uid-1")
    await probes.publish()
    assert (await world.client.get(NODETELEMETRIES, "edge-1"))["spec"]["probe"] == []


async def test_pairs_are_of_pods_that_live_and_of_all_replicas(world: ViewedServer) -> None:
    edges = [{"topic": "/u", "from": "operator", "to": "driver"}]
    world.cache.update_app(app_body(edges=edges))
    world.place("driver", "amr")
    for name, node, fields in (
        ("live", "edge-2", {}),
        ("also", "edge-3", {}),
        ("evicted", "edge-1", {"status": {"phase": "Failed"}}),
        ("ending", "edge-4", {"metadata": {"deletionTimestamp": "2026-01-01T00:00:00Z"}}),
        ("waits", "", {}),
    ):
        world.place("operator", node, name=name, **fields)
    stored = await world.client.create(NODETELEMETRIES, {"metadata": {"name": "amr"}})
    world.cache.telemetry["amr"] = msgspec.convert(stored, Telemetry)
    await Probes(world.client, world.cache).publish()
    assert (await world.client.get(NODETELEMETRIES, "amr"))["spec"]["probe"] == ["edge-2", "edge-3"]


async def test_a_fleet_view_that_lost_a_race_is_written_by_the_next_call(
    world: ViewedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet = FleetView(world.client, world.cache)
    world.cache.update_app(app_body())
    assert await fleet.publish("default")
    world.place("operator", "edge-1")
    get = world.client.get

    async def stale(*args: Any, **more: Any) -> Any:
        found = await get(*args, **more)
        await world.client.patch(
            CONFIGMAPS, FLEET_CONFIG_MAP, {"metadata": {"annotations": {"a": "b"}}}, namespace="default"
        )
        return found

    with monkeypatch.context() as patched:
        patched.setattr(world.client, "get", stale)
        assert not await fleet.publish("default")
    assert await fleet.publish("default")
    assert await world.view() == {"app.teleop": "driver@- operator@edge-1"}


async def test_a_node_owns_its_telemetry_and_a_node_that_came_back_owns_it_anew(world: ViewedServer) -> None:
    stored = await world.client.create(NODETELEMETRIES, {"metadata": {"name": "n-r"}})
    world.cache.telemetry["n-r"] = msgspec.convert(stored, Telemetry)
    probes = Probes(world.client, world.cache)
    await probes.publish()
    for uid in ("first", "second"):
        world.cache.nodes["n-r"] = make_node("n-r", robot="r", uid=uid)
        await probes.publish()
        found = await world.client.get(NODETELEMETRIES, "n-r")
        (owner,) = found["metadata"]["ownerReferences"]
        assert (owner["kind"], owner["name"], owner["uid"]) == ("Node", "n-r", uid)
        world.cache.telemetry["n-r"] = msgspec.convert(found, Telemetry)
    before = world.writes()
    await probes.publish()
    assert world.writes() == before


async def test_an_owner_stays_while_its_node_is_not_in_the_cache(world: ViewedServer) -> None:
    owner = {"apiVersion": "v1", "kind": "Node", "name": "edge-1", "uid": "u"}
    body = {"metadata": {"name": "edge-1", "ownerReferences": [owner]}, "spec": {"probe": ["gone"]}}
    stored = await world.client.create(NODETELEMETRIES, body)
    world.cache.telemetry["edge-1"] = msgspec.convert(stored, Telemetry)
    await Probes(world.client, world.cache).publish()
    found = await world.client.get(NODETELEMETRIES, "edge-1")
    assert (found["spec"]["probe"], found["metadata"]["ownerReferences"]) == ([], [owner])


async def test_the_robot_is_its_primary_node_and_none_while_that_is_unclear(world: ViewedServer) -> None:
    robot = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "r"}}}
    world.cache.update_app(app_body(edges=[{"topic": "/t", "from": "operator", "to": "@robot"}], robots=robot))
    for name in ("one", "two"):
        world.cache.nodes[name] = make_node(name, robot="r")
    world.place("operator", "edge-1", robot="r")
    stored = await world.client.create(NODETELEMETRIES, {"metadata": {"name": "edge-1"}})
    world.cache.telemetry["edge-1"] = msgspec.convert(stored, Telemetry)
    probes = Probes(world.client, world.cache)
    await probes.publish()
    assert world.cache.telemetry["edge-1"].spec.probe == []
    world.cache.nodes["two"] = make_node("two", robot="r", robot_primary="true")
    await probes.publish()
    assert world.cache.telemetry["edge-1"].spec.probe == ["two"]


async def gated_pod(world: ViewedServer, *, domain: int = 7) -> dict[str, Any]:
    labels = {Label.APP_UID.value: "uid-1", Label.INSTANCE.value: "", Label.APP.value: "teleop"}
    body = {
        "metadata": {"name": "p", "namespace": "default", "labels": labels},
        "spec": {
            "schedulingGates": [{"name": "other/gate"}, {"name": SCHEDULING_GATE}],
            "containers": [{"name": "c", "env": [{"name": "ROS_DOMAIN_ID", "value": str(domain)}]}],
        },
    }
    stored = await world.client.create(PODS, body)
    pod = make_pod(
        "p",
        metadata={"labels": labels, "uid": stored["metadata"]["uid"]},
        schedulingGates=body["spec"]["schedulingGates"],
    )
    world.cache.pods.put("uid-1", "default/p", pod)
    return stored


async def claim(world: ViewedServer, phase: str) -> None:
    body = msgspec.to_builtins(domain_claim(7, phase=phase))
    body["metadata"] = {"name": body["metadata"]["name"]}
    created = await world.client.create(ROBOTCLAIMS, body)
    await world.client.replace(ROBOTCLAIMS, created | {"status": body["status"]}, subresource="status")


async def test_our_gate_opens_when_the_claim_stands_and_others_stay(world: ViewedServer) -> None:
    await gated_pod(world)
    await claim(world, "Reserved")
    assert await Gates(world.client, world.cache, ReconcileState()).open("uid-1", "")
    pod = await world.client.get(PODS, "p", namespace="default")
    assert pod["spec"]["schedulingGates"] == [{"name": "other/gate"}]


async def test_our_gate_stays_without_a_standing_claim(world: ViewedServer) -> None:
    await gated_pod(world)
    gates = Gates(world.client, world.cache, ReconcileState())
    assert not await gates.open("uid-1", "")
    await claim(world, "Draining")
    assert not await gates.open("uid-1", "")
    pod = await world.client.get(PODS, "p", namespace="default")
    assert {"name": SCHEDULING_GATE} in pod["spec"]["schedulingGates"]


async def test_a_404_that_does_not_name_the_pod_is_no_reason_to_forget_its_gate(
    world: ViewedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    await gated_pod(world)

    async def not_served(*_: Any, **__: Any) -> Any:
        raise NotFound("404 page not found", status=404)

    monkeypatch.setattr(world.client, "get", not_served)
    with pytest.raises(NotFound):
        await Gates(world.client, world.cache, ReconcileState()).open("uid-1", "")


async def test_a_gated_pod_in_another_namespace_does_not_make_the_apps_own_gates_wait(world: ViewedServer) -> None:
    await gated_pod(world)
    await claim(world, "Draining")
    app = app_body(uid="uid-1")
    app["metadata"]["namespace"] = "somewhere-else"
    world.cache.update_app(app)
    assert await Gates(world.client, world.cache, ReconcileState()).open("uid-1", "")


async def test_a_pod_that_is_gone_or_another_needs_no_gate(world: ViewedServer) -> None:
    await gated_pod(world)
    await world.client.delete(PODS, "p", namespace="default")
    assert await Gates(world.client, world.cache, ReconcileState()).open("uid-1", "")
    assert await Gates(world.client, world.cache, ReconcileState()).open("uid-1", "another instance")


async def page(port: int, path: str, token: str = "") -> tuple[int, str]:
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    async with (
        aiohttp.ClientSession(headers=headers) as session,
        session.get(f"https://127.0.0.1:{port}{path}", ssl=False) as answer,
    ):
        return answer.status, await answer.text()


class Door:
    """Lets one token in."""

    async def path(self, caller: Caller, verb: str, path: str) -> Access:
        if caller.token not in {"reader", "other"}:
            return Access.UNKNOWN_CALLER
        return Access.ALL if (caller.token, verb, path) == ("reader", "get", "/metrics") else Access.FORBIDDEN


async def test_health_is_told_to_everybody_and_metrics_to_who_may_get_them(unused_tcp_port: int) -> None:
    state = {"silence": 0.0, "overdue": 0.0, "stale": 0.0, "synced": False}
    health = Health(
        silence_s=lambda: float(state["silence"]),
        overdue_s=lambda: float(state["overdue"]),
        synced=lambda: bool(state["synced"]),
        staleness=lambda: {"pods": 1.0, "robotapps": float(state["stale"])},
        metrics=lambda: b"m 1\n",
        gate=Door(),
    )
    await health.start(unused_tcp_port, (await loaded(TlsPort())).current)
    try:
        assert (await page(unused_tcp_port, "/healthz"))[0] == 200
        assert (await page(unused_tcp_port, "/readyz"))[0] == 503
        state.update(silence=500.0, synced=True)
        assert await page(unused_tcp_port, "/healthz") == (503, "a watch has been silent for 500 s\n")
        state.update(silence=0.0, overdue=181.0)
        assert await page(unused_tcp_port, "/healthz") == (503, "work has been due for 181 s\n")
        assert (await page(unused_tcp_port, "/readyz"))[0] == 200
        state.update(overdue=0.0, stale=61.0)
        assert await page(unused_tcp_port, "/readyz") == (
            503,
            "changes go unseen, of robotapps (61 s); the log says why\n",
        )
        assert (await page(unused_tcp_port, "/healthz"))[0] == 200
        assert await page(unused_tcp_port, "/metrics", "reader") == (200, "m 1\n")
        status, text = await page(unused_tcp_port, "/metrics", "other")
        assert (status, "you may not get /metrics: ClusterRole robotapp-cluster-viewer may" in text) == (403, True)
        assert (await page(unused_tcp_port, "/metrics"))[0] == 401
    finally:
        await health.stop()


async def test_metrics_carry_controller_runtimes_names(world: ViewedServer) -> None:
    metrics = Metrics()
    metrics.watch(Queue(clock=lambda: 0.0, jitter=lambda: 0.0), world.cache, world.client)
    metrics.watch_staleness(lambda: {"robotapps": 12.0})
    with metrics.reconciling("status", 0.5) as result:
        result("error")
    metrics.bug()
    text = metrics.render().decode()
    for name in (
        'controller_runtime_reconcile_total{controller="robotapp-status",result="error"} 1.0',
        "controller_runtime_reconcile_errors_total",
        "controller_runtime_reconcile_panics_total",
        "controller_runtime_reconcile_time_seconds_count",
        "controller_runtime_active_workers",
        "workqueue_depth 0.0",
        "workqueue_queue_duration_seconds_sum",
        "workqueue_work_duration_seconds_count",
        "rest_client_requests_total",
        'robotapp_operator_watch_stale_seconds{resource="robotapps"} 12.0',
    ):
        assert name in text
