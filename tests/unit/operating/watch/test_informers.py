"""Which change asks for which work."""

from collections.abc import Mapping
from typing import Any

import msgspec
import pytest
from tests.support.factories import app_body, component, domain_claim, make_app, make_node, make_pod, robots

from robotapp_api.model.names import SCHEDULING_GATE, Annotation, Label
from robotapp_claims.rules.objects import Meta, Pool
from robotapp_client import ApiClient, Change, Endpoint
from robotapp_operator.plan.render.instance_object import AppInstance, wanted_object
from robotapp_operator.plan.spec.objects import Deployment, Pod, ReplicaSet
from robotapp_operator.queue.work import BACKGROUND, Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.informers import BACK_S, ORPHAN_S, Informers

LABELS = {Label.APP_UID.value: "uid-1", Label.INSTANCE.value: "a"}
CHILDREN = Key(Work.CHILDREN, "uid-1", "a")
STATUS = Key(Work.STATUS, "uid-1")
INSTANCE = Key(Work.INSTANCE, "uid-1", "a")
OBSERVED = {STATUS, INSTANCE}
"""Something is to be told of instance a, and of no other."""
FLEET = Key(Work.FLEET, "ns/default")
POOL = Key(Work.POOL, "pool/default")
EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}


class InformedQueue:
    def __init__(self) -> None:
        self.now_s = 0.0
        self.cache = Cache()
        self.queue = Queue(clock=lambda: self.now_s, jitter=lambda: 0.0, background=BACKGROUND)
        self.swept = 0
        client = ApiClient(Endpoint("http://localhost"), user_agent="test")
        self.informers = Informers(
            client, self.cache, self.queue, namespaces=(), request_sweep=self._wake, clock=lambda: self.now_s
        )

    def _wake(self) -> None:
        self.swept += 1

    def see(self, handler: str, old: Any, new: Any, *, key: str = "default/x") -> set[Key]:
        """The keys a change asks for, however late."""
        kind = "ADDED" if old is None else "DELETED" if new is None else "MODIFIED"
        getattr(self.informers, handler)(Change(kind, key, old, new))
        self.now_s += 10
        return self.due()

    def due(self) -> set[Key]:
        found = set()
        while item := self.queue.pop() or self.queue.pop(background=True):
            found.add(item[0])
            self.queue.done(item[0])
        return found


@pytest.fixture
def world() -> InformedQueue:
    made = InformedQueue()
    made.cache.update_app(app_body())
    return made


def deployment(*, spec: Mapping[str, Any] = {}, status: Mapping[str, Any] = {}, **meta: Any) -> Deployment:
    metadata = {"name": "x", "namespace": "default", "uid": "d", "generation": 1, "labels": LABELS, **meta}
    return msgspec.convert({"metadata": metadata, "spec": dict(spec), "status": dict(status)}, Deployment)


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


def test_a_new_or_deleted_deployment_plans_its_instance(world: InformedQueue) -> None:
    assert world.see("_deployment", None, deployment()) == {CHILDREN, *OBSERVED}
    assert world.cache.deployments.of("uid-1")
    assert world.see("_deployment", deployment(), None) == {CHILDREN, *OBSERVED}
    assert not world.cache.deployments.of("uid-1")
    assert world.swept == 1


def test_a_deployments_progress_is_status_only(world: InformedQueue) -> None:
    revised = deployment(annotations={"deployment.kubernetes.io/revision": "2"})
    assert world.see("_deployment", deployment(), revised) == OBSERVED


def test_an_edited_deployment_is_looked_at_for_drift(world: InformedQueue) -> None:
    for edited in (
        deployment(generation=2),
        deployment(labels={**LABELS, "x": "y"}),
        deployment(ownerReferences=[{"uid": "o"}]),
    ):
        assert world.see("_deployment", deployment(), edited) == {CHILDREN, *OBSERVED}


