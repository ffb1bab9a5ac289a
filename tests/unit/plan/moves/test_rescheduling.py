"""Who is moved because of a budget, and who stays and why."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app, round_trips, telemetry

from robotapp_api.values.placement.better_node import BetterNode
from robotapp_operator.plan.moves.move_record import NO_MOVES, MoveRecord
from robotapp_operator.plan.moves.rescheduling import Move, Running, Stays, reschedule
from robotapp_operator.plan.status.latency import between, edge_views

NOW = datetime(2026, 5, 1, 12, tzinfo=UTC)
OPTED_IN = {"reschedule": {"when": "BudgetExceeded"}}
EDGE = {"topic": "/t", "from": "planner", "to": "driver", "latency": {"budget": "30ms"}}
PARTS = (component("planner"), component("driver", runsOn=["Robot"]), component("map"))
PLACES = {"planner": "far", "driver": "amr"}
TIMES = {"far": telemetry("far", amr=60, near=5), "near": telemetry("near", amr=8)}
GOOD = BetterNode("near", "/t to driver", 60_000, 8_000, NOW + timedelta(minutes=1))


def decide(
    *,
    parts: tuple[dict[str, Any], ...] = PARTS,
    edges: tuple[dict[str, Any], ...] = (EDGE,),
    placement: Mapping[str, Any] = OPTED_IN,
    better: BetterNode | None = GOOD,
    record: MoveRecord | None = NO_MOVES,
    times: Mapping[str, Any] = TIMES,
    lasts: bool = True,
    lasting: str = "",
    unusable: str = "",
    unreadable: str = "",
    map_on: str = "near",
) -> Move | Stays | None:
    """The planner is far from the driver, and the scheduler knows a node that is near."""
    app = make_app(*parts, edges=list(edges), placement=dict(placement))
    table = round_trips(times)
    places = PLACES | {"map": map_on}
    views = edge_views(app.spec.edges, placed=places, robot_node="amr", round_trips=table)
    running = {
        one.name: Running(component=one, pod=f"{one.name}-uid", node=places[one.name], record=NO_MOVES)
        for one in app.spec.components
    }
    planner = app.spec.components[0]
    running["planner"] = Running(
        component=planner, pod="planner-uid", node="far", record=record, better=better, unreadable=unreadable
    )
    return reschedule(
        app,
        views,
        over={view.key for view in views if view.met is False and lasting in view.edge.topic} if lasts else (),
        running=running,
        between=lambda one, other: between(one, other, table),
        unusable=lambda _: unusable,
        now=NOW,
    )


def why(**given: Any) -> str:
    found = decide(**given)
    assert isinstance(found, Stays)
    assert found.component == "planner" or not found.why
    return found.why


def test_a_component_that_opted_in_moves_to_where_its_edge_is_within_its_budget() -> None:
    assert decide() == Move(
        "planner", "planner-uid", "far", "near", "/t planner -> driver 60ms of 30ms before, 8ms expected"
    )


def test_nothing_is_decided_while_no_required_edge_has_been_over_its_budget_for_long_enough() -> None:
    assert decide(lasts=False) is None
    preferred = EDGE | {"latency": {"budget": "30ms", "enforce": "Preferred"}}
    assert decide(edges=(preferred,)) is None


def test_who_did_not_opt_in_is_told_where_it_would_be_better() -> None:
    assert why(placement={}) == "planner would have 8ms on near, but placement.reschedule.when is Never"


def test_without_a_proposal_that_holds_nothing_is_said() -> None:
    assert why(better=None) == ""
    assert why(better=GOOD._replace(expires=NOW)) == ""
    assert why(better=GOOD._replace(node="far")) == ""
    assert "is not of the form" in why(unreadable="is not of the form {…}")


def test_what_runs_on_its_robot_alone_or_in_several_copies_stays() -> None:
    assert why(parts=(component("planner", runsOn=["Robot"]), *PARTS[1:])) == ""
    assert why(parts=(component("planner", replicas=2), *PARTS[1:])) == ""


def test_the_time_that_another_edge_would_have_there_moves_nobody() -> None:
    other = {"topic": "/m", "from": "planner", "to": "map", "latency": {"budget": "30ms"}}
    times = {"far": telemetry("far", amr=31, cloud=90), "near": telemetry("near", cloud=5)}
    about_map = GOOD._replace(edge="/m to map", after_us=5_000)
    found = why(edges=(EDGE, other), times=times, map_on="cloud", better=about_map, lasting="/t")
    assert found == "near is proposed for planner, but the time of /t planner -> driver there is not measured"
    near = {**times, "near": telemetry("near", cloud=5, amr=8)}
    found = decide(edges=(EDGE, other), times=near, map_on="cloud", better=about_map, lasting="/t")
    assert isinstance(found, Move)
    assert found.why == "/t planner -> driver 31ms of 30ms before, 8ms expected"


def test_a_proposal_for_the_sake_of_one_edge_moves_for_it_whatever_another_does() -> None:
    brief = {"topic": "/brief", "from": "planner", "to": "map", "latency": {"budget": "10ms"}}
    times = {"far": telemetry("far", amr=60, cloud=90)}
    found = decide(edges=(EDGE, brief), times=times, map_on="cloud", lasting="/t")
    assert isinstance(found, Move)
    assert found.why == "/t planner -> driver 60ms of 30ms before, 8ms expected"


def test_a_time_that_was_proposed_for_another_edge_forbids_no_move() -> None:
    big = {"topic": "/big", "from": "planner", "to": "map", "latency": {"budget": "100ms"}}
    times = {"far": telemetry("far", amr=60, cloud=50), "near": telemetry("near", amr=5, cloud=60)}
    found = decide(
        edges=(EDGE, big), times=times, map_on="cloud", better=GOOD._replace(edge="/big to map", after_us=60_000)
    )
    assert isinstance(found, Move)


def test_services_and_the_other_end_have_their_proposals_too() -> None:
    service = {"kind": "Service", "topic": "/s", "from": "driver", "to": "planner", "latency": {"budget": "30ms"}}
    assert isinstance(
        decide(
            edges=(service,), better=GOOD._replace(edge="service /s to driver"), times={"far": telemetry("far", amr=60)}
        ),
        Move,
    )
    assert "is not measured" in why(edges=(service,), times={"far": telemetry("far", amr=60)})


def test_a_gain_that_is_too_small_is_none() -> None:
    slow = {"far": telemetry("far", amr=33)}
    no_gain = "that is no gain as measured now: 27ms or less, and a fifth less than where it is, would be"
    too_near, too_long = GOOD._replace(after_us=27_000), GOOD._replace(after_us=27_500)
    assert why(times=slow, better=too_near) == f"planner would have 27ms on near, but {no_gain}"
    unknown = {"far": telemetry("far", amr=60)}
    assert why(times=unknown, better=too_long) == f"planner would have 27.5ms on near, but {no_gain}"
    assert isinstance(decide(better=too_long), Move), "8 ms are measured now"
    measured = TIMES | {"near": telemetry("near", amr=29)}
    assert no_gain in why(times=measured), "what is measured now counts more than the proposal"


@given(st.integers(31, 200), st.integers(31, 200))
def test_why_a_pod_stays_is_the_same_sentence_whatever_is_measured(before_ms: int, later_ms: int) -> None:
    """A status that followed every measurement would be written for ever."""
    texts = {
        why(times={"far": telemetry("far", amr=ms)}, better=GOOD._replace(after_us=29_000))
        for ms in (before_ms, later_ms)
    }
    assert len(texts) == 1


def test_a_move_that_would_put_another_edge_over_its_budget_is_not_made() -> None:
    other = {"topic": "/map", "from": "planner", "to": "map", "latency": {"budget": "10ms", "enforce": "Preferred"}}
    away = TIMES | {"near": telemetry("near", amr=8), "far": telemetry("far", amr=60, shelf=1)}
    worse = away | {"shelf": telemetry("shelf", near=40)}
    assert isinstance(decide(edges=(EDGE, other)), Move)
    assert "/map planner -> map would be over its budget of 10ms there" in why(
        edges=(EDGE, other), times=worse, map_on="shelf"
    )


def test_a_node_that_takes_no_pods_is_none() -> None:
    assert why(unusable="is not Ready") == "planner would have 8ms on near, but that node is not Ready"


def test_limits_hold_but_a_move_that_was_counted_is_carried_out() -> None:
    just = MoveRecord(times=(NOW,), pod="another")
    assert "placement.reschedule.cooldown" in why(record=just)
    assert "cannot be read" in why(record=None)
    found = decide(record=MoveRecord(times=(NOW,), pod="planner-uid"))
    assert isinstance(found, Move)
    assert found.counted
