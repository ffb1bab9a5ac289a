"""The API server copies zone and region of a node to the pods bound to it: foretold, a confirmed bind changes nothing."""

import pytest
from tests.support.scheduling import make_cluster, make_info, make_node, make_pod

from robotapp_scheduler.core.api.core_v1 import REGION, ZONE
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change

PLACE = {ZONE: "z1", REGION: "r1"}


def in_zone() -> Cache:
    return make_cluster(make_node("a", labels={**PLACE, "disk": "ssd"}))


def bind(cluster: Cache, name: str, *, own: dict[str, str], shown: dict[str, str]) -> bool:
    """Assume and confirm a pod with labels of its `own`, `shown` with others. Was its record kept as it was?"""
    info = make_info(name, labels=own)
    cluster.apply_pod(info.pod)
    cluster.assume(info, "a")
    assumed = cluster.placed[info.uid]
    assert cluster.apply_pod(make_pod(name, labels=shown, node="a")) == Change.POD_ADDED
    assert cluster.placed[info.uid].labels == shown
    return cluster.placed[info.uid] is assumed


def test_the_first_confirmed_bind_shows_it_and_from_then_on_it_is_foretold() -> None:
    cluster = in_zone()
    kept = [bind(cluster, name, own={"app": "x"}, shown={"app": "x", **PLACE}) for name in "pqr"]
    assert kept == [False, True, True]


def test_an_api_server_that_does_not_is_believed_at_once() -> None:
    cluster = in_zone()
    assert not bind(cluster, "p", own={}, shown=PLACE)
    kept = [bind(cluster, name, own={}, shown={}) for name in "qrs"]
    assert kept == [False, True, True]


def test_without_zones_there_is_nothing_to_foretell() -> None:
    cluster = make_cluster(make_node("a"))
    assert bind(cluster, "p", own={"app": "x"}, shown={"app": "x"})


def test_what_a_pod_says_of_its_zone_itself_stays() -> None:
    cluster = in_zone()
    bind(cluster, "p", own={}, shown=PLACE)
    assert bind(cluster, "q", own={ZONE: "mine"}, shown={ZONE: "mine", REGION: "r1"})


@pytest.mark.parametrize("shown", [PLACE, {}], ids=["copied", "not copied"])
def test_a_pod_whose_bind_failed_is_what_it_was(shown: dict[str, str]) -> None:
    cluster = in_zone()
    bind(cluster, "p", own={}, shown=shown)
    info = make_info("q", labels={"app": "x"})
    cluster.apply_pod(info.pod)
    cluster.assume(info, "a")
    cluster.forget(info.uid)
    assert info.pod.metadata.labels == {"app": "x"}
    assert info.uid not in cluster.placed
