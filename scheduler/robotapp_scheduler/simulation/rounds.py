"""Places the waiting pods of a core on paper, round by round, until no pod finds a node any more."""

from collections.abc import Callable
from typing import Final

from robotapp_scheduler.core.cycle.group_cycle import placement_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.core.robotics.fallback import EARLIEST, LATEST
from robotapp_scheduler.joint.solve import Limits, solve

ROUNDS: Final = 10
"""Refused pods are tried again while others found a node: a pod may wait for one that comes later."""
SETTLED: Final = Rejection(frozenset({"Simulation"}))
"""Parks a refused pod: no event wakes it, the next round does."""
PLANNING: Final = Limits(steps=20)
"""A group is planned for so many steps, not for some time: the same cluster has the same outcome on any machine."""
_NO_TIME = 0.0


class Rounds:
    """`place` the queue of a core. `placed` is called with each pod that got a node, `popped` with the number of pods tried."""

    def __init__(
        self,
        core: SchedulerCore,
        *,
        placed: Callable[[ScheduleResult], None],
        popped: Callable[[int], None] = lambda _: None,
    ) -> None:
        self._core = core
        self._placed = placed
        self._popped = popped
        self._rejected: dict[str, ScheduleResult] = {}

    def __repr__(self) -> str:
        return f"<Rounds of {self._core!r}>"

    def place(self) -> dict[str, ScheduleResult]:
        """Decide until no pod finds a node any more. Returns the refused ones by pod uid; gated ones stay in the queue.

        Then time passes once: `placement.fallback` gives up what it held.
        """
        cluster = self._core.cluster
        live = cluster.now
        try:
            cluster.now = lambda: EARLIEST
            self._rounds()
            if self._rejected and self._core.holding:
                cluster.now = lambda: LATEST
                self._core.queue.activate(list(self._rejected))
                self._rounds()
        finally:
            cluster.now = live
        return self._rejected

    def _rounds(self) -> None:
        for _ in range(ROUNDS):
            if not self._round() or not self._rejected:
                break
            self._core.queue.activate(list(self._rejected))

    def _round(self) -> bool:
        """One pass over the queue; True when a pod found a node."""
        found = False
        cluster = self._core.cluster
        while batch := self._core.queue.pop():
            self._popped(len(batch))
            joint = self._core.joint_problem_of(batch)
            planned = (
                placement_of(joint, solve(joint.problem, PLANNING, lambda: _NO_TIME)) if joint is not None else None
            )
            for decision in self._core.schedule(batch, placement=planned):
                uid = decision.pod.uid
                if decision.placed:
                    found = True
                    self._rejected.pop(uid, None)
                    self._core.queue.done(uid)
                    if decision.claims is not None:
                        cluster.resource_claims.carry_out(uid, decision.pod.name)
                    self._placed(decision)
                elif decision.queued is not None:
                    self._rejected[uid] = decision
                    self._core.queue.requeue(decision.queued, SETTLED)
        return found
