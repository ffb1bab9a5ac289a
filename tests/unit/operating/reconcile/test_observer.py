"""Which facts are computed anew, when, and who hears of it."""

from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
import pytest
from tests.support.factories import app_body, domain_claim, make_app, make_deployment, make_node, make_pod, telemetry
from tests.unit.operating.controlling import place

from robotapp_api.model.names import Label, Reason
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_claims.rules.objects import Claim, OwnerReference
from robotapp_operator.plan.render.instance_object import AppInstance, wanted_object
from robotapp_operator.plan.spec.desired import LONGEST_S, App
from robotapp_operator.plan.spec.objects import ConfigMap, Node, ReplicaSet, Telemetry
from robotapp_operator.plan.status.facts import Grace, InstanceFacts
from robotapp_operator.reconcile import observer as module
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import wanted_instances
from robotapp_operator.watch.nodes import Nodes

UID = "uid-1"
NOW = "2026-01-01T00:00:00Z"
EDGE = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}


class ObservedApps:
    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 0.0
        self.cache = Cache()
        self.memory = ReconcileState()
        self.changed: list[tuple[str, str]] = []
        self.computed = 0
        self.observer = Observer(
            self.cache, self.memory, clock=lambda: self.now_s, on_change=lambda *which: self.changed.append(which)
        )
        real = module.instance_facts

        def counted(*args: Any, **kwargs: Any) -> InstanceFacts:
            self.computed += 1
            return real(*args, **kwargs)

        monkeypatch.setattr(module, "instance_facts", counted)

    def app(self, **spec: Any) -> App:
        found = self.cache.update_app(app_body(**spec)).app
        assert found is not None
        return found

    def facts(self, app: App) -> InstanceFacts:
        (instance,) = wanted_instances(app, self.cache)
        return self.observer.instance(app, instance)

    def measure(self, ms: float) -> None:
        """As the informers do."""
        self.cache.put_telemetry(telemetry("edge-1", amr=ms), now_s=0.0)
        self.cache.touch(UID, "")


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> ObservedApps:
    return ObservedApps(monkeypatch)


def test_facts_are_computed_once_and_remembered(world: ObservedApps) -> None:
    app = world.app()
    first = world.facts(app)
    assert world.facts(app) is first
    assert world.computed == 1
    assert world.changed == [], "who asks first needs no telling"


def test_an_event_that_changes_nothing_leaves_the_very_same_facts(world: ObservedApps) -> None:
    app = world.app()
    first = world.facts(app)
    world.cache.touch(UID, "")
    assert world.facts(app) is first
    assert world.computed == 2
    assert world.changed == []