def test_a_deployment_that_becomes_ready_plans_the_instance_of_an_app_with_an_order_alone(world: InformedQueue) -> None:
    owner = [{"kind": "RobotApp", "name": "teleop", "uid": "uid-1", "controller": True}]
    starting = deployment(ownerReferences=owner, spec={"replicas": 1})
    status = {"observedGeneration": 1, "replicas": 1, "updatedReplicas": 1, "readyReplicas": 1}
    ready = deployment(ownerReferences=owner, spec={"replicas": 1}, status=status)
    assert world.see("_deployment", starting, ready) == OBSERVED
    waits = component("mapper", dependsOn=[{"component": "driver"}])
    world.cache.update_app(app_body(generation=2, components=[component("driver"), waits]))
    assert world.see("_deployment", starting, ready) == {CHILDREN, *OBSERVED}
    assert world.see("_deployment", ready, ready) == OBSERVED
    up = msgspec.structs.replace(
        pod("n"), status=make_pod(status={"conditions": [{"type": "Ready", "status": "True"}]}).status
    )
    assert CHILDREN in world.see("_pod", pod("n"), up)
    assert CHILDREN not in world.see("_pod", up, up)


def test_a_service_plans_its_instance(world: InformedQueue) -> None:
    assert world.see("_service", None, deployment()) == {CHILDREN}


def test_a_replica_set_links_pods_to_their_deployment(world: InformedQueue) -> None:
    body = {
        "metadata": {
            "uid": "rs",
            "namespace": "default",
            "labels": LABELS,
            "ownerReferences": [{"uid": "d", "controller": True}],
        }
    }
    replica_set = msgspec.convert(body, ReplicaSet)
    assert world.see("_replica_set", None, replica_set) == OBSERVED
    assert world.cache.replica_sets == {"rs": "d"}
    assert world.see("_replica_set", replica_set, replica_set) == set()
    world.see("_replica_set", replica_set, None)
    assert world.cache.replica_sets == {}


def test_a_pods_life_is_status_and_its_place_the_fleets_business(world: InformedQueue) -> None:
    assert world.see("_pod", None, pod()) == {*OBSERVED, FLEET}
    assert world.see("_pod", pod(), pod("edge-1")) == {*OBSERVED, FLEET}
    assert world.see("_pod", pod("edge-1"), pod("edge-1")) == OBSERVED
    assert world.swept == 0
    assert world.see("_pod", pod("edge-1"), pod("edge-1", phase="Failed")) == OBSERVED
    assert world.see("_pod", pod("edge-1"), None) == {*OBSERVED, FLEET}
    assert world.swept == 2


def test_a_proposal_of_a_better_node_is_looked_at_at_once_where_a_budget_may_move_something(
    world: InformedQueue,
) -> None:
    meta = {"labels": LABELS, "annotations": {Annotation.BETTER_NODE.value: "{}"}}
    before, proposed = pod("edge-1"), make_pod(node="edge-1", metadata=meta)
    assert world.see("_pod", before, proposed) == OBSERVED
    world.cache.update_app(app_body(generation=2, placement={"reschedule": {"when": "BudgetExceeded"}}))
    for old, new in ((before, proposed), (proposed, before)):
        world.informers._pod(Change("MODIFIED", "default/x", old, new))
        assert world.due() == {Key(Work.MOVES, "uid-1", "a")}
        world.now_s += 10
        assert world.due() == OBSERVED
    assert world.see("_pod", proposed, proposed) == OBSERVED


def test_a_gated_pod_asks_for_its_gate(world: InformedQueue) -> None:
    assert Key(Work.GATES, "uid-1", "a") in world.see("_pod", None, pod(gates=(SCHEDULING_GATE,)))
    assert Key(Work.GATES, "uid-1", "a") not in world.see("_pod", None, pod(gates=("somebody/else",)))


def test_a_pod_whose_gate_was_taken_off_is_looked_at_once_more(world: InformedQueue) -> None:
    """Its nodes may have changed while that was written."""
    key = Key(Work.GATES, "uid-1", "a")
    assert key in world.see("_pod", pod(gates=(SCHEDULING_GATE,)), pod())
    assert key not in world.see("_pod", pod(), pod("edge-1"))


def test_what_nodes_admit_concerns_the_pods_of_other_schedulers(world: InformedQueue) -> None:
    world.see("_pod", None, pod())
    key = Key(Work.GATES, "uid-1", "a")
    before, after = make_node("n"), make_node("n", annotations={Annotation.ALLOWED_NAMESPACES.value: "theirs"})
    assert key not in world.see("_node", before, after)
    world.cache.update_app(app_body(generation=2, schedulerName="by-hand"))
    assert key in world.see("_node", before, after)
    assert key in world.see("_node", None, before)
    assert key not in world.see("_node", before, make_node("n", ready=False))


