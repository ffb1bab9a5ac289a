"""Waiting for Ready and for the end of an app, by a clock of the test's own."""

from collections.abc import Callable
from typing import Any

import pytest
from tests.unit.bridge.fake_cluster import FakeCluster, app

from rigel_bridge.cluster.deployment import deploy
from rigel_bridge.cluster.differences import changes, diff
from rigel_bridge.cluster.kubectl import ClusterError, Refusal
from rigel_bridge.cluster.removal import remove
from rigel_bridge.cluster.waiting import Clock, wait_ready
from rigel_bridge.document.failures import Exit


def clock(at: Callable[[float], None] = lambda _: None) -> Clock:
    """Time passes by sleeping; `at` is called with the new time."""
    now = [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds
        at(now[0])

    return Clock(now_s=lambda: now[0], sleep=sleep)


def conditioned(cluster: FakeCluster, *, generation: int = 1, **states: str) -> None:
    conditions = [
        {"type": kind, "status": state, "reason": "Because", "message": "words", "observedGeneration": generation}
        for kind, state in states.items()
    ]
    cluster.objects["robotapps", "teleop"]["status"] = {"conditions": conditions}


def started() -> FakeCluster:
    cluster = FakeCluster()
    deploy(cluster, app(), tell=str)
    return cluster


def test_ready_of_an_earlier_generation_does_not_count() -> None:
    cluster, told = started(), list[str]()
    conditioned(cluster, Ready="True", generation=0)

    def at(now_s: float) -> None:
        if now_s > 5:
            conditioned(cluster, Ready="True")

    wait_ready(cluster, "teleop", timeout_s=60, clock=clock(at), tell=told.append)
    assert told == ["teleop: Pending: the operator has not looked yet"]


def test_an_app_that_is_refused_is_not_waited_for() -> None:
    cluster = started()
    conditioned(cluster, Accepted="False", Ready="False")
    with pytest.raises(ClusterError, match="is not accepted: Because: words") as caught:
        wait_ready(cluster, "teleop", timeout_s=60, clock=clock(pytest.fail), tell=str)
    assert caught.value.code == Exit.NOT_READY


def test_the_last_words_are_told_when_time_is_up() -> None:
    cluster = started()
    conditioned(cluster, Ready="False")
    with pytest.raises(ClusterError, match="not Ready within 30 s: Because: words"):
        wait_ready(cluster, "teleop", timeout_s=30, clock=clock(), tell=str)


def test_deletion_waits_for_children_of_this_app_and_takes_its_history() -> None:
    cluster = started()
    labels = {"robotics.io/app": "teleop", "robotics.io/app-uid": "uid-teleop"}
    cluster.objects["pods", "p"] = {"metadata": {"name": "p", "labels": labels}}
    cluster.objects["pods", "q"] = {"metadata": {"name": "q", "labels": labels | {"robotics.io/app-uid": "new"}}}

    def at(now_s: float) -> None:
        if now_s > 3:
            cluster.objects.pop(("pods", "p"), None)

    assert remove(cluster, "teleop", timeout_s=60, clock=clock(at))
    assert list(cluster.objects) == [("pods", "q")], "a pod of the app that has the name now"
    assert not remove(cluster, "teleop", timeout_s=60, clock=clock())


def test_what_stays_is_named_and_kinds_that_may_not_be_listed_are_left_out() -> None:
    cluster = started()
    labels = {"robotics.io/app-uid": "uid-teleop"}
    cluster.objects["pods", "p"] = {"metadata": {"name": "p", "labels": labels}}
    with pytest.raises(ClusterError, match="there still are pods/p"):
        remove(cluster, "teleop", timeout_s=10, clock=clock())
    cluster = started()
    cluster.objects["pods", "p"] = {"metadata": {"name": "p", "labels": labels}}
    for kind in ("pods", "controllerrevisions"):
        cluster.refused["get", kind] = Refusal.FORBIDDEN
    assert remove(cluster, "teleop", timeout_s=10, clock=clock())


def test_spec_differences_read_like_a_diff_and_name_their_fields() -> None:
    old: dict[str, Any] = {"a": {"b": [1, 2]}, "gone": True}
    new: dict[str, Any] = {"a": {"b": [1, 3]}, "long": "x" * 200}
    assert diff(old, old, before="a", after="b") == ""
    assert "   - 1\n-  - 2\n" in diff(old, new, before="a", after="b")
    assert changes(old, new)[:2] == ["spec.a.b[1]: 2 -> 3", "spec.gone: true -> absent"]
    assert len(changes({}, {str(n): n for n in range(50)})) == 20
    assert changes({}, {str(n): n for n in range(50)})[-1] == "and 31 more fields"
