from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduler.queue_checks import check_queue

from robotapp_client.informer.reflector import Change as Seen
from robotapp_scheduler.core.api.core_v1 import Metadata, Node, NodeStatus, Pod, PodSpec, PodStatus
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.core.queue.scheduling_queue import SchedulingQueue
from robotapp_scheduler.shell.informers.pod_handler import PodHandler

OURS = "ours"


class Silent:
    def __init__(self) -> None:
        self.deleting_pods: list[str] = []
        self.forgotten: list[str] = []

    def deleting(self, pod: Pod) -> None:
        self.deleting_pods.append(pod.metadata.uid)

    def forget(self, uid: str) -> None:
        self.forgotten.append(uid)


class Desk:
    def __init__(self) -> None:
        self.cluster = Cache(clock=lambda: 0.0)
        self.cluster.apply_node(
            Node(metadata=Metadata(name="n1"), status=NodeStatus(allocatable={"cpu": "4", "pods": "10"}))
        )
        self.queue = SchedulingQueue(clock=lambda: 0.0, key=lambda info, since_s: (-info.priority, since_s))
        self.reporter = Silent()
        self.intake = PodHandler(self.cluster, self.queue, self.reporter, scheduler_names=[OURS])  # type: ignore[arg-type]
        self.stored: dict[str, Pod] = {}

    def show(self, pod: Pod) -> None:
        uid = pod.metadata.uid
        old = self.stored.get(uid)
        self.stored[uid] = pod
        self.intake.take(Seen("MODIFIED" if old else "ADDED", uid, old, pod))

    def drop(self, uid: str) -> None:
        self.intake.take(Seen("DELETED", uid, self.stored.pop(uid), None))


def pod(
    uid: str = "u1", *, node: str = "", scheduler: str = OURS, phase: str = "Pending", deleting: bool = False
) -> Pod:
    meta = Metadata(name=uid, namespace="a", uid=uid, deletion_timestamp="2026-01-01T00:00:00Z" if deleting else None)
    return Pod(metadata=meta, spec=PodSpec(node_name=node, scheduler_name=scheduler), status=PodStatus(phase=phase))


def test_our_waiting_pod_is_queued_and_counts_nowhere() -> None:
    desk = Desk()
    desk.show(pod())
    assert desk.queue.get("u1") is not None
    assert desk.cluster.placed == {}


def test_a_pod_of_another_scheduler_is_not_queued_but_counts_once_it_is_placed() -> None:
    desk = Desk()
    desk.show(pod(scheduler="default-scheduler"))
    assert len(desk.queue) == 0
    desk.show(pod(scheduler="default-scheduler", node="n1"))
    assert "u1" in desk.cluster.placed


def test_a_pod_bound_by_somebody_leaves_the_queue() -> None:
    desk = Desk()
    desk.show(pod())
    desk.show(pod(node="n1"))
    assert len(desk.queue) == 0
    assert desk.intake.waiting == {}
    assert desk.reporter.forgotten == ["u1"]


def test_news_of_a_bound_pod_asks_nobody_to_forget_it_again() -> None:
    desk = Desk()
    for phase in ("Pending", "Running", "Running"):
        desk.show(pod(node="n1", phase=phase))
    assert desk.reporter.forgotten == ["u1"]
    assert "u1" in desk.cluster.placed


def test_an_assumed_pod_is_not_queued_again_by_its_own_status_patch() -> None:
    desk = Desk()
    desk.show(pod())
    (queued,) = desk.queue.pop()
    desk.cluster.assume(queued.info, "n1")
    desk.queue.done("u1")
    desk.show(pod())
    assert len(desk.queue) == 0
    assert desk.cluster.is_assumed("u1")


def test_a_waiting_pod_that_is_being_deleted_leaves_with_one_warning() -> None:
    desk = Desk()
    desk.show(pod())
    desk.show(pod(deleting=True))
    desk.show(pod(deleting=True))
    assert len(desk.queue) == 0
    assert desk.reporter.deleting_pods == ["u1"]


def test_a_deleted_pod_frees_its_node_and_leaves_nothing_behind() -> None:
    desk = Desk()
    desk.show(pod(node="n1"))
    desk.drop("u1")
    assert desk.cluster.placed == {}
    assert len(desk.queue) == 0


@pytest.mark.parametrize("phase", ["Succeeded", "Failed"])
def test_an_ended_pod_is_never_queued(phase: str) -> None:
    desk = Desk()
    desk.show(pod(phase=phase))
    assert len(desk.queue) == 0