def test_a_bare_pod_is_only_in_the_fleet_view(world: InformedQueue) -> None:
    assert world.see("_bare_pod", None, make_pod()) == {FLEET}
    assert world.cache.bare_pods.of("default")
    assert world.see("_bare_pod", make_pod(), None) == {FLEET}
    assert not world.cache.bare_pods.of("default")


def test_a_claim_wakes_its_holder_and_a_freed_one_whoever_waits(world: InformedQueue) -> None:
    claim = domain_claim(7, instance="a")
    assert world.see("_claim", None, claim) == {CHILDREN, *OBSERVED, POOL}
    assert world.see("_claim", claim, None) == {CHILDREN, *OBSERVED, POOL, Key(Work.WAITING, "pool/default")}
    assert not world.cache.claims


def test_an_adoption_of_ours_is_no_news(world: InformedQueue) -> None:
    """Else a key that fails after it has adopted would wake itself for ever, and never back off."""
    claim = domain_claim(7, instance="a")
    adopted = msgspec.structs.replace(claim, status=msgspec.structs.replace(claim.status, attempt=1))
    assert world.see("_claim", claim, adopted) == OBSERVED
    drained = domain_claim(7, instance="a", phase="Draining")
    assert world.see("_claim", adopted, drained) == {CHILDREN, *OBSERVED, POOL}


def test_a_claim_ends_the_back_off_of_its_holder_and_of_its_pods_gates(world: InformedQueue) -> None:
    world.cache.update_app(app_body(generation=2, schedulerName="by-hand"))
    for key in (CHILDREN, Key(Work.GATES, "uid-1", "a")):
        world.queue.add(key)
        world.queue.pop()
        world.queue.retry(key, at_least_s=300)
    gates = Key(Work.GATES, "uid-1", "a")
    assert world.see("_claim", None, domain_claim(7, instance="a")) == {CHILDREN, *OBSERVED, POOL, gates}


def test_a_claim_wakes_whoever_joins_it_at_once(world: InformedQueue) -> None:
    world.cache.update_app(app_body("sharer", uid="uid-2", ros2={"shareWith": [{"name": "teleop"}]}))
    claims = [
        msgspec.structs.replace(domain_claim(number, instance=robot), metadata=Meta(name=robot))
        for number, robot in enumerate("abc", 1)
    ]
    for claim in claims[:2]:
        assert Key(Work.APP, "uid-2") in world.see("_claim", None, claim), "the only instance is no longer the only one"
    assert world.see("_claim", None, claims[2]) == {
        Key(Work.CHILDREN, "uid-1", "c"),
        Key(Work.INSTANCE, "uid-1", "c"),
        STATUS,
        POOL,
        Key(Work.CHILDREN, "uid-2", "c"),
    }
    assert Key(Work.APP, "uid-2") in world.see("_claim", claims[0], None)


def test_another_id_in_the_owners_templates_wakes_whoever_joins_it(world: InformedQueue) -> None:
    world.cache.update_app(app_body("sharer", uid="uid-2", ros2={"shareWith": [{"name": "teleop"}]}))
    container = {"name": "main", "env": [{"name": "ROS_DOMAIN_ID", "value": "7"}]}
    owner = {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "name": "teleop",
        "uid": "uid-1",
        "controller": True,
    }
    ours = deployment(ownerReferences=[owner])
    named = msgspec.structs.replace(ours, given={"template": {"spec": {"containers": [container]}}})
    assert Key(Work.APP, "uid-2") in world.see("_deployment", None, named)
    assert world.see("_deployment", named, named) == OBSERVED
    assert Key(Work.APP, "uid-2") in world.see("_deployment", named, None)


def test_somebody_elses_claim_fills_the_pool_and_makes_room_when_it_goes(world: InformedQueue) -> None:
    claim = domain_claim(7, uid="stranger")
    assert world.see("_claim", None, claim) == {POOL}
    assert world.see("_claim", claim, None) == {POOL, Key(Work.WAITING, "pool/default")}


def test_a_pool_wakes_whoever_waits_when_its_spec_changes_and_not_when_its_status_does(world: InformedQueue) -> None:
    waiting = Key(Work.WAITING, "pool/default")
    old, new = pool("1-3"), pool("1-4")
    assert world.see("_pool", None, old) == {POOL, waiting}
    assert world.see("_pool", old, new) == {POOL, waiting}
    assert world.see("_pool", new, msgspec.structs.replace(new, status={"used": "1/4"})) == {POOL}
    assert world.see("_pool", new, None) == {waiting}
    assert not world.cache.pools


