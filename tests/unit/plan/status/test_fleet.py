"""The fleet view and the list of pairs worth measuring."""

import re

from hypothesis import given
from hypothesis import strategies as st

from robotapp_operator.plan.status.fleet import MAX_SHARDS, Assignment, fleet_lines, shards, wanted_probes

NODES = st.sampled_from([f"n{number}" for number in range(40)])


def test_an_instance_is_one_compact_line() -> None:
    lines = fleet_lines([Assignment("teleop", "amr-07", 7, (("operator", "edge-1"), ("driver", "amr-07")))])
    assert lines == {"app.teleop.amr-07": "domain=7 driver@amr-07 operator@edge-1"}


def test_unplaced_parts_and_bare_pods_are_shown() -> None:
    lines = fleet_lines([Assignment("a", "", None, (("c", ""),)), Assignment("", "", 9, (("lidar-0", "edge-1"),))])
    assert lines == {"app.a": "c@-", "pod.lidar-0": "domain=9 lidar-0@edge-1"}


def test_keys_are_allowed_in_a_config_map() -> None:
    lines = fleet_lines([Assignment("a" * 40, "R.2_x-" + "b" * 57, 1, (("c", "n"),))])
    assert all(re.fullmatch(r"[-._a-zA-Z0-9]{1,253}", key) for key in lines)


def test_a_line_is_bounded() -> None:
    parts = tuple((f"component-{number}", "node" * 20) for number in range(64))
    assert max(map(len, fleet_lines([Assignment("a", "", 1, parts)]).values())) == 1024


def test_shards_keep_every_line_once_and_stay_small() -> None:
    lines = {f"app.a-{number:05}": "x" * 400 for number in range(5000)}
    pieces = shards(lines)
    assert len(pieces) == 3
    assert {key: value for piece in pieces for key, value in piece.items()} == lines
    assert all(sum(len(k) + len(v) for k, v in piece.items()) <= 800 * 1024 for piece in pieces)


def test_nothing_to_show_needs_no_config_map() -> None:
    assert shards({}) == []


def test_one_direction_per_pair_is_enough() -> None:
    probes = wanted_probes([("a", "b"), ("b", "a"), ("a", "a"), ("", "b")])
    assert probes == {"a": ("b",)}


@given(st.lists(st.tuples(NODES, NODES), max_size=300))
def test_no_agent_is_asked_for_more_than_sixteen(pairs: list[tuple[str, str]]) -> None:
    probes = wanted_probes(pairs)
    assert all(len(set(peers)) == len(peers) <= 16 for peers in probes.values())
    asked = {frozenset((node, peer)) for node, peers in probes.items() for peer in peers}
    assert asked <= {frozenset(pair) for pair in pairs}
    assert wanted_probes(reversed(pairs)) == probes


def test_pairs_with_a_budget_that_must_be_met_come_before_all_others() -> None:
    others = [(f"a{i:02}", f"b{j:02}") for i in range(33) for j in range(33)]
    hard = [("a31", "b32"), ("b31", "a32")]
    assert not {("a31", "b32"), ("a32", "b31")} <= asked(wanted_probes(others + hard, limit=3))
    assert {("a31", "b32"), ("a32", "b31")} <= asked(wanted_probes(others, first=hard, limit=3))


def test_a_pair_is_measured_by_an_end_that_has_an_agent_and_by_none_without() -> None:
    assert wanted_probes([("a", "b"), ("a", "c")], agents={"b"}) == {"b": ("a",)}


def test_one_server_and_two_hundred_robots_are_all_measured_by_the_robots() -> None:
    pairs = [("edge-1", f"robot-{i:03}") for i in range(200)]
    assert asked(wanted_probes(pairs)) == set(pairs)


def asked(probes: dict[str, tuple[str, ...]]) -> set[tuple[str, str]]:
    return {(min(node, peer), max(node, peer)) for node, peers in probes.items() for peer in peers}


def test_there_are_never_more_shards_than_the_operators_role_names() -> None:
    lines = {f"app.a{number:02}": "x" for number in range(20)}
    assert [list(piece) for piece in shards(lines, limit=8)] == [[f"app.a{number:02}"] for number in range(MAX_SHARDS)]
