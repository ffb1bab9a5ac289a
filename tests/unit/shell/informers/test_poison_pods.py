"""Every poison pod at once in front of a healthy one: fed as the watch feeds them, decided as the loop decides them."""

import gc
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from tests.support.scheduler.poison import Poison, pod_body, poison_pods
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import make_core, make_node, make_pod
from tests.support.work_unit import is_within

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_client.informer.reflector import Change as Seen
from robotapp_client.informer.watch_decoder import ADDED, WatchDecoder
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.shell.informers.pod_handler import PodHandler

NODES = 200
POISON = poison_pods()
MOST_S = 0.5
"""CPU for one poison pod with 200 nodes: 25 times what the worst needs on an idle core, a tenth of what one used to."""


@contextmanager
def no_collector() -> Iterator[None]:
    """Without the garbage of thousands of other tests: going through that takes longer than what is measured here."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class Silent:
    """A reporter nobody listens to."""

    def forget(self, uid: str) -> None: ...
    def deleting(self, pod: Pod) -> None: ...


class Feed:
    """A core with nodes and some running pods, fed with watch lines."""

    def __init__(self) -> None:
        zones = [{"topology.kubernetes.io/zone": f"z{index % 5}"} for index in range(NODES)]
        self.core: SchedulerCore = make_core(*(make_node(f"n{i}", labels=zones[i]) for i in range(NODES)))
        for index in range(50):
            self.core.cluster.apply_pod(make_pod(f"run-{index}", node=f"n{index}", labels={"app": f"a-{index % 7}"}))
        self._intake = PodHandler(
            self.core.cluster,
            self.core.queue,
            Silent(),  # type: ignore[arg-type]
            scheduler_names=[SCHEDULER_NAME],
        )
        self._decoder: WatchDecoder[Pod] = WatchDecoder(Pod, namespaced=True)
        self._version = 0

    def show(self, body: dict[str, Any]) -> bool:
        """One line of the watch; False when the object does not fit, which the reflector reports."""
        self._version += 1
        meta = {**body["metadata"], "uid": f"uid-{body['metadata']['name']}", "resourceVersion": str(self._version)}
        event = self._decoder.event(json.dumps({"type": ADDED, "object": {**body, "metadata": meta}}).encode())
        if event.obj is None:
            return False
        self._intake.take(Seen(ADDED, event.identity.key, None, event.obj))
        return True

    def decide(self) -> ScheduleResult | None:
        """The next pod; None for one that met a bug, which the loop takes back."""
        batch = self.core.queue.pop()
        try:
            (decision,) = self.core.schedule(batch)
        except Exception:  # noqa: BLE001 - as the loop does: selectors that are none at all
            for queued in batch:
                self.core.queue.requeue(queued, Rejection())
            return None
        if decision.placed:
            self.core.queue.done(decision.pod.uid)
        else:
            self.core.queue.requeue(batch[0], Rejection(decision.rejected_by))
        return decision


@pytest.mark.parametrize("poison", POISON, ids=lambda each: each.name)
def test_a_poison_pod_is_placed_or_refused_in_words_soon_and_never_lost(poison: Poison) -> None:
    feed = Feed()
    feed.show(pod_body("warm"))
    feed.decide()
    with no_collector():
        began_s = time.process_time()
        told = feed.show(poison.body)
        tried = told and not feed.core.queue.pending()["gated"]
        decision = feed.decide() if tried else None
        took_s = time.process_time() - began_s
    assert is_within(took_s, MOST_S)
    check_queue(feed.core.queue)
    if not tried:
        return
    if decision is None:
        assert not poison.live, "a pod the API server takes met a bug"
        return
    assert decision.placed or decision.message
    assert len(decision.message) < 4096


def test_the_healthy_pod_behind_all_of_them_gets_its_node() -> None:
    feed = Feed()
    for poison in POISON:
        feed.show(poison.body)
    feed.show(pod_body("healthy"))
    placed = []
    while feed.core.queue.pending()["active"]:
        decision = feed.decide()
        placed += [decision.pod.name] if decision is not None and decision.placed else []
    assert "healthy" in placed
    check_queue(feed.core.queue)


def test_pods_that_run_with_poison_in_them_leave_the_others_their_speed() -> None:
    plain = Feed()
    feed = Feed()
    for index, poison in enumerate(POISON):
        running = {**poison.body, "spec": {**poison.body["spec"], "nodeName": f"n{index % NODES}"}}
        with suppress(ValueError, AttributeError, OverflowError):  # the feed counts these as poison
            feed.show(running)
    costs = []
    for each in (plain, feed):
        for number in range(20):
            each.show(pod_body(f"healthy-{number}", metadata={"labels": {"app": "a-1"}}))
        with no_collector():
            began_s = time.process_time()
            decisions = [each.decide() for _ in range(20)]
            costs.append(time.process_time() - began_s)
        assert all(decision is not None and decision.placed for decision in decisions)
    assert is_within(costs[1], 10 * costs[0] + MOST_S)
