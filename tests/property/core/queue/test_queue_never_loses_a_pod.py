"""Random operations on the queue against a plain model of who must still be known, and upstream's timing rules."""

from collections.abc import Callable

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, precondition, rule
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import Clock, make_info, make_pod
from tests.support.seeds import count_examples

from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.registered_plugin import QueueingHint
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import PreEnqueueStatus, QueuedPodInfo, Rejection
from robotapp_scheduler.core.queue.scheduling_queue import SchedulingQueue

EVENTS = {"Fit": Change.POD_REMOVED | Change.NODE_ADDED, "Taint": Change.TAINTS, "Quiet": Change.NONE}
CHANGES = st.sampled_from((Change.POD_REMOVED, Change.TAINTS, Change.NODE_ADDED | Change.TAINTS, Change.LABELS))


def hint_of(plugin: str) -> Callable[[PodInfo, Event], bool] | None:
    """Taint's hint raises for some pods, Fit's answers by the labels of pod and event, Quiet has none."""

    def hint(info: PodInfo, event: Event) -> bool:
        if plugin == "Taint" and info.labels.get("value") == "y":
            raise ValueError("a mistake of the plugin")
        return bool(event.new is not None and event.new.metadata.labels == info.labels)

    return None if plugin == "Quiet" else hint


class QueueMachine(RuleBasedStateMachine):
    """`known` is what must not be lost; `flying` is what was popped and not handed back."""

    names = Bundle("names")

    def __init__(self) -> None:
        super().__init__()
        self.clock = Clock()
        self.closed: set[str] = set()
        self.flying: dict[str, QueuedPodInfo] = {}
        self.known: set[str] = set()
        self.deleted_in_flight: set[str] = set()
        self.queue = SchedulingQueue(
            clock=self.clock,
            key=lambda info, queued_s: (-info.priority, queued_s),
            gate=self.gate,
            hint=lambda _, plugin: QueueingHint(plugin, EVENTS[plugin], hint_of(plugin), ("labels",)),
            group=lambda info: info.labels.get("group") or None,
        )

    def gate(self, info: PodInfo) -> PreEnqueueStatus | None:
        if info.uid in self.closed:
            return PreEnqueueStatus(plugin="Gates", reason="closed", events=Change.LABELS)
        return None

    @rule(
        target=names,
        name=st.sampled_from("abcdefgh"),
        group=st.sampled_from(("", "", "g")),
        priority=st.integers(0, 2),
        gated=st.booleans(),
    )
    def add(self, name: str, group: str, priority: int, gated: bool) -> str:
        info = make_info(name, priority=priority, labels={"group": group})
        if info.uid not in self.known:
            if gated:
                self.closed.add(info.uid)
            self.queue.add(info)
            self.known.add(info.uid)
        return info.uid

    @rule(uid=names)
    def delete(self, uid: str) -> None:
        self.queue.delete(uid)
        if uid in self.flying:
            self.deleted_in_flight.add(uid)
        else:
            self.known.discard(uid)
            self.closed.discard(uid)

    @rule(uid=names, value=st.sampled_from(("x", "y")), group=st.sampled_from(("", "g")))
    def update(self, uid: str, value: str, group: str) -> None:
        if uid in self.known and uid not in self.deleted_in_flight:
            known = self.queue.get(uid) or self.flying[uid]
            labels = {"group": group, "value": value}
            self.queue.update(make_info(known.info.name, priority=known.info.priority, labels=labels))

    @rule(uid=names)
    def open_gate(self, uid: str) -> None:
        self.closed.discard(uid)

    @rule(change=CHANGES)
    def move(self, change: Change) -> None:
        self.queue.move(change)

    @rule(change=CHANGES, value=st.sampled_from(("x", "y")), group=st.sampled_from(("", "g")), gone=st.booleans())
    def something_happens_to_another_pod(self, change: Change, value: str, group: str, gone: bool) -> None:
        other = make_pod("other", labels={"group": group, "value": value})
        self.queue.move(Event("pods", change, other, None if gone else other))

    @rule(uid=names)
    def activate(self, uid: str) -> None:
        self.queue.activate([uid])

    @rule(seconds=st.sampled_from((0.1, 1.0, 11.0, 301.0)))
    def time_passes(self, seconds: float) -> None:
        self.clock.forward(seconds)
        self.queue.tick()

    @rule()
    def other_rules_decide_from_now_on(self) -> None:
        self.queue.rules_changed(initial_backoff_s=2.0, max_backoff_s=8.0)

    @rule()
    def pop(self) -> None:
        for queued in self.queue.pop():
            assert queued.info.uid in self.known
            assert queued.info.uid not in self.closed or queued.gate is None
            self.flying[queued.info.uid] = queued

    @precondition(lambda self: self.flying)
    @rule(data=st.data())
    def bound(self, data: st.DataObject) -> None:
        uid = data.draw(st.sampled_from(sorted(self.flying)))
        self.queue.done(uid)
        self._landed(uid)
        self.known.discard(uid)
        self.closed.discard(uid)

    @precondition(lambda self: self.flying)
    @rule(data=st.data(), plugins=st.sets(st.sampled_from(sorted(EVENTS)), max_size=2))
    def refused(self, data: st.DataObject, plugins: set[str]) -> None:
        uid = data.draw(st.sampled_from(sorted(self.flying)))
        queued = self.flying[uid]
        self.queue.requeue(queued, Rejection(plugins=frozenset(plugins)))
        if uid in self.deleted_in_flight:
            self.known.discard(uid)
            self.closed.discard(uid)
        self._landed(uid)

    def _landed(self, uid: str) -> None:
        del self.flying[uid]
        self.deleted_in_flight.discard(uid)

    @invariant()
    def every_pod_is_in_exactly_one_place(self) -> None:
        check_queue(self.queue)
        assert len(self.queue) == len(self.known)
        assert sum(self.queue.pending().values()) == len(self.known) - len(self.flying)

    def teardown(self) -> None:
        """Open every gate, end every flight and wait: each pod that is left must come out."""
        self.closed.clear()
        for uid in list(self.flying):
            self.queue.requeue(self.flying.pop(uid), Rejection(plugins=frozenset({"Quiet"})))
            if uid in self.deleted_in_flight:
                self.known.discard(uid)
        for _ in range(3):
            self.clock.forward(400.0)
            self.queue.tick()
        out: set[str] = set()
        while batch := self.queue.pop():
            out |= {queued.info.uid for queued in batch}
        assert out == self.known


TestQueue = QueueMachine.TestCase
TestQueue.settings = settings(max_examples=count_examples(150), stateful_step_count=40, deadline=None)