def test_whatever_facts_depend_on_makes_others(world: ObservedApps) -> None:
    file = {"configMapKeyRef": {"name": "drv", "key": "k"}}
    parts = [{"name": "driver", "image": "x", "args": ["run"], "parameters": [file]}]
    robots = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "a"}}}
    world.cache.nodes["n"] = make_node("n", robot="a")
    app = world.app(components=parts, robots=robots)
    child = make_deployment("driver")
    owner = OwnerReference(uid=UID, controller=True)
    child.metadata = msgspec.structs.replace(child.metadata, owner_references=(owner,))
    child.metadata.labels.update({Label.COMPONENT: "driver", Label.INSTANCE: "a"})
    meta = {"namespace": "default", "labels": {Label.APP_UID: UID, Label.INSTANCE: "a"}}
    owned = {"uid": "rs", "ownerReferences": [{"uid": child.metadata.uid, "controller": True}]}
    replica_set = msgspec.convert({"metadata": meta | owned}, ReplicaSet)
    pod = make_pod(node="n", metadata=meta | {"ownerReferences": [{"uid": "rs", "controller": True}]})
    memory = world.memory.of(UID)
    found = [world.facts(app)]
    steps: list[Any] = [
        lambda: memory.outcomes.update(a=DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")),
        lambda: memory.troubles.update(a=(Reason.QUOTA_REFUSED, "no")),
        lambda: memory.held.update(a=("x",)),
        lambda: world.cache.nodes.update(n=make_node("n", robot="a", ready=False)),
        lambda: world.cache.nodes.update(m=make_node("m", robot="a")),
        lambda: world.cache.claims.put(UID, "c", domain_claim(7, instance="a")),
        lambda: world.cache.deployments.put(UID, "d", child),
        lambda: (world.cache.put_replica_set(replica_set), world.cache.pods.put(UID, "p", pod)),
    ]
    for step in steps:
        step()
        found.append(world.facts(app))
        assert found[-1] != found[-2], step
    assert world.changed == [(UID, "a")] * len(steps)
    computed = world.computed
    world.cache.config_maps["default/drv"] = msgspec.convert(
        {"metadata": {"name": "drv"}, "data": {"k": "1"}}, ConfigMap
    )
    world.facts(app)
    assert world.computed == computed + 1


def test_another_spec_makes_other_facts(world: ObservedApps) -> None:
    world.facts(world.app())
    world.facts(world.app(generation=2, components=[{"name": "only", "image": "x"}]))
    assert world.computed == 2
    assert world.changed == [(UID, "")]


CAN = {"metadata": {"name": "n"}, "status": {"devices": [{"id": "can0", "type": "can"}]}}


def test_who_waits_for_a_device_looks_again_when_one_changes_hands_and_others_do_not(world: ObservedApps) -> None:
    holder = {"apiVersion": "v1", "kind": "Pod", "namespace": "default", "name": "thief", "uid": "t"}
    thing = {"node": "n", "type": "can", "id": "can0"}
    claim = msgspec.convert({"metadata": {"name": "dev.n.can0"}, "spec": {"device": thing, "holder": holder}}, Claim)
    world.cache.nodes["n"] = make_node("n")
    world.cache.telemetry["n"] = msgspec.convert(CAN, Telemetry)
    waiting = world.app(components=[{"name": "a", "image": "x", "devices": [{"name": "bus", "type": "can"}]}])
    content = world.app(uid="uid-2", app_name="content")
    assert world.facts(waiting).busy == ""
    world.facts(content)
    computed = world.computed
    world.cache.claims.put("t", claim.name, claim)
    world.facts(content)
    assert world.computed == computed
    world.facts(waiting)
    assert world.computed == computed + 1


def test_who_borrows_a_domain_follows_its_owner(world: ObservedApps) -> None:
    sharer = world.app(uid="uid-2", app_name="sharer", ros2={"shareWith": [{"name": "teleop"}]})
    world.app()
    assert world.facts(sharer).domain is None
    world.cache.claims.put(UID, "c", domain_claim(7))
    assert world.facts(sharer).domain == 7


def test_figures_that_must_rest_are_looked_at_when_they_may_be_shown(world: ObservedApps) -> None:
    app = world.app(edges=[EDGE])
    place(world.cache, UID, operator="edge-1", driver="amr")
    world.measure(10)
    assert [edge.p95_us for edge in world.facts(app).edges] == [10_000]
    world.now_s = 5
    world.measure(15)
    first = world.facts(app)
    assert [edge.p95_us for edge in first.edges] == [10_000]
    assert world.memory.of(UID).instance("").facts_until_s == 60
    world.now_s = 59
    assert world.facts(app) is first
    world.now_s = 60
    assert [edge.p95_us for edge in world.facts(app).edges] == [15_000]
    assert world.changed == [(UID, "")]


def test_after_a_start_the_figures_that_are_shown_stand(world: ObservedApps) -> None:
    body = wanted_object(make_app(), "")
    body["metadata"] |= {"uid": "u", "resourceVersion": "1"}
    shown = {
        "kind": "Topic",
        "topic": "/t",
        "from": "operator",
        "to": "driver",
        "p95": "12ms",
        "measured": True,
        "met": True,
    }
    body["status"] = {"edges": [shown | {"nodes": ["edge-1", "amr"]}, {"p95": 3}, "nonsense"]}
    world.cache.put_instance_object(msgspec.convert(body, AppInstance))
    app = world.app(edges=[EDGE])
    place(world.cache, UID, operator="edge-1", driver="amr")
    world.measure(13)
    assert [edge.p95_us for edge in world.facts(app).edges] == [12_000]


@pytest.mark.parametrize("nodes", [["elsewhere", "amr"], [], None])
def test_after_a_start_figures_of_other_places_do_not_stand(world: ObservedApps, nodes: list[str] | None) -> None:
    body = wanted_object(make_app(), "")
    body["metadata"] |= {"uid": "u", "resourceVersion": "1"}
    body["status"] = {
        "edges": [{"kind": "Topic", "topic": "/t", "from": "operator", "to": "driver", "p95": "12ms", "nodes": nodes}]
    }
    world.cache.put_instance_object(msgspec.convert(body, AppInstance))
    app = world.app(edges=[EDGE])
    place(world.cache, UID, operator="edge-1", driver="amr")
    world.measure(13)
    assert [edge.p95_us for edge in world.facts(app).edges] == [13_000]


ON_A = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "a"}}}
NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)


def unready(name: str, *, since: str | None = None) -> Node:
    node = make_node(name, robot="a", ready=False)
    (condition,) = node.status.conditions
    condition.last_transition_time = since
    return node


def clocks(world: ObservedApps) -> None:
    """The caches tell the time by the test's clock; it is noon at second 0."""
    world.cache.nodes = Nodes(lambda: world.now_s, lambda: NOON + timedelta(seconds=world.now_s))


def test_a_robot_is_offline_only_when_its_grace_is_over_and_the_operator_looks_again_then(world: ObservedApps) -> None:
    clocks(world)
    world.cache.nodes["n"] = make_node("n", robot="a")
    app = world.app(robots=ON_A, connectivity={"grace": "30s"})
    assert not world.facts(app).offline
    world.now_s = 100
    world.cache.nodes["n"] = unready("n", since="1970-01-01T00:00:09Z")  # by the clock of the robot
    lost = world.facts(app)
    assert not lost.offline
    assert lost.grace == Grace("2026-01-01T12:01:40Z", "2026-01-01T12:02:10Z", 30.0)
    assert world.memory.of(UID).instance("a").facts_until_s == 130
    world.now_s = 129.9
    world.cache.nodes["n"] = unready("n", since="2026-01-01T12:02:00Z")  # False became Unknown: still not Ready
    assert world.facts(app) is lost
    world.changed.clear()
    world.now_s = 130
    assert world.facts(app).offline
    assert world.changed == [(UID, "a")]
    assert world.memory.of(UID).instance("a").facts_until_s == float("inf")
    world.cache.nodes["n"] = make_node("n", robot="a")
    assert world.facts(app).robot_online
    world.now_s = 140
    world.cache.nodes["n"] = unready("n")
    assert world.facts(app).grace is not None, "the next time has a grace of its own"