steps = st.lists(
    st.tuples(
        st.sampled_from(["u1", "u2"]),
        st.sampled_from(["waiting", "bound", "deleting", "drop", "pop", "assume", "fail"]),
    ),
    max_size=25,
)


@given(steps)
def test_whatever_the_watch_shows_a_pod_is_in_one_place_only(script: list[tuple[str, str]]) -> None:
    desk = Desk()
    flying: dict[str, Any] = {}
    for uid, step in script:
        _play(desk, flying, uid, step)
        check_queue(desk.queue)
        for queued in (desk.queue.get(each) for each in ("u1", "u2")):
            if queued is not None:
                assert not desk.cluster.is_assumed(queued.info.uid)
        assert set(desk.intake.waiting) <= set(desk.stored)


def _play(desk: Desk, flying: dict[str, Any], uid: str, step: str) -> None:
    known = desk.stored.get(uid)
    if step == "waiting" and (known is None or not known.spec.node_name):
        desk.show(pod(uid))
    elif step == "bound":
        desk.show(pod(uid, node="n1"))
    elif step == "deleting" and known is not None and not known.spec.node_name:
        desk.show(pod(uid, deleting=True))
    elif step == "drop" and known is not None:
        desk.drop(uid)
    elif step == "pop":
        flying.update({queued.info.uid: queued for queued in desk.queue.pop()})
    elif step == "assume" and uid in flying and uid in desk.intake.waiting:
        desk.cluster.assume(PodInfo(desk.intake.waiting[uid]), "n1")
        desk.queue.done(uid)
        flying.pop(uid)


def test_a_nomination_is_read_from_the_status_and_ends_with_the_pod() -> None:
    desk = Desk()
    waiting = pod()
    waiting.status.nominated_node_name = "n1"
    desk.show(waiting)
    assert desk.cluster.nominations.node_of("u1") == "n1"
    desk.show(pod(deleting=True))
    assert desk.cluster.nominations.node_of("u1") == ""


def test_giving_up_a_nominated_node_wakes_those_who_wait_for_room() -> None:
    desk = Desk()
    desk.show(pod("other"))
    (queued,) = desk.queue.pop()
    desk.queue.requeue(queued, Rejection(frozenset({"Fit"})))
    nominated = pod()
    nominated.status.nominated_node_name = "n1"
    desk.show(nominated)
    assert desk.queue.pending()["unschedulable"] == 1
    desk.show(pod())
    assert desk.queue.pending()["unschedulable"] == 0


def test_a_pod_that_vanishes_is_shown_to_who_asks_why() -> None:
    desk = Desk()
    seen: list[str] = []
    desk.intake = PodHandler(
        desk.cluster,
        desk.queue,
        desk.reporter,  # type: ignore[arg-type]
        scheduler_names=[OURS],
        on_vanished=lambda gone: seen.append(gone.metadata.uid),
    )
    for each in (pod("mine", node="n1"), pod("theirs", node="n1", scheduler="default-scheduler")):
        desk.show(each)
        desk.drop(each.metadata.uid)
    assert seen == ["mine"]


def resized(asked: str = "2") -> Pod:
    """On n1: one container is to shrink from 2 to 1 CPU, the other to grow from 1 to what is asked."""
    sides = {"a": ("1", "2"), "b": (asked, "1")}
    body = {
        "metadata": {"name": "r", "namespace": "default", "uid": "r"},
        "spec": {
            "nodeName": "n1",
            "containers": [{"name": name, "resources": {"requests": {"cpu": cpu}}} for name, (cpu, _) in sides.items()],
        },
        "status": {
            "containerStatuses": [
                {"name": name, "resources": {"requests": {"cpu": cpu}}} for name, (_, cpu) in sides.items()
            ]
        },
    }
    return msgspec.convert(body, Pod)


def cpu_held(desk: Desk) -> list[int]:
    code = desk.cluster.nodes.resources.names.index("cpu")
    return [dict(record.requested)[code] for record in desk.cluster.placed.values()]


def test_the_formula_of_resized_pods_may_change_while_they_are_resized() -> None:
    desk = Desk()
    desk.show(resized())
    assert cpu_held(desk) == [3000]
    (event,) = desk.intake.count_per_container(True)
    assert (cpu_held(desk), bool(event.change)) == ([4000], True)
    assert desk.intake.count_per_container(True) == []
    desk.show(resized("3"))
    assert cpu_held(desk) == [5000]
    assert len(desk.intake.count_per_container(False)) == 1
    assert cpu_held(desk) == [4000]
    desk.intake.count_per_container(True)
    desk.drop("r")
    assert desk.intake.count_per_container(False) == []
