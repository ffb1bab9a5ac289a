"""Which keys of the queue a node's telemetry adds: round-trip times, devices, and times that grew too old."""

import msgspec
import pytest
from tests.support.factories import app_body, make_node, make_pod, telemetry
from tests.unit.operating.watch.test_informers import EACH, OBSERVED, InformedQueue, pod

from robotapp_api.model.names import Label
from robotapp_client import Change
from robotapp_operator.plan.spec.objects import Telemetry
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key


@pytest.fixture
def world() -> InformedQueue:
    made = InformedQueue()
    made.cache.update_app(app_body())
    return made


PROBES = Key(Work.PROBES, "")
EDGE = {"topic": "/t", "from": "operator", "to": "driver"}


def test_new_round_trip_times_concern_instances_with_both_ends_there(world: InformedQueue) -> None:
    world.cache.update_app(app_body(generation=2, edges=[EDGE]))
    assert world.see("_telemetry", None, telemetry("edge-1", amr=3)) == set()
    for name, node, instance in (("p", "edge-1", "a"), ("q", "amr", "a"), ("r", "edge-1", "b"), ("s", "other", "b")):
        labels = {Label.APP_UID.value: "uid-1", Label.INSTANCE.value: instance}
        world.cache.pods.put("uid-1", name, make_pod(name, node=node, metadata={"labels": labels}))
    before, after = telemetry("edge-1", amr=3, other=4), telemetry("edge-1", amr=5, other=4)
    world.see("_telemetry", None, before)
    version = world.cache.version_of("uid-1", "a"), world.cache.version_of("uid-1", "b")
    assert world.see("_telemetry", before, after) == OBSERVED
    assert world.cache.version_of("uid-1", "a") > version[0]
    assert world.cache.version_of("uid-1", "b") == version[1]
    assert world.see("_telemetry", after, after) == set()
    assert world.see("_telemetry", telemetry("amr"), telemetry("amr", edge_1=3)) == OBSERVED
    assert world.see("_telemetry", telemetry("amr", edge_1=3), None) == OBSERVED


def test_an_app_that_moves_for_its_budgets_is_looked_at_in_the_moment_of_a_report_others_when_their_status_is(
    world: InformedQueue,
) -> None:
    moves = Key(Work.MOVES, "uid-1", "a")
    limits = {"reschedule": {"when": "BudgetExceeded"}}
    world.cache.nodes["amr"] = make_node("amr", robot="a")
    world.see("_pod", None, pod("edge-1"))
    for generation, spec, hurried in (
        (2, {}, set()),
        (3, {"placement": limits}, {moves}),
        (4, {"placement": limits, "schedulerName": "default-scheduler"}, set()),
    ):
        edge = EDGE | {"to": "@robot", "latency": {"budget": "30ms"}}
        world.cache.update_app(app_body(generation=generation, edges=[edge], robots=EACH, **spec))
        world.informers._telemetry(Change("MODIFIED", "edge-1", None, telemetry("edge-1", amr=3 * generation)))
        assert world.due() == hurried
        world.now_s += 10
        assert world.due() - {PROBES} == OBSERVED


def test_the_robot_itself_is_an_end(world: InformedQueue) -> None:
    world.cache.update_app(app_body(generation=2, edges=[EDGE | {"to": "@robot"}], robots=EACH))
    world.cache.nodes["amr"] = make_node("amr", robot="a")
    world.see("_pod", None, pod("edge-1"))
    assert world.see("_telemetry", None, telemetry("edge-1", amr=3)) == {*OBSERVED, PROBES}
    assert world.see("_telemetry", None, telemetry("amr", edge_1=3)) == {*OBSERVED, PROBES}


def test_a_time_that_grew_too_old_concerns_its_instances_though_no_event_comes(world: InformedQueue) -> None:
    world.cache.update_app(app_body(generation=2, edges=[EDGE | {"to": "@robot"}], robots=EACH))
    world.cache.nodes["amr"] = make_node("amr", robot="a")
    world.see("_pod", None, pod("edge-1"))
    report = telemetry("edge-1", 1, amr=3)
    world.see("_telemetry", None, report)
    received_s = world.now_s - 10
    for _ in range(2):
        assert world.see("_telemetry", report, report) == set(), "as when the operator asks for other probes"
    world.informers.expire()
    assert world.now_s == received_s + 30
    world.now_s += 10
    assert world.due() == OBSERVED
    assert world.cache.round_trips.between("edge-1", "amr") is None
    assert world.see("_telemetry", report, report) == set()
    assert world.see("_telemetry", report, telemetry("edge-1", 2, amr=3)) == OBSERVED


def test_apps_without_edges_do_not_mind_round_trip_times(world: InformedQueue) -> None:
    world.see("_pod", None, pod("edge-1"))
    assert world.see("_telemetry", None, telemetry("edge-1", edge_1=3)) == {PROBES}


def test_an_agent_that_begins_on_a_node_in_use_is_asked_for_its_pairs(world: InformedQueue) -> None:
    assert world.see("_telemetry", None, telemetry("edge-1")) == set()
    world.see("_pod", None, pod("edge-2"))
    assert world.see("_telemetry", None, telemetry("edge-2")) == {PROBES}
    assert world.see("_telemetry", telemetry("edge-2"), telemetry("edge-2")) == set()
    world.cache.nodes["amr"] = make_node("amr", robot="a")
    assert world.see("_telemetry", None, telemetry("amr")) == {PROBES}


def test_a_device_that_comes_or_goes_concerns_every_app_that_wants_one(world: InformedQueue) -> None:
    wanting = {"name": "a", "image": "x", "devices": [{"name": "bus", "type": "can"}]}
    world.cache.update_app(app_body(uid="uid-2", components=[wanting]))
    bare = telemetry("edge-1")
    fitted = msgspec.convert(
        {"metadata": {"name": "edge-1"}, "status": {"devices": [{"id": "can0", "type": "can"}]}}, Telemetry
    )
    found, versions = Key(Work.STATUS, "uid-2"), {world.cache.devices_version}
    assert world.see("_telemetry", bare, fitted) == {found}
    versions.add(world.cache.devices_version)
    assert world.see("_telemetry", fitted, fitted) == set()
    versions.add(world.cache.devices_version)
    assert world.see("_telemetry", fitted, None) == {found}
    versions.add(world.cache.devices_version)
    assert len(versions) == 3


def test_telemetry_that_its_node_does_not_own_yet_is_written(world: InformedQueue) -> None:
    owned = Key(Work.PROBES, "")
    assert world.see("_telemetry", None, telemetry("n")) == set()
    assert world.see("_node", None, make_node("n", uid="u")) == {owned}
    assert world.see("_telemetry", telemetry("n"), telemetry("n")) == {owned}
    owner = {"apiVersion": "v1", "kind": "Node", "name": "n", "uid": "u"}
    mine = msgspec.convert({"metadata": {"name": "n", "ownerReferences": [owner]}}, Telemetry)
    assert world.see("_telemetry", telemetry("n"), mine) == set()
