from tests.support.scheduling import make_cluster, make_node, make_pod


def test_a_row_is_kept_until_a_pod_comes_or_goes_or_the_node_changes() -> None:
    cluster = make_cluster(make_node("n", cpu="4"))
    rows = cluster.nodes.rows
    first = rows.get(0)
    assert first is rows.get(0)
    assert first.of(("cpu", "gpu")) == ((4000, 0, 0), (0, 0, 0))
    cluster.apply_pod(make_pod(node="n", cpu="100m"))
    assert rows.get(0).of(("cpu",)) == ((4000, 100, 100),)
    cluster.apply_node(make_node("n", cpu="8"))
    assert rows.get(0).of(("cpu",)) == ((8000, 100, 100),)


def test_a_row_that_another_node_got_is_not_the_old_one() -> None:
    cluster = make_cluster(make_node("old", cpu="4"))
    before = cluster.nodes.rows.get(0)
    cluster.remove_node("old")
    assert cluster.nodes.rows.get(0) is not before
    cluster.apply_node(make_node("new", cpu="8"))
    assert cluster.nodes.rows.get(0).of(("cpu",)) == ((8000, 0, 0),)


def test_amounts_of_a_resource_that_appears_later_are_found() -> None:
    cluster = make_cluster(make_node("a"))
    cluster.nodes.rows.get(0)
    cluster.apply_node(make_node("b", **{"example.com/arm": "2"}))
    assert cluster.nodes.rows.get(0).of(("example.com/arm",)) == ((0, 0, 0),)
    assert cluster.nodes.rows.get(1).of(("example.com/arm",)) == ((2, 0, 0),)
