"""Laws of the status, whatever was observed: within the API's bounds, and still when nothing changes."""

import json
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.factories import component, make_app, round_trips, telemetry
from tests.support.seeds import count_examples

from robotapp_api.model.app.status import RobotAppStatus
from robotapp_api.model.instance import InstanceStatus
from robotapp_api.model.names import Condition, Reason
from robotapp_claims.rules.instances import Instance
from robotapp_operator.plan.diff.newer import Held
from robotapp_operator.plan.spec.covers import content_hash, covers
from robotapp_operator.plan.spec.text import stored_bytes
from robotapp_operator.plan.spec.validate import Problem
from robotapp_operator.plan.status.components import ComponentView
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts, of_instance
from robotapp_operator.plan.status.instance_status import render_instance, same_instance_status
from robotapp_operator.plan.status.latency import REST_S, EdgeKey, EdgeView, Rest, edge_views, publish, worst_first
from robotapp_operator.plan.status.status import MAX_STATUS_BYTES, render_status
from robotapp_operator.plan.status.troubled import MAX_TROUBLED

TEXT = st.text(max_size=2000)
NODES = st.sampled_from(["edge-1", "edge-2", "amr-07", "n" * 253])
REASONS = st.sampled_from(list(Reason))
TROUBLES = st.none() | st.tuples(REASONS, st.text(min_size=1, max_size=2000))
EDGES = [
    {"topic": f"/topic_{number}", "from": "a", "to": "b", "latency": {"budget": budget}}
    for number, budget in enumerate(["1ms", "30ms", "999999s"])
]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.sampled_from(["", "a", "100m", "1Gi"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
    max_leaves=12,
)


def views(name: str) -> st.SearchStrategy[ComponentView]:
    def some(ready: bool, **why_not: st.SearchStrategy[Any]) -> st.SearchStrategy[ComponentView]:
        return st.builds(
            ComponentView,
            name=st.just(name),
            replicas=st.integers(0, 32),
            ready=st.just(ready),
            exists=st.booleans(),
            bound=st.booleans(),
            rolling=st.booleans(),
            nodes=st.lists(NODES, max_size=3).map(lambda nodes: tuple(sorted(set(nodes)))),
            restarts=st.integers(0, 9999),
            **why_not,
        )

    why_not = some(False, reason=st.none() | REASONS, message=TEXT.map(lambda text: text[:1024]))
    return why_not | some(True, reason=st.none(), message=st.just(""))


VIEWS = {name: views(name) for name in "ab"}
HELD = st.lists(st.sampled_from([Held("x"), Held("y", "9.0.0", "0.1.0")]), max_size=2).map(tuple)
CLAIMS = st.lists(st.sampled_from(["dds.default.c.7", "dev.n1.can"]), max_size=2, unique=True).map(tuple)
CUT_OFF = st.lists(st.sampled_from(["p", "q"]), max_size=2).map(tuple)
DOMAINS = st.none() | st.integers(0, 232)
ROBOTS = st.lists(st.sampled_from(["", "amr-07", "amr-08"]), max_size=3, unique=True)
PROBLEMS = st.lists(st.builds(Problem, REASONS, st.just("spec.x"), TEXT), max_size=4).map(tuple)
NOTES = st.lists(TEXT, max_size=2).map(tuple)
BUGS = st.just("") | TEXT.map(lambda text: text[:512])


@st.composite
def instances(draw: st.DrawFn, robot: str) -> InstanceFacts:
    table = {"edge-1": telemetry("edge-1", amr_07=draw(st.floats(0, 90_000)))} if draw(st.booleans()) else {}
    placed = {name: draw(NODES) for name in ("a", "b") if draw(st.booleans())}
    edges = make_app(component("a"), component("b"), edges=EDGES).spec.edges
    return InstanceFacts(
        instance=Instance(robot, "amr-07" if robot else "", draw(st.sampled_from(["", "label one"])) if robot else ""),
        components=(draw(VIEWS["a"]), draw(VIEWS["b"])),
        edges=worst_first(edge_views(edges, placed=placed, robot_node="", round_trips=round_trips(table))),
        domain=draw(DOMAINS),
        needs_domain=draw(st.booleans()),
        devices_wanted=draw(st.integers(0, 3)),
        devices_held=draw(st.integers(0, 3)),
        claims=draw(CLAIMS),
        refusal=draw(TROUBLES),
        trouble=draw(TROUBLES),
        held=draw(HELD),
        robot_online=draw(st.booleans()),
        infrastructure_ready=draw(st.booleans()),
        cut_off=draw(CUT_OFF),
    )


@st.composite
def facts(draw: st.DrawFn, previous: dict[str, Any] | None = None) -> AppFacts:
    robots = draw(ROBOTS)
    return AppFacts(
        app=make_app(component("a"), component("b"), suspend=draw(st.booleans()), edges=EDGES),
        problems=draw(PROBLEMS),
        instances=tuple(draw(instances(robot)) for robot in sorted(robots)),
        previous=previous or {},
        now=draw(st.sampled_from(["2026-01-01T00:00:00Z", "2026-01-01T00:00:01Z"])),
        notes=draw(NOTES),
        rmw="rmw_fastrtps_cpp",
        discovery="Server",
        bug=draw(BUGS),
    )


def again(found: AppFacts, status: dict[str, Any], *, now: str) -> AppFacts:
    """The same observation a moment later, with the status as the API server returns it."""
    return AppFacts(
        app=found.app,
        problems=found.problems,
        notes=found.notes,
        instances=found.instances,
        previous=json.loads(json.dumps(status)),
        now=now,
        rmw=found.rmw,
        discovery=found.discovery,
        bug=found.bug,
    )


@given(facts())
@settings(deadline=None)
def test_every_status_is_within_the_bounds_of_the_api(found: AppFacts) -> None:
    status = render_status(found)
    RobotAppStatus.model_validate(status)
    assert [item["type"] for item in status["conditions"]] == [kind.value for kind in Condition]
    assert stored_bytes(status) <= MAX_STATUS_BYTES
    assert len(status["troubled"]) <= MAX_TROUBLED


@given(facts())
@settings(deadline=None)
def test_every_instance_is_within_the_bounds_of_the_api_and_settles(found: AppFacts) -> None:
    for instance in found.instances:
        first = render_instance(of_instance(found, instance, previous={}))
        InstanceStatus.model_validate(first)
        assert stored_bytes(first) <= MAX_STATUS_BYTES
        later = again(found, first, now="2027-01-01T00:00:00Z")
        second = render_instance(of_instance(later, instance, previous=later.previous))
        latest = again(found, second, now="2028-01-01T00:00:00Z")
        third = render_instance(of_instance(latest, instance, previous=latest.previous))
        assert same_instance_status(third, second)


@given(facts())
@settings(deadline=None)
def test_troubles_name_instances_of_the_app_once_and_none_that_is_only_well(found: AppFacts) -> None:
    troubles = render_status(found)["troubled"]
    by_name = {instance.name: instance for instance in found.instances}
    assert len({item["instance"] for item in troubles}) == len(troubles)
    for item in troubles:
        instance = by_name[item["instance"]]
        over = any(edge.met is False for edge in instance.edges)
        assert (
            not instance.ready or instance.unclear or instance.cut_off or over or instance.refusal or instance.trouble
        )


@given(facts())
@settings(deadline=None)
def test_a_status_settles_so_an_app_at_rest_is_never_written(found: AppFacts) -> None:
    """Phases look back one step (what ran is Degraded, what starts is Placing), so one round may move; no further one does."""
    first = render_status(found)
    second = render_status(again(found, first, now="2027-01-01T00:00:00Z"))
    assert render_status(again(found, second, now="2028-01-01T00:00:00Z")) == second


@given(facts())
@settings(deadline=None)
def test_ready_is_said_only_of_what_is_ready(found: AppFacts) -> None:
    status = render_status(found)
    (ready,) = [item for item in status["conditions"] if item["type"] == "Ready"]
    if ready["status"] == "True":
        assert not found.problems
        assert not found.app.spec.suspend
        assert found.instances
        assert all(view.ready for instance in found.instances for view in instance.components)
    else:
        assert ready["message"]


@given(facts(), facts())
@settings(deadline=None)
def test_transition_times_move_exactly_with_the_status(before: AppFacts, found: AppFacts) -> None:
    first = render_status(before)
    second = render_status(again(found, first, now="2030-01-01T00:00:00Z"))
    for old, new in zip(first["conditions"], second["conditions"], strict=True):
        moved = new["lastTransitionTime"] == "2030-01-01T00:00:00Z"
        assert moved == (old["status"] != new["status"])


TIMES_MS = st.none() | st.floats(0.1, 60)


def measured(*times_ms: float | None) -> list[EdgeView]:
    """An edge per time, each between its own pair of nodes."""
    found = []
    for number, time_ms in enumerate(times_ms):
        edge = {"topic": f"/t{number}", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}
        table = {} if time_ms is None else {"edge-1": telemetry("edge-1", amr=time_ms)}
        placed = {"operator": "edge-1", "driver": "amr"}
        found += edge_views(
            make_app(edges=[edge]).spec.edges, placed=placed, robot_node="", round_trips=round_trips(table)
        )
    return found


@given(st.lists(st.tuples(st.floats(0.1, 40), TIMES_MS, TIMES_MS), min_size=1, max_size=30))
@settings(deadline=None, max_examples=count_examples(50))
def test_published_figures_are_old_or_new_ones_worst_first_and_a_later_look_is_asked_for(
    rounds: list[tuple[float, float | None, float | None]],
) -> None:
    shown: dict[EdgeKey, EdgeView] = {}
    rest, now_s = Rest(), 0.0
    for pause_s, one, other in rounds:
        now_s += pause_s
        now = {view.key: view for view in measured(one, other)}
        found = publish(list(now.values()), shown, rest, now_s=now_s)
        assert found.edges == worst_first(found.edges)
        assert found.again_s > now_s
        for edge in found.edges:
            assert edge.figures in (now[edge.key].figures, shown[edge.key].figures if edge.key in shown else None)
            if edge.met != now[edge.key].met:
                assert found.again_s <= now_s + 2 * REST_S
        shown = {edge.key: edge for edge in found.edges}
        again = publish(list(now.values()), shown, rest, now_s=now_s)
        assert again.edges == found.edges, "looking twice shows the same"


@given(JSON)
def test_everything_covers_itself(value: Any) -> None:
    assert covers(value, value)
    assert content_hash(value) == content_hash(json.loads(json.dumps(value)))


@given(st.dictionaries(st.sampled_from("abc"), JSON, max_size=3), JSON)
def test_fields_the_server_adds_are_no_difference(wanted: dict[str, Any], extra: Any) -> None:
    assert covers(wanted | {"added": extra}, wanted)


@given(st.dictionaries(st.sampled_from("abc"), st.integers(1, 9), min_size=1), st.sampled_from("abc"))
def test_a_field_that_says_something_else_is_a_difference(wanted: dict[str, int], key: str) -> None:
    if key in wanted:
        assert not covers(wanted | {key: wanted[key] + 10}, wanted)
        assert not covers({name: value for name, value in wanted.items() if name != key}, wanted)
