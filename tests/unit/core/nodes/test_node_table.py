from typing import Any

import pytest
from tests.support.scheduling import make_cluster, make_node, make_pod

from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.nodes.node_table import NodeTable


def test_a_node_keeps_its_row_and_a_free_row_is_handed_out_again() -> None:
    table = NodeTable()
    rows = [table.apply(make_node(name))[0] for name in ("a", "b", "c")]
    assert rows == [0, 1, 2]
    assert table.remove("b") == 1
    assert table.apply(make_node("d"))[0] == 1
    assert table.apply(make_node("c"))[0] == 2
    assert (table.count, table.size) == (3, 3)


def test_columns_grow_past_their_first_size_and_keep_their_values() -> None:
    table = NodeTable()
    table.labels.column("zone")
    for i in range(200):
        table.apply(make_node(f"n{i}", cpu=str(i + 1), labels={"zone": f"z{i % 3}"}, **{"x.io/dev": str(i)}))
    cpu = table.resources.allocatable[0]
    assert [int(cpu[i]) for i in (0, 63, 64, 199)] == [1000, 64_000, 65_000, 200_000]
    codes, vocabulary = table.labels.column("zone")
    assert [vocabulary.values[codes[i]] for i in (0, 64, 199)] == ["z0", "z1", "z1"]
    assert int(table.resources.allocatable[table.resources.index["x.io/dev"], 150]) == 150


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({}, Change.NONE),
        ({"cpu": "8"}, Change.ALLOCATABLE),
        ({"pods": "5"}, Change.ALLOCATABLE),
        ({"labels": {"zone": "b"}}, Change.LABELS),
        ({"taints": [{"key": "k", "effect": "NoSchedule"}]}, Change.TAINTS),
        ({"unschedulable": True}, Change.TAINTS),
        ({"annotations": {str(Annotation.GRACEFUL_SHUTDOWN): "true"}}, Change.ANNOTATIONS),
    ],
)
def test_an_update_says_exactly_what_is_different(fields: dict[str, Any], expected: Change) -> None:
    table = NodeTable()
    assert table.apply(make_node("n"))[1] & Change.NODE_ADDED
    assert table.apply(make_node("n", **fields))[1] == expected
    assert table.apply(make_node("n", **fields))[1] == Change.NONE


def test_a_removed_node_leaves_nothing_in_its_row() -> None:
    cluster = make_cluster(
        make_node("a", taints=[{"key": "k", "effect": "NoSchedule"}], unschedulable=True), make_node("b")
    )
    cluster.remove_node("a")
    nodes = Snapshot(cluster)
    assert nodes.names == ["", "b"]
    assert nodes.valid.tolist() == [False, True]
    assert nodes.allocatable("cpu").tolist() == [0, 4000]
    assert not nodes.unschedulable.any()
    assert not nodes.has_taint("k").any()


def test_nodes_of_a_robot_are_found_by_its_name_and_lost_with_the_label() -> None:
    cluster = make_cluster(
        make_node("r1", labels={str(Label.ROBOT): "amr"}), make_node("r2", labels={str(Label.ROBOT): "amr"})
    )
    assert cluster.robot_nodes("amr") == ("r1", "r2")
    cluster.apply_node(make_node("r2"))
    assert cluster.robot_nodes("amr") == ("r1",)
    cluster.remove_node("r1")
    assert cluster.robot_nodes("amr") == ()


def test_views_are_read_only_and_a_view_of_some_rows_agrees_with_the_whole() -> None:
    cluster = make_cluster(*(make_node(f"n{i}", cpu=str(i + 1), labels={"rank": str(i)}) for i in range(5)))
    whole, some = Snapshot(cluster), Snapshot(cluster, [3, 1])
    assert some.names == ["n3", "n1"]
    assert some.free("cpu").tolist() == [4000, 2000]
    assert some.label("rank").texts() == ["3", "1"]
    assert some.indices(("n1", "n4")) == [1]
    assert some.named(("n1", "n4")).tolist() == [False, True]
    with pytest.raises(ValueError, match="read-only"):
        whole.allocatable("cpu")[0] = 1


def test_amounts_nobody_can_read_are_refused_before_anything_changes() -> None:
    table = NodeTable()
    with pytest.raises(ValueError, match="plenty"):
        table.apply(make_node("n", cpu="plenty"))
    assert table.count == 0


@pytest.mark.parametrize("rows", [None, [1, 0]])
def test_a_view_stays_true_when_resources_get_columns_after_it_was_looked_at(rows: list[int] | None) -> None:
    cluster = make_cluster(make_node("a", cpu="4"), make_node("b", cpu="2"))
    cluster.apply_pod(make_pod(node="a", cpu="100m", memory="1Gi"))
    view = Snapshot(cluster, rows)
    first = view.block("free", ("pods", "cpu")).tolist()
    for i in range(20):
        cluster.nodes.resources.code(f"x.io/r{i}")
    whole = Snapshot(cluster, rows)
    assert view.block("requested", ("cpu", "memory")).tolist() == whole.block("requested", ("cpu", "memory")).tolist()
    assert view.scored("memory").tolist() == whole.scored("memory").tolist()
    assert view.requested("x.io/r19").tolist() == [0, 0]
    assert first == whole.block("free", ("pods", "cpu")).tolist()
