"""The difference of two states of edges, and what each user may see of an answer."""

import math

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.what_if.difference import (
    NAMELESS,
    Answer,
    EdgeKey,
    EdgeTime,
    EdgeVerdict,
    Hidden,
    Outcome,
    PodChange,
    edge_changes,
    in_order,
    verdict_of,
    visible,
)

times = st.builds(
    EdgeTime,
    st.none() | st.just(math.inf) | st.floats(0, 100_000),
    st.sampled_from(["measured", "estimated", "unknown"]),
    st.just(20_000),
    st.just(95),
)
keys = st.builds(EdgeKey, st.sampled_from(["a", "b"]), st.just("app"), st.just(""), st.just("/t"), st.just("x"),
                 st.just("y"), st.integers(0, 3))  # fmt: skip
states = st.dictionaries(keys, times, max_size=8)


def key(namespace: str = "team", number: int = 0) -> EdgeKey:
    return EdgeKey(namespace, "teleop", "amr", "/cmd", "ui", "driver", number)


def time(us: float, budget_us: int = 20_000) -> EdgeTime:
    return EdgeTime(us, "measured", budget_us, 95)


def change(namespace: str, pod: str, **fields: str) -> PodChange:
    return PodChange(namespace=namespace, pod=pod, outcome=Outcome.MOVES, from_="n1", to="n2", **fields)


def test_an_edge_that_leaves_its_budget_is_shown_with_both_times() -> None:
    (found,), same = edge_changes({key(): time(8_000.0)}, {key(): time(40_000.0)})
    assert (found.before, found.after) != (None, None)
    assert found.before is not None
    assert found.after is not None
    assert (found.before.rtt_ms, found.before.verdict) == (8.0, EdgeVerdict.MET)
    assert (found.after.rtt_ms, found.after.verdict) == (40.0, EdgeVerdict.EXCEEDED)
    assert (found.budget_ms, same) == (20.0, 0)


def test_another_budget_of_an_edge_is_one_change_with_the_new_budget() -> None:
    (found,), _ = edge_changes({key(): time(8_000.0)}, {key(): time(8_000.0, 5_000)})
    assert found.before is not None
    assert found.after is not None
    assert (found.before.verdict, found.after.verdict) == (EdgeVerdict.MET, EdgeVerdict.EXCEEDED)
    assert found.budget_ms == 5.0


def test_no_answer_to_probes_exceeds_and_shows_no_time() -> None:
    (found,), _ = edge_changes({}, {key(): time(math.inf)})
    assert found.before is None
    assert found.after is not None
    assert (found.after.rtt_ms, found.after.verdict) == (None, EdgeVerdict.EXCEEDED)


@given(states, states)
def test_every_edge_is_changed_or_counted_and_changed_ones_have_two_verdicts(
    before: dict[EdgeKey, EdgeTime], after: dict[EdgeKey, EdgeTime]
) -> None:
    found, same = edge_changes(before, after)
    assert len(found) + same == len(before.keys() | after.keys())
    for each in found:
        assert (each.before and each.before.verdict) != (each.after and each.after.verdict)


@given(states)
def test_nothing_changes_from_a_state_to_itself(state: dict[EdgeKey, EdgeTime]) -> None:
    assert edge_changes(state, state) == ((), len(state))


@given(st.floats(0, 1e6), st.integers(0, 1_000_000))
def test_a_verdict_is_a_comparison(us: float, budget_us: int) -> None:
    assert (verdict_of(time(us, budget_us)) == EdgeVerdict.MET) == (us <= budget_us)


def test_who_may_see_one_namespace_sees_its_pods_and_how_many_others_there_are() -> None:
    edges, _ = edge_changes({}, {key("team"): time(1.0), key("other", 1): time(1.0)})
    answer = Answer(pods=(change("team", "a"), change("other", "b"), change("other", "c")), edges=edges)
    seen = visible(answer, namespace="team", with_nodes=True, nodes=())
    assert [each.pod for each in seen.pods] == ["a"]
    assert [each.namespace for each in seen.edges] == ["team"]
    assert seen.hidden == Hidden(pods=2, edges=1)
    assert b"other" not in msgspec.json.encode(seen)
    assert visible(answer, namespace="", with_nodes=True, nodes=()) == answer


def test_without_the_right_to_get_nodes_no_node_is_named() -> None:
    counted = "0/2 nodes are available: 2 Insufficient cpu."
    answer = Answer(
        pods=(
            change("team", "a", reason="waiting for its predecessor on n1", code="WaitingForPredecessor"),
            change("team", "b", reason=counted, code="Unschedulable"),
            change("team", "c", reason="best is 5ms on edge-1.lab; b is on n1.", code="Unschedulable"),
        )
    )
    seen = visible(answer, namespace="team", with_nodes=False, nodes={"n1", "edge-1.lab"})
    assert b"n1" not in msgspec.json.encode(seen)
    assert seen.pods[1].reason == counted
    assert seen.pods[2].reason == "best is 5ms on …; b is on …."
    assert NAMELESS in seen.notes


def test_pods_are_listed_by_namespace_and_app() -> None:
    pods = [change("b", "x"), change("a", "y", app="z"), change("a", "y", app="b"), change("a", "c", app="b")]
    assert [(each.namespace, each.app, each.pod) for each in in_order(pods)] == [
        ("a", "b", "c"),
        ("a", "b", "y"),
        ("a", "z", "y"),
        ("b", "", "x"),
    ]
