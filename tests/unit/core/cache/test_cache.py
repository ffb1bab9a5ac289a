import pytest
from tests.support.scheduling import make_cluster, make_info, make_node, make_pod, member_pod

from robotapp_scheduler.core.api.core_v1 import ResourceRequirements
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change


def used(cluster: Cache, node: str) -> tuple[int, int]:
    """(cpu milli, pods)"""
    nodes = Snapshot(cluster)
    i = nodes.indices((node,))[0]
    return int(nodes.requested("cpu")[i]), int(nodes.requested("pods")[i])


def test_pods_of_any_scheduler_count_and_terminal_pods_hold_nothing() -> None:
    cluster = make_cluster(make_node("a"))
    assert cluster.apply_pod(make_pod("x", node="a", scheduler="default-scheduler")) == Change.POD_ADDED
    assert used(cluster, "a") == (100, 1)
    done = make_pod("x", node="a")
    done.status.phase = "Succeeded"
    assert cluster.apply_pod(done) == Change.POD_REMOVED
    assert used(cluster, "a") == (0, 0)


def test_a_pod_seen_before_its_node_is_counted_when_the_node_appears() -> None:
    cluster = make_cluster()
    cluster.apply_pod(make_pod("x", node="late"))
    cluster.apply_node(make_node("late"))
    assert used(cluster, "late") == (100, 1)


def test_pods_outlive_their_node_object_and_count_again_when_it_comes_back() -> None:
    cluster = make_cluster(make_node("a"))
    cluster.apply_pod(make_pod("x", node="a"))
    cluster.remove_node("a")
    cluster.apply_node(make_node("b"))
    assert used(cluster, "b") == (0, 0)
    cluster.apply_node(make_node("a"))
    assert used(cluster, "a") == (100, 1)


def test_an_assumed_pod_counts_at_once_is_news_when_confirmed_and_can_no_longer_be_forgotten() -> None:
    cluster = make_cluster(make_node("a"))
    info = make_info("x")
    cluster.apply_pod(info.pod)
    cluster.assume(info, "a")
    assert used(cluster, "a") == (100, 1)
    assert cluster.apply_pod(info.pod) == Change.NONE  # news from before the bind
    assert cluster.is_assumed(info.uid)
    assert cluster.apply_pod(make_pod("x", node="a")) == Change.POD_ADDED
    assert not cluster.is_assumed(info.uid)
    assert cluster.forget(info.uid) == Change.NONE
    assert used(cluster, "a") == (100, 1)


def test_forgetting_frees_the_room_once() -> None:
    cluster = make_cluster(make_node("a"))
    info = make_info("x")
    cluster.assume(info, "a")
    assert cluster.forget(info.uid) == Change.POD_REMOVED
    assert cluster.forget(info.uid) == Change.NONE
    assert used(cluster, "a") == (0, 0)


def test_a_pod_bound_elsewhere_than_assumed_moves() -> None:
    cluster = make_cluster(make_node("a"), make_node("b"))
    cluster.assume(make_info("x"), "a")
    assert cluster.apply_pod(make_pod("x", node="b")) == Change.POD_ADDED | Change.POD_REMOVED
    assert (used(cluster, "a"), used(cluster, "b")) == ((0, 0), (100, 1))


def test_assuming_twice_is_a_bug_that_is_named() -> None:
    cluster = make_cluster(make_node("a"))
    cluster.assume(make_info("x"), "a")
    with pytest.raises(ValueError, match="already counted on a"):
        cluster.assume(make_info("x"), "a")


def test_a_resized_pod_is_counted_with_its_new_size() -> None:
    cluster = make_cluster(make_node("a"))
    cluster.apply_pod(make_pod("x", node="a"))
    assert cluster.apply_pod(make_pod("x", node="a", cpu="1")) == Change.POD_UPDATED
    assert used(cluster, "a") == (1000, 1)


def test_selector_counts_follow_pods_and_leave_terminating_ones_out() -> None:
    cluster = make_cluster(make_node("a"), make_node("b"))
    web = {"matchLabels": {"app": "web"}}
    cluster.apply_pod(make_pod("x", node="a", labels={"app": "web"}))
    assert Snapshot(cluster).count_pods(web, "default").tolist() == [1, 0]
    cluster.apply_pod(make_pod("y", node="b", labels={"app": "web"}))
    cluster.apply_pod(make_pod("z", node="b", labels={"app": "web"}, namespace="other"))
    assert Snapshot(cluster).count_pods(web, "default").tolist() == [1, 1]
    going = make_pod("x", node="a", labels={"app": "web"})
    going.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
    cluster.apply_pod(going)
    assert Snapshot(cluster).count_pods(web, "default").tolist() == [0, 1]
    for i in range(100):
        cluster.apply_node(make_node(f"more{i}"))
    cluster.apply_pod(make_pod("far", node="more99", labels={"app": "web"}))
    assert Snapshot(cluster).count_pods(web, "default").sum() == 2


def test_pods_are_found_by_their_own_and_their_deployments_name() -> None:
    cluster = make_cluster(make_node("a"))
    cluster.apply_pod(member_pod("mapper", node="a", name="teleop-mapper-abc-1"))
    for name in ("teleop-mapper-abc-1", "teleop-mapper"):
        assert [pod.node for pod in cluster.placed_named("default", name)] == ["a"]
    assert cluster.placed_named("other", "teleop-mapper") == []


def test_news_about_the_status_alone_keep_the_record_and_exchange_the_pod() -> None:
    cluster = make_cluster(make_node("n"))
    cluster.assume(make_info("p"), "n")
    record, version = cluster.placed["uid-p"], cluster.nodes.versions[0]
    bound = make_pod("p", node="n")
    assert cluster.apply_pod(bound) == Change.POD_ADDED
    running = make_pod("p", node="n", annotations={"more": "said"})
    assert cluster.apply_pod(running) == Change.NONE
    assert cluster.placed["uid-p"] is record
    assert (record.assumed, record.pod is running) == (False, True)
    assert cluster.nodes.versions[0] > version, "what was kept about the node's pods is looked at again"
    assert [found.uid for found in cluster.placed_named("default", "p")] == ["uid-p"]


def test_a_pod_that_begins_to_end_or_is_resized_is_counted_anew() -> None:
    cluster = make_cluster(make_node("n"))
    cluster.apply_pod(make_pod("p", node="n", cpu="1"))
    ending = make_pod("p", node="n", cpu="1")
    ending.metadata.deletion_timestamp = "2026-01-01T00:00:00Z"
    assert cluster.apply_pod(ending) == Change.POD_UPDATED
    resized = make_pod("p", node="n", cpu="1")
    resized.status.allocated_resources, resized.status.resources = (
        {"cpu": "3"},
        ResourceRequirements(requests={"cpu": "3"}),
    )
    assert cluster.apply_pod(resized) == Change.POD_UPDATED
    assert Snapshot(cluster).requested("cpu").tolist() == [3000]