def test_a_nodes_heartbeat_is_nobodys_business(world: InformedQueue) -> None:
    world.cache.update_app(app_body(uid="uid-2", robots=EACH))
    (node,) = robots("a").values()
    assert Key(Work.ROBOTS, "uid-2") in world.see("_node", None, node)
    assert world.see("_node", node, node) == set()


def test_a_nodes_label_or_owner_concerns_apps_that_choose_robots(world: InformedQueue) -> None:
    world.cache.update_app(app_body(uid="uid-2", robots=EACH))
    node = make_node("n", robot="a")
    for changed in (
        make_node("n", robot="b"),
        make_node("n", robot="a", annotations={Annotation.ALLOWED_NAMESPACES: "x"}),
    ):
        assert world.see("_node", node, changed) == {Key(Work.ROBOTS, "uid-2")}
    assert world.see("_node", node, None) == {Key(Work.ROBOTS, "uid-2")}
    assert world.cache.nodes == {}


def test_a_robot_that_is_out_of_reach_concerns_its_own_instances_and_who_takes_any(world: InformedQueue) -> None:
    world.cache.update_app(app_body(uid="uid-2", robots=EACH))
    world.cache.update_app(app_body(uid="uid-3", robots=EACH | {"assignment": "Any"}))
    for robot in ("a", "b"):
        child = msgspec.structs.replace(deployment(labels={Label.APP_UID: "uid-2", Label.INSTANCE: robot}))
        world.cache.deployments.put("uid-2", robot, child)
    ready, lost = make_node("n", robot="a"), make_node("n", robot="a", ready=False)
    world.see("_node", None, ready)
    assert world.see("_node", ready, lost) == {
        Key(Work.STATUS, "uid-2"),
        Key(Work.INSTANCE, "uid-2", "a"),
        Key(Work.ROBOTS, "uid-3"),
    }


def test_an_app_that_names_a_node_hears_of_nodes_that_come_and_go(world: InformedQueue) -> None:
    world.cache.update_app(app_body(uid="uid-2", placement={"masterNode": "n"}))
    assert world.see("_node", None, make_node("n")) == {Key(Work.ROBOTS, "uid-2")}


# RobotAppInstances


def instance_object(version: int = 5, *, uid: str = "u", app_uid: str = "uid-1", name: str = "teleop") -> AppInstance:
    body: dict[str, Any] = wanted_object(make_app(name=name, uid=app_uid), "a")
    body["metadata"] |= {"uid": uid, "resourceVersion": str(version)}
    return msgspec.convert(body, AppInstance)


def test_an_object_that_somebody_writes_or_deletes_is_looked_at(world: InformedQueue) -> None:
    assert world.see("_instance_object", None, instance_object()) == {INSTANCE}
    assert world.see("_instance_object", instance_object(), instance_object(6)) == {INSTANCE}
    assert world.see("_instance_object", instance_object(6), None) == {INSTANCE}
    assert world.cache.instance_object_named == {}


def test_the_echo_of_our_own_write_is_no_news(world: InformedQueue) -> None:
    world.cache.put_instance_object(instance_object(6))
    assert world.see("_instance_object", instance_object(5), instance_object(6)) == set()


def test_an_object_comes_back_after_a_moment_and_an_orphan_waits_for_its_app(world: InformedQueue) -> None:
    world.informers._instance_object(Change("DELETED", "k", instance_object(), None))
    assert world.queue.next_due_s() == BACK_S
    world.now_s += BACK_S
    assert world.due() == {INSTANCE}
    world.informers._instance_object(
        Change("ADDED", "k", None, instance_object(uid="v", app_uid="uid-9", name="unknown"))
    )
    assert world.queue.next_due_s() == ORPHAN_S


def test_what_bears_the_name_of_another_apps_object_concerns_that_app_too(world: InformedQueue) -> None:
    old = instance_object(app_uid="uid-0")
    assert world.see("_instance_object", None, old) == {Key(Work.INSTANCE, "uid-0", "a"), INSTANCE}
    assert world.see("_instance_object", old, None) == {Key(Work.INSTANCE, "uid-0", "a"), INSTANCE}


