"""What the operator writes into pods of other schedulers when it takes its gate off, and which of them it replaces."""

from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import app_body, make_node

from robotapp_api.model.names import SCHEDULING_GATE, Annotation, Label
from robotapp_client import ApiClient, NotFound
from robotapp_client.api.resources import PODS
from robotapp_operator.plan.spec.objects import Deployment, Pod, ReplicaSet
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.reconcile.scheduling_gates import Gates
from robotapp_operator.watch.cache import Cache

LABELS = {Label.APP_UID.value: "uid-1", Label.INSTANCE.value: "", Label.APP.value: "teleop"}
ALLOWED = Annotation.ALLOWED_NAMESPACES.value


def owner(kind: str, uid: str) -> list[dict[str, Any]]:
    return [{"apiVersion": "apps/v1", "kind": kind, "name": uid, "uid": uid, "controller": True}]


class GatedApp:
    """One component of an app of kube-scheduler's, and two robots; `amr-2` admits others only."""

    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()
        self.memory = ReconcileState()
        self.gates = Gates(client, self.cache, self.memory)
        self.cache.update_app(app_body(schedulerName="default-scheduler"))
        self.node("amr-1")
        self.node("amr-2", allowed="theirs")
        body = {"metadata": {"name": "d", "uid": "d-uid", "namespace": "default", "labels": LABELS}}
        self.cache.deployments.put("uid-1", "default/d", msgspec.convert(body, Deployment))
        replicas = {
            "name": "rs",
            "namespace": "default",
            "uid": "rs-uid",
            "labels": LABELS,
            "ownerReferences": owner("Deployment", "d-uid"),
        }
        self.cache.put_replica_set(msgspec.convert({"metadata": replicas}, ReplicaSet))

    def node(self, name: str, allowed: str | None = None) -> None:
        annotations = {} if allowed is None else {ALLOWED: allowed}
        self.cache.nodes[name] = make_node(name, robot=name, hostname=name, annotations=annotations)

    async def create(self, **spec: Any) -> None:
        body = {
            "metadata": {
                "name": "p", "namespace": "default", "labels": LABELS, "ownerReferences": owner("ReplicaSet", "rs-uid")
            },
            "spec": {
                "schedulerName": "default-scheduler", "schedulingGates": [{"name": SCHEDULING_GATE}],
                "containers": [{"name": "c"}], **spec,
            },
        }  # fmt: skip
        await self.client.create(PODS, body)
        await self.see()

    async def see(self) -> dict[str, Any]:
        """The pod as it is stored, in the cache as well."""
        stored = await self.client.get(PODS, "p", namespace="default")
        self.cache.pods.put("uid-1", "default/p", msgspec.convert(stored, Pod))
        return stored

    async def look(self) -> bool:
        return await self.gates.open("uid-1", "")

    @property
    def barred(self) -> int:
        return len(self.memory.of("uid-1").barred.get("", ()))

    def requests(self) -> int:
        return len(self.api.requests)


@pytest.fixture
async def world() -> AsyncIterator[GatedApp]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield GatedApp(api, client)


async def test_the_gate_goes_and_the_nodes_come_in_one_write(world: GatedApp) -> None:
    await world.create()
    before = world.requests()
    assert await world.look()
    assert [method for method, _ in list(world.api.requests)[before:]] == ["GET", "PATCH"]
    stored = await world.see()
    assert not stored["spec"].get("schedulingGates")
    (term,) = stored["spec"]["affinity"]["nodeAffinity"]["requiredDuringSchedulingIgnoredDuringExecution"][
        "nodeSelectorTerms"
    ]
    assert term == {"matchFields": [{"key": "metadata.name", "operator": "In", "values": ["amr-1"]}]}


async def test_a_pod_without_a_node_keeps_its_gate_and_is_not_tried_until_nodes_change(world: GatedApp) -> None:
    await world.create(nodeSelector={"robotics.io/robot": "amr-2"})
    assert await world.look(), "it waits for a node, so that trying again makes no sense"
    assert (await world.see())["spec"]["schedulingGates"]
    assert world.barred == 1
    world.node("amr-2", allowed="theirs, default")
    assert await world.look()
    assert world.barred == 0
    assert not (await world.see())["spec"].get("schedulingGates")


async def test_what_was_let_go_is_replaced_when_its_node_closes_and_not_looked_at_before(world: GatedApp) -> None:
    await world.create()
    await world.look()
    await world.see()
    before = world.requests()
    assert await world.look()
    assert world.requests() == before
    world.node("amr-1", allowed="theirs")
    assert await world.look()
    with pytest.raises(NotFound):
        await world.see()


async def test_a_pod_whose_gate_an_older_operator_took_off_is_replaced(world: GatedApp) -> None:
    await world.create(schedulingGates=[])
    assert await world.look()
    with pytest.raises(NotFound):
        await world.see()


async def test_a_pod_that_somebody_else_narrowed_is_left_alone_when_a_node_joins(world: GatedApp) -> None:
    world.node("amr-2")
    await world.create(schedulingGates=[], nodeSelector={"example.org/flavor": "spot"})
    before = world.requests()
    for name in ("amr-3", "amr-4"):
        world.node(name)
        assert await world.look()
    assert world.requests() == before, "where no node is closed, not even the pod is read"


async def test_a_pod_that_was_narrowed_is_replaced_when_another_robot_admits_it(world: GatedApp) -> None:
    await world.create()
    await world.look()
    await world.see()
    world.node("amr-3")
    assert await world.look()
    with pytest.raises(NotFound):
        await world.see()


async def test_what_runs_stays_whatever_its_node_admits(world: GatedApp) -> None:
    await world.create(schedulingGates=[], nodeName="amr-2")
    before = world.requests()
    assert await world.look()
    assert world.requests() == before


async def test_a_pod_that_was_bound_since_it_was_seen_stays(world: GatedApp) -> None:
    await world.create(schedulingGates=[])
    seen = await world.see()
    await world.client.replace(PODS, seen | {"spec": seen["spec"] | {"nodeName": "amr-2"}})
    assert await world.look()
    assert await world.see()


async def test_pods_of_our_scheduler_and_such_that_only_bear_the_labels_are_left_alone(world: GatedApp) -> None:
    await world.create(schedulingGates=[], schedulerName="ros-aware-scheduler")
    assert await world.look()
    assert await world.see()
    await world.client.delete(PODS, "p", namespace="default")
    world.cache.replica_sets.clear()
    await world.create(schedulingGates=[])
    assert await world.look()
    assert await world.see()


async def test_a_gate_that_is_off_already_is_not_taken_off_again(world: GatedApp) -> None:
    """The watch shows an earlier state; the node affinity of a pod without gates cannot change."""
    await world.create()
    cached = world.cache.pods.of("uid-1")["default/p"]
    await world.look()
    world.cache.pods.put("uid-1", "default/p", cached)
    world.node("amr-1", allowed="theirs")
    before = world.requests()
    assert await world.look()
    assert [method for method, _ in list(world.api.requests)[before:]] == ["GET"]


async def test_a_gate_that_its_controller_took_away_meanwhile_is_not_added_again(world: GatedApp) -> None:
    await world.create(schedulingGates=[{"name": SCHEDULING_GATE}, {"name": "example.org/quota"}])
    await world.client.patch(PODS, "p", {"spec": {"schedulingGates": [{"name": SCHEDULING_GATE}]}}, namespace="default")
    assert await world.look()
    assert not (await world.see())["spec"].get("schedulingGates")
