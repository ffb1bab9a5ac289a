"""Pods bring in resources that no node offers: only so many of them get a column of their own."""

from tests.support.scheduling import make_cluster, make_node, make_pod

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.nodes.columns import LARGEST, MOST_RESOURCES, MOST_STRANGE


def strange(name: str, *resources: str, amount: str = "1") -> Pod:
    requests = dict.fromkeys(resources, amount)
    return make_pod(name, node="n", containers=[{"name": "c", "resources": {"requests": requests}}])


def test_ten_thousand_of_them_neither_fill_the_memory_nor_hide_what_nodes_offer() -> None:
    cluster = make_cluster(make_node("n", **{"lab.example/arm": "2"}))
    cluster.apply_pod(strange("p", *(f"x.example/r{number}" for number in range(10_000))))
    table = cluster.nodes.resources
    assert len(table.names) == 4 + MOST_STRANGE
    cluster.apply_pod(strange("q", "x.example/r9999", "lab.example/arm"))
    assert table.requested[table.index["lab.example/arm"], 0] == 1
    cluster.apply_node(make_node("m", **{"x.example/new": "3"}))
    assert table.allocatable[table.index["x.example/new"], 1] == 3
    cluster.remove_pod(strange("p", "x.example/r1"))
    cluster.remove_pod(strange("q", "x.example/r1"))
    assert not table.requested.any()


def test_a_node_that_offers_ten_thousand_resources_leaves_the_others_theirs() -> None:
    cluster = make_cluster(make_node("n", **{"lab.example/arm": "2"}))
    many = {f"x.example/r{number}": "1" for number in range(10_000)}
    for _ in range(2):
        cluster.apply_node(make_node("m", **many))
    table = cluster.nodes.resources
    assert len(table.names) == MOST_RESOURCES
    assert table.allocatable[table.index["x.example/r0"], 1] == 1
    cluster.apply_node(make_node("o", **{"lab.example/arm": "5", "late.example/r": "1"}))
    assert table.allocatable[table.index["lab.example/arm"], 2] == 5
    assert "late.example/r" not in table.index


def test_absurd_amounts_of_running_pods_never_wrap_around() -> None:
    cluster = make_cluster(make_node("n"))
    for number in range(20):
        cluster.apply_pod(strange(f"p{number}", "cpu", "memory", amount="9223372036854775807"))
    assert (cluster.nodes.resources.requested[:2, 0] == 20 * LARGEST).all()
    assert (cluster.nodes.scored[:, 0] == 20 * LARGEST).all()
