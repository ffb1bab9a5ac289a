"""The scheduling loop: pop a pod, decide, hand over to the binding cycle; one event loop, no threads.

Deciding is synchronous and takes microseconds; binding is concurrent and bounded. After a slice of decisions the loop
yields, so that watch events and replies are processed in between.
"""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from functools import partial

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.cycle.group_cycle import GroupPlacement
from robotapp_scheduler.core.cycle.joint_problem import JointProblem
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo, Rejection
from robotapp_scheduler.shell.binding.binding_cycle import BindingCycle, Sent
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.planner.planner import Planner
from robotapp_scheduler.shell.process.response_batching import ResponseBatching
from robotapp_scheduler.shell.status.pod_group_status import GroupReporter
from robotapp_scheduler.shell.status.pod_status import Reporter

log = logging.getLogger(__name__)

IN_FLIGHT = 128
"""Pods between decision and the reply to their bind: enough that the API server stays busy while replies are batched."""
SLICE = 32
SLICE_S = 0.002
"""The loop yields to other tasks after this many decisions, or after this time."""
BUG = "internal error while looking for a node; the scheduler's log has the stack"
TICK_S = 1.0
POOLS_S = 10.0
"""Interval at which pods that wait for a domain are tried again, because their pool may have grown."""


class SchedulerLoop:
    """`run` until `stop` is called; `wake` whenever something may have changed for a waiting pod."""

    def __init__(
        self,
        core: SchedulerCore,
        binding_cycle: BindingCycle,
        reporter: Reporter,
        metrics: Metrics,
        *,
        planner: Planner,
        groups: GroupReporter,
        clock: Callable[[], float],
        permitted: Callable[[], bool] = lambda: True,
    ) -> None:
        """`permitted` is called before every decision: whether this process still holds the lease."""
        self._core = core
        self._binding_cycle = binding_cycle
        self._reporter = reporter
        self._metrics = metrics
        self._planner = planner
        self._groups = groups
        self._clock = clock
        self._permitted = permitted
        self._woken = asyncio.Event()
        self._slots = IN_FLIGHT
        """Free slots: each batch takes one until it is bound, or waits for something that may take long."""
        self._freed = 0
        self._batching = ResponseBatching(lambda: self._slots < IN_FLIGHT // 2, lambda: self._freed)
        self._tasks: set[asyncio.Task[None]] = set()
        self._sent = 0
        self._landed = asyncio.Event()
        self._stopping = False
        self._pools_due_s = clock() + POOLS_S
        self.turned_s = clock()
        """When the loop last turned: liveness."""
        self.deciding: Sequence[QueuedPodInfo] = ()
        """The batch that is being decided now, for the watchdog."""

    def __repr__(self) -> str:
        return f"<SchedulerLoop {self._sent + len(self._tasks)} batches in flight, {self._core!r}>"

    def notify(self) -> None:
        self._woken.set()

    def stop(self) -> None:
        """Take no further pods; what is in flight is finished by `drain`."""
        self._stopping = True
        self._woken.set()

    async def run(self) -> None:
        """Schedule until stopped."""
        ticker = asyncio.create_task(self._tick_forever(), name="tick")
        try:
            decided, began_s = 0, self._clock()
            while not self._stopping:
                batch = self._core.queue.pop() if self._slots and self._permitted() else []
                if not batch:
                    await self._idle()
                    decided, began_s = 0, self._clock()
                    continue
                self._begin(batch)
                decided += len(batch)
                if decided >= SLICE or self._clock() - began_s >= SLICE_S:
                    await asyncio.sleep(0)
                    decided, began_s = 0, self._clock()
        finally:
            ticker.cancel()

    def _begin(self, batch: Sequence[QueuedPodInfo]) -> None:
        if len(batch) == 1 and self._binding_cycle.waits_on(batch[0]):
            return
        self._slots -= 1
        self._batching.begin()
        joint = self._joint_problem(batch)
        if joint is None:
            self._decide(batch)
        else:
            self._follow(self._plan(batch, joint))

    async def drain(self, timeout_s: float) -> None:
        """Wait for the binds in flight."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                # A plan that arrives meanwhile adds a task.
                while self._tasks or self._sent:
                    self._landed.clear()
                    await self._landed.wait()

    def _joint_problem(self, batch: Sequence[QueuedPodInfo]) -> JointProblem | None:
        """The problem that the planner has to solve before these pods are scheduled, if any."""
        self.deciding = batch
        try:
            return self._core.joint_problem_of(batch)
        except Exception:  # a bug here must not hold the pods: they are placed one by one
            log.exception("posing the problem of %s failed", _names(batch))
            return None
        finally:
            self.deciding = ()

    async def _plan(self, batch: Sequence[QueuedPodInfo], joint: JointProblem) -> None:
        """Await the plan and schedule the batch by it. Others are placed meanwhile: the cycle checks the plan again, and pods of
        the batch may be gone.
        """
        try:
            placement = await self._planner.advise(joint)
        except Exception:  # a bug in the planner must not keep the pods in flight for ever
            log.exception("planning %s failed", _names(batch))
            placement = None
        left = [queued for queued in batch if self._core.queue.wanted(queued)]
        if left:
            self._decide(left, placement)
        else:
            self._free()

    def _follow(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _decide(self, batch: Sequence[QueuedPodInfo], placement: GroupPlacement | None = None) -> None:
        started_s = self._clock()
        self.deciding = batch
        try:
            decisions = self._core.schedule(batch, placement=placement)
        except Exception:  # a bug met with this batch must not stop the others; it is retried after back-off
            log.exception("deciding about %s failed", _names(batch))
            for queued in batch:
                self._core.cluster.forget(queued.info.uid)
                self._core.queue.requeue(queued, Rejection())
                self._reporter.unscheduled(queued.info.pod, reason=PodReason.SCHEDULER_ERROR, message=BUG)
            self._free()
            return
        finally:
            self.deciding = ()
        self._metrics.algorithm_s.observe(self._clock() - started_s)
        self._groups.decided(decisions)
        placed = [decision for decision in decisions if decision.placed]
        for decision in decisions:
            if not decision.placed:
                self._binding_cycle.handle_failure(decision, started_s=started_s)
        if not placed:
            self._free()
            return
        if len(placed) == 1 and self._binding_cycle.is_plain(placed[0]):
            self._send(placed[0], started_s)
            return
        task = asyncio.create_task(self._carry_out(placed, started_s))
        self._tasks.add(task)
        # Making volumes or a permit may take minutes: the slot is given free for other pods.
        slow = any(self._binding_cycle.may_take_long(decision) for decision in placed)
        if slow:
            self._free()
        task.add_done_callback(self._ended if slow else self._finished)

    def _send(self, decision: ScheduleResult, started_s: float) -> None:
        """Send a plain Binding without a task that waits for the reply."""
        self._sent += 1
        try:
            self._binding_cycle.send(decision, partial(self._sent_done, decision, started_s))
        except Exception:  # a pod must never stay assumed and forgotten because of a bug
            log.exception("placing %s failed", decision.pod.key)
            self._abandon(decision)
            self._send_ended()

    def _sent_done(self, decision: ScheduleResult, started_s: float, sent: Sent, error: Exception | None) -> None:
        if error is not None:
            self._follow(self._retry(decision, sent, error, started_s))
            return
        try:
            self._binding_cycle.sent(decision, sent, started_s=started_s)
        except Exception:  # as above
            log.exception("placing %s failed", decision.pod.key)
            self._abandon(decision)
        self._send_ended()

    async def _retry(self, decision: ScheduleResult, sent: Sent, error: Exception, started_s: float) -> None:
        try:
            await self._binding_cycle.retry(decision, sent, error, started_s=started_s)
        except Exception:  # as above
            log.exception("placing %s failed", decision.pod.key)
            self._abandon(decision)
        finally:
            self._send_ended()

    def _send_ended(self) -> None:
        self._sent -= 1
        self._free()
        self._landed.set()

    def _free(self) -> None:
        self._slots += 1
        self._freed += 1
        self._woken.set()

    async def _carry_out(self, placed: Sequence[ScheduleResult], started_s: float) -> None:
        if len(placed) == 1:
            await self._place(placed[0], started_s)
            return
        async with asyncio.TaskGroup() as group:
            for decision in placed:
                group.create_task(self._place(decision, started_s))

    async def _place(self, decision: ScheduleResult, started_s: float) -> None:
        try:
            await self._binding_cycle.place(decision, started_s=started_s)
        except Exception:  # a pod must never stay assumed and forgotten because of a bug
            log.exception("placing %s failed", decision.pod.key)
            self._abandon(decision)

    def _abandon(self, decision: ScheduleResult) -> None:
        try:
            self._binding_cycle.abandon(decision)
        except Exception:  # the other pods of the batch go on: raising here would cancel their binds half-way
            log.exception("abandoning %s failed", decision.pod.key)

    def _finished(self, task: asyncio.Task[None]) -> None:
        self._free()
        self._ended(task)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        self._landed.set()
        self._woken.set()

    async def _idle(self) -> None:
        """Sleep until `wake`, a finished task or the tick of each second."""
        self.turned_s = self._clock()
        await self._woken.wait()
        self._woken.clear()

    async def _tick_forever(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            self.tick()

    def tick(self) -> None:
        """To be called once a second: ends back-offs, ages telemetry, and writes conditions of pods that wait long."""
        self.turned_s = self._clock()
        core = self._core
        core.queue.tick()
        core.end_holds()
        core.queue.move(core.cluster.tick())
        if self.turned_s >= self._pools_due_s:
            self._pools_due_s = self.turned_s + POOLS_S
            core.queue.move(Change.POOLS)
        for queued, gate in core.held():
            self._reporter.unscheduled(queued.info.pod, reason=gate.code, message=gate.reason)
        self._groups.tick()
        self._binding_cycle.tick()
        self._reporter.tick()
        self._woken.set()


def _names(batch: Sequence[QueuedPodInfo]) -> str:
    return ", ".join(queued.info.key for queued in batch)
