"""Which change asks for which work."""

from typing import Any

import msgspec
import pytest
from tests.support.factories import app_body, domain_claim, make_node, make_pod, robots, telemetry

from robotapp_api.claims.objects import Meta, Pool
from robotapp_api.client import ApiClient, Change, Endpoint
from robotapp_api.model.names import SCHEDULING_GATE, Annotation, Label
from robotapp_operator.cache import Cache
from robotapp_operator.informers import Informers
from robotapp_operator.keys import Work
from robotapp_operator.plan.objects import Deployment, Pod, ReplicaSet, Telemetry
from robotapp_operator.queue import Key, Queue

LABELS = {Label.APP_UID.value: "uid-1", Label.INSTANCE.value: "a"}
CHILDREN = Key(Work.CHILDREN, "uid-1", "a")
STATUS = Key(Work.STATUS, "uid-1")
FLEET = Key(Work.FLEET, "ns/default")
POOL = Key(Work.POOL, "pool/default")
EACH = {"selector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}


class World:
    def __init__(self) -> None:
        self.now_s = 0.0
        self.cache = Cache()
        self.queue = Queue(clock=lambda: self.now_s, jitter=lambda: 0.0)
        self.swept = 0
        client = ApiClient(Endpoint("http://localhost"), user_agent="test")
        self.informers = Informers(client, self.cache, self.queue, namespaces=(), wake_sweep=self._wake)

    def _wake(self) -> None:
        self.swept += 1

    def see(self, handler: str, old: Any, new: Any, *, key: str = "default/x") -> set[Key]:
        """The keys a change asks for, however late."""
        kind = "ADDED" if old is None else "DELETED" if new is None else "MODIFIED"
        getattr(self.informers, handler)(Change(kind, key, old, new))
        self.now_s += 10
        found = set()
        while item := self.queue.pop():
            found.add(item[0])
            self.queue.done(item[0])
        return found


@pytest.fixture
def world() -> World:
    made = World()
    made.cache.update_app(app_body())
    return made


def deployment(**meta: Any) -> Deployment:
    body = {"metadata": {"name": "x", "namespace": "default", "uid": "d", "generation": 1, "labels": LABELS, **meta}}
    return msgspec.convert(body, Deployment)


def pod(node: str = "", *, phase: str = "Running", gates: tuple[str, ...] = ()) -> Pod:
    found = make_pod(node=node, metadata={"labels": LABELS}, status={"phase": phase})
    return msgspec.structs.replace(
        found,
        spec=msgspec.convert(
            {"nodeName": node, "schedulingGates": [{"name": gate} for gate in gates]}, type(found.spec)
        ),
    )


def pool(ids: str) -> Pool:
    return msgspec.convert({"metadata": {"name": "default"}, "spec": {"ids": ids}}, Pool)


def test_a_new_or_deleted_deployment_plans_its_instance(world: World) -> None:
    assert world.see("_deployment", None, deployment()) == {CHILDREN, STATUS}
    assert world.cache.deployments.of("uid-1")
    assert world.see("_deployment", deployment(), None) == {CHILDREN, STATUS}
    assert not world.cache.deployments.of("uid-1")
    assert world.swept == 1


def test_a_deployments_progress_is_status_only(world: World) -> None:
    revised = deployment(annotations={"deployment.kubernetes.io/revision": "2"})
    assert world.see("_deployment", deployment(), revised) == {STATUS}


def test_an_edited_deployment_is_looked_at_for_drift(world: World) -> None:
    for edited in (
        deployment(generation=2),
        deployment(labels={**LABELS, "x": "y"}),
        deployment(ownerReferences=[{"uid": "o"}]),
    ):
        assert world.see("_deployment", deployment(), edited) == {CHILDREN, STATUS}


def test_a_service_plans_its_instance(world: World) -> None:
    assert world.see("_service", None, deployment()) == {CHILDREN}


def test_a_replica_set_links_pods_to_their_deployment(world: World) -> None:
    body = {"metadata": {"uid": "rs", "labels": LABELS, "ownerReferences": [{"uid": "d", "controller": True}]}}
    replica_set = msgspec.convert(body, ReplicaSet)
    assert world.see("_replica_set", None, replica_set) == {STATUS}
    assert world.cache.replica_sets == {"rs": "d"}
    assert world.see("_replica_set", replica_set, replica_set) == set()
    world.see("_replica_set", replica_set, None)
    assert world.cache.replica_sets == {}


def test_a_pods_life_is_status_and_its_place_the_fleets_business(world: World) -> None:
    assert world.see("_pod", None, pod()) == {STATUS, FLEET}
    assert world.see("_pod", pod(), pod("edge-1")) == {STATUS, FLEET}
    assert world.see("_pod", pod("edge-1"), pod("edge-1")) == {STATUS}
    assert world.swept == 0
    assert world.see("_pod", pod("edge-1"), pod("edge-1", phase="Failed")) == {STATUS}
    assert world.see("_pod", pod("edge-1"), None) == {STATUS, FLEET}
    assert world.swept == 2


def test_a_gated_pod_asks_for_its_gate(world: World) -> None:
    assert Key(Work.GATES, "uid-1", "a") in world.see("_pod", None, pod(gates=(SCHEDULING_GATE,)))
    assert Key(Work.GATES, "uid-1", "a") not in world.see("_pod", None, pod(gates=("somebody/else",)))


def test_a_bare_pod_is_only_in_the_fleet_view(world: World) -> None:
    assert world.see("_bare_pod", None, make_pod()) == {FLEET}
    assert world.cache.bare_pods.of("default")
    assert world.see("_bare_pod", make_pod(), None) == {FLEET}
    assert not world.cache.bare_pods.of("default")


def test_a_claim_wakes_its_holder_and_a_freed_one_whoever_waits(world: World) -> None:
    claim = domain_claim(7, instance="a")
    assert world.see("_claim", None, claim) == {CHILDREN, STATUS, POOL}
    assert world.see("_claim", claim, None) == {CHILDREN, STATUS, POOL, Key(Work.WAITING, "pool/default")}
    assert not world.cache.claims


def test_an_adoption_of_ours_is_no_news(world: World) -> None:
    """Else a key that fails after it has adopted would wake itself for ever, and never back off."""
    claim = domain_claim(7, instance="a")
    adopted = msgspec.structs.replace(claim, status=msgspec.structs.replace(claim.status, attempt=1))
    assert world.see("_claim", claim, adopted) == {STATUS}
    drained = domain_claim(7, instance="a", phase="Draining")
    assert world.see("_claim", adopted, drained) == {CHILDREN, STATUS, POOL}


def test_a_claim_ends_the_back_off_of_its_holder_and_of_its_pods_gates(world: World) -> None:
    world.cache.update_app(app_body(generation=2, schedulerName="by-hand"))
    for key in (CHILDREN, Key(Work.GATES, "uid-1", "a")):
        world.queue.add(key)
        world.queue.pop()
        world.queue.retry(key, at_least_s=300)
    gates = Key(Work.GATES, "uid-1", "a")
    assert world.see("_claim", None, domain_claim(7, instance="a")) == {CHILDREN, STATUS, POOL, gates}


def test_a_claim_wakes_whoever_joins_it_at_once(world: World) -> None:
    world.cache.update_app(app_body("sharer", uid="uid-2", dds={"shareWith": [{"name": "teleop"}]}))
    claims = [
        msgspec.structs.replace(domain_claim(number, instance=robot), metadata=Meta(name=robot))
        for number, robot in enumerate("abc", 1)
    ]
    for claim in claims[:2]:
        assert Key(Work.APP, "uid-2") in world.see("_claim", None, claim), "the only instance is no longer the only one"
    assert world.see("_claim", None, claims[2]) == {
        Key(Work.CHILDREN, "uid-1", "c"),
        STATUS,
        POOL,
        Key(Work.CHILDREN, "uid-2", "c"),
    }
    assert Key(Work.APP, "uid-2") in world.see("_claim", claims[0], None)


def test_another_id_in_the_owners_templates_wakes_whoever_joins_it(world: World) -> None:
    world.cache.update_app(app_body("sharer", uid="uid-2", dds={"shareWith": [{"name": "teleop"}]}))
    container = {"name": "main", "env": [{"name": "ROS_DOMAIN_ID", "value": "7"}]}
    named = msgspec.structs.replace(deployment(), spec={"template": {"spec": {"containers": [container]}}})
    assert Key(Work.APP, "uid-2") in world.see("_deployment", None, named)
    assert world.see("_deployment", named, named) == {STATUS}
    assert Key(Work.APP, "uid-2") in world.see("_deployment", named, None)


def test_somebody_elses_claim_fills_the_pool_and_makes_room_when_it_goes(world: World) -> None:
    claim = domain_claim(7, uid="stranger")
    assert world.see("_claim", None, claim) == {POOL}
    assert world.see("_claim", claim, None) == {POOL, Key(Work.WAITING, "pool/default")}


def test_a_pool_wakes_whoever_waits_when_its_spec_changes_and_not_when_its_status_does(world: World) -> None:
    waiting = Key(Work.WAITING, "pool/default")
    old, new = pool("1-3"), pool("1-4")
    assert world.see("_pool", None, old) == {POOL, waiting}
    assert world.see("_pool", old, new) == {POOL, waiting}
    assert world.see("_pool", new, msgspec.structs.replace(new, status={"used": "1/4"})) == {POOL}
    assert world.see("_pool", new, None) == {waiting}
    assert not world.cache.pools


def test_a_nodes_heartbeat_is_nobodys_business(world: World) -> None:
    world.cache.update_app(app_body(uid="uid-2", robots=EACH))
    (node,) = robots("a").values()
    assert Key(Work.APP, "uid-2") in world.see("_node", None, node)
    assert world.see("_node", node, node) == set()


def test_a_nodes_label_readiness_or_owner_plans_apps_with_robots(world: World) -> None:
    world.cache.update_app(app_body(uid="uid-2", robots=EACH))
    node = make_node("n", robot="a")
    for changed in (
        make_node("n", robot="b"),
        make_node("n", robot="a", ready=False),
        make_node("n", robot="a", annotations={Annotation.ALLOWED_NAMESPACES: "x"}),
    ):
        assert world.see("_node", node, changed) == {Key(Work.APP, "uid-2")}
    assert world.see("_node", node, None) == {Key(Work.APP, "uid-2")}
    assert world.cache.nodes == {}


def test_new_telemetry_concerns_apps_on_that_node(world: World) -> None:
    assert world.see("_telemetry", None, telemetry("edge-1")) == set()
    world.see("_pod", None, pod("edge-1"))
    assert world.see("_telemetry", None, telemetry("edge-1")) == {STATUS}
    assert world.see("_telemetry", None, telemetry("edge-2")) == set()


def test_a_device_that_comes_or_goes_concerns_every_app_that_wants_one(world: World) -> None:
    wanting = {"name": "a", "image": "x", "devices": [{"name": "bus", "type": "can"}]}
    world.cache.update_app(app_body(uid="uid-2", components=[wanting]))
    bare = telemetry("edge-1")
    fitted = msgspec.convert(
        {"metadata": {"name": "edge-1"}, "status": {"devices": [{"id": "can0", "type": "can"}]}}, Telemetry
    )
    found = Key(Work.STATUS, "uid-2")
    assert world.see("_telemetry", bare, fitted) == {found}
    assert world.see("_telemetry", fitted, fitted) == set()
    assert world.see("_telemetry", fitted, None) == {found}


def test_no_config_map_is_watched_from_the_start(world: World) -> None:
    assert not [found for found in world.informers.reflectors if "configmaps" in repr(found)]


def test_before_the_first_contact_nothing_is_synced(world: World) -> None:
    assert not world.informers.synced
    assert world.informers.silence_s == float("inf")


def test_served_namespaces_have_watches_of_their_own() -> None:
    client = ApiClient(Endpoint("http://localhost"), user_agent="test")
    queue = Queue(clock=lambda: 0.0, jitter=lambda: 0.0)

    def count(*namespaces: str) -> int:
        found = Informers(client, Cache(), queue, namespaces=namespaces, wake_sweep=lambda: None)
        return len(found.reflectors)

    assert count("a", "b") - count("a") == count() - 4