@pytest.mark.parametrize(
    ("since", "left_s"),
    [
        ("2026-01-01T11:59:50Z", 20.0),
        ("2026-01-01T11:59:00Z", None),
        ("2026-01-01T12:30:00Z", 30.0),
        ("yesterday", 30.0),
        (None, 30.0),
    ],
)
def test_a_restarted_operator_counts_the_grace_from_the_condition(
    world: ObservedApps, since: str | None, left_s: float | None
) -> None:
    clocks(world)
    world.cache.nodes["n"] = unready("n", since=since)
    facts = world.facts(world.app(robots=ON_A, connectivity={"grace": "30s"}))
    assert facts.offline is (left_s is None)
    assert world.memory.of(UID).instance("a").facts_until_s == (left_s or float("inf"))


@pytest.mark.parametrize(
    ("percentile", "before_ms", "after_ms", "met"),
    [(50, 20.0, 80.0, True), (50, 80.0, 20.0, False), (95, 30.04, 30.04, False), (95, 20.0, 40.0, True)],
)
def test_a_restarted_operator_keeps_the_verdict_until_another_one_has_lasted(
    world: ObservedApps, percentile: int, before_ms: float, after_ms: float, met: bool
) -> None:
    app = world.app(edges=[EDGE | {"latency": {"budget": "30ms", "percentile": percentile}}])
    place(world.cache, UID, driver="amr", operator="edge-1")
    world.measure(before_ms)
    (edge,) = world.facts(app).edges
    assert edge.met is met
    shown = {**dict(zip(("kind", "topic", "from", "to"), edge.key, strict=True)), "nodes": list(edge.nodes)}
    shown |= {"measured": True, "met": met, "p95": "30ms" if percentile == 95 and not met else f"{before_ms:g}ms"}
    stored = wanted_object(app, "") | {"status": {"edges": [shown]}}
    world.cache.put_instance_object(msgspec.convert(stored, AppInstance))
    world.memory = ReconcileState()
    world.observer = Observer(world.cache, world.memory, clock=lambda: world.now_s, on_change=lambda *_: None)
    world.measure(after_ms)
    (edge,) = world.facts(app).edges
    assert edge.met is met


def test_a_grace_longer_than_any_clock_counts_as_ten_years(world: ObservedApps) -> None:
    app = world.app(robots=ON_A, connectivity={"grace": "999999h999999h999999h"})
    assert app.grace_s == LONGEST_S
    world.cache.nodes["n"] = make_node("n", robot="a")
    assert not world.facts(app).offline


def test_another_grace_counts_at_once(world: ObservedApps) -> None:
    clocks(world)
    world.cache.nodes["n"] = make_node("n", robot="a")
    world.cache.nodes["n"] = unready("n")
    assert not world.facts(world.app(robots=ON_A)).offline
    world.now_s = 3
    assert world.facts(world.app(robots=ON_A, generation=2, connectivity={"grace": "2s"})).offline
    assert not world.facts(world.app(robots=ON_A, generation=3, connectivity={"grace": "9999h"})).offline


def test_a_component_on_a_node_that_is_not_ready_is_said_to_be_there(world: ObservedApps) -> None:
    world.cache.nodes["edge-1"] = make_node("edge-1")
    app = world.app()
    place(world.cache, UID, driver="edge-1")
    assert [item.message for item in world.facts(app).components] == [""] * len(app.spec.components)
    world.cache.nodes["edge-1"] = make_node("edge-1", ready=False)
    assert "node edge-1 is not Ready" in [item.message for item in world.facts(app).components]


def test_a_refused_app_is_observed_all_the_same_and_an_unreadable_one_is_not(world: ObservedApps) -> None:
    world.app(ros={"distro": "humbel"})
    facts = world.observer.app(world.cache.apps[UID], now=NOW)
    assert facts is not None
    assert facts.problems
    assert len(facts.instances) == 1
    record = world.cache.update_app(app_body(uid="uid-2", components="none"))
    assert world.observer.app(record, now=NOW) is None


def test_what_has_no_effect_yet_is_noted(world: ObservedApps) -> None:
    world.app(ros2={"transport": "SHM"})
    facts = world.observer.app(world.cache.apps[UID], now=NOW)
    assert facts is not None
    assert any("spec.ros2.transport" in note for note in facts.notes)


def test_everything_is_computed_anew_once_in_a_while(world: ObservedApps) -> None:
    app = world.app()
    world.facts(app)
    world.memory.forget_facts()
    world.facts(app)
    assert world.computed == 2