@pytest.mark.parametrize("handler", ["_deployment", "_service", "_replica_set", "_pod"])
def test_an_object_of_another_namespace_wakes_nobody_and_counts_for_nobody(world: InformedQueue, handler: str) -> None:
    forged = deployment(namespace="elsewhere", ownerReferences=[{"uid": "uid-1", "controller": True}])
    if handler == "_pod":
        forged = msgspec.structs.replace(pod("n", gates=(SCHEDULING_GATE,)), metadata=forged.metadata)
    assert world.see(handler, None, forged, key="elsewhere/x") == set()
    assert world.see(handler, forged, None, key="elsewhere/x") == set()
    world.see(handler, None, forged, key="elsewhere/x")
    assert world.cache.running_instances("uid-1") == set()
    assert world.cache.pods.on_node("n") == set()


def test_an_object_that_came_before_the_app_of_another_namespace_is_forgotten_with_its_event() -> None:
    world = InformedQueue()
    world.see("_deployment", None, deployment(namespace="elsewhere"), key="elsewhere/x")
    world.see("_deployment", None, deployment(labels=LABELS | {Label.INSTANCE.value: "b"}), key="default/x")
    assert world.cache.running_instances("uid-1") == {"a", "b"}
    world.cache.update_app(app_body())
    assert world.cache.running_instances("uid-1") == {"b"}


def test_a_pod_that_is_given_to_another_app_leaves_the_first(world: InformedQueue) -> None:
    world.cache.update_app(app_body("other", uid="uid-2"))
    mine = pod("edge-1")
    world.see("_pod", None, mine)
    theirs = make_pod(node="edge-1", metadata={"labels": {Label.APP_UID.value: "uid-2", Label.INSTANCE.value: "a"}})
    world.see("_pod", mine, theirs)
    assert not world.cache.pods.of("uid-1")
    assert world.cache.pods.on_node("edge-1") == {("uid-2", "a")}


@pytest.mark.parametrize("size", [10, 1000])
def test_a_pods_event_concerns_one_instance_however_many_there_are(world: InformedQueue, size: int) -> None:
    for number in range(size):
        labels = {Label.APP_UID.value: "uid-1", Label.INSTANCE.value: f"r-{number}"}
        world.cache.pods.put(
            "uid-1", f"p-{number}", make_pod(f"p-{number}", node="edge-1", metadata={"labels": labels})
        )
    assert world.see("_pod", pod(), pod("edge-1")) == {*OBSERVED, FLEET}


def test_no_config_map_is_watched_from_the_start(world: InformedQueue) -> None:
    assert not [found for found in world.informers.reflectors if "configmaps" in repr(found)]


def test_before_the_first_contact_nothing_is_synced(world: InformedQueue) -> None:
    assert not world.informers.synced
    assert world.informers.silence_s == float("inf")


def test_served_namespaces_have_watches_of_their_own() -> None:
    client = ApiClient(Endpoint("http://localhost"), user_agent="test")
    queue = Queue(clock=lambda: 0.0, jitter=lambda: 0.0)

    def count(*namespaces: str) -> int:
        found = Informers(client, Cache(), queue, namespaces=namespaces, request_sweep=lambda: None, clock=lambda: 0.0)
        return len(found.reflectors)

    assert count("a", "b") - count("a") == count() - 4


def test_a_master_that_is_ready_or_was_started_anew_has_its_nodes_looked_at(world: InformedQueue) -> None:
    def master(*, ready: bool, restarts: int = 0) -> Pod:
        started = {"running": {"startedAt": f"2026-01-01T10:{restarts:02}:30Z"}}
        status = {
            "conditions": [{"type": "Ready", "status": str(ready)}],
            "containerStatuses": [{"name": "master", "restartCount": restarts, "state": started}],
        }
        meta = {"labels": {**LABELS, Label.ROLE.value: "master"}, "creationTimestamp": "2026-01-01T10:00:00Z"}
        return make_pod("x", node="n", status=status, metadata=meta)

    waiting, running, again = master(ready=False), master(ready=True), master(ready=True, restarts=1)
    assert CHILDREN not in world.see("_pod", None, waiting)
    assert CHILDREN in world.see("_pod", waiting, running)
    assert CHILDREN not in world.see("_pod", running, running)
    assert CHILDREN in world.see("_pod", running, again), "no event came while it was not ready"
    assert CHILDREN not in world.see("_pod", again, None)
