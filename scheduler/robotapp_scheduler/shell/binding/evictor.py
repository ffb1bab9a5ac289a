"""Carries out a preemption: marks and deletes the victims, and clears nominations of lower priority to that node.

Everything here may be cancelled at any await: what was done is stored in the API server (condition, deletion, the preemptor's
nominatedNodeName), and the next attempt of the preemptor continues from there.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable

from robotapp_api.model.names import EventReason
from robotapp_client.api.bodies import STRATEGIC
from robotapp_client.api.client import ApiClient, Json
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import ApiError, ClientError, NotFound, may_pass, means_another, means_gone
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import Plan
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.status import messages
from robotapp_scheduler.shell.status.pod_status import Events, utc_now

log = logging.getLogger(__name__)

TRIES = 4
PARALLEL = 16
"""Writes of one preemption at a time, as many as upstream's default parallelism."""


class Evictor:
    """`start` returns at once; the preemptor is held back until its victims are deleted or on their way."""

    def __init__(
        self,
        core: SchedulerCore,
        client: ApiClient,
        events: Events,
        metrics: Metrics,
        *,
        clock: Callable[[], float],
        permitted: Callable[[], bool] = lambda: True,
        now: Callable[[], str] = utc_now,
        notify: Callable[[], None] = lambda: None,
    ) -> None:
        """`permitted` is called before every write: whether this process still holds the lease."""
        self._core = core
        self._client = client
        self._events = events
        self._metrics = metrics
        self._clock = clock
        self._permitted = permitted
        self._now = now
        self._notify = notify
        self._tasks: set[asyncio.Task[None]] = set()
        self._slots = asyncio.Semaphore(PARALLEL)

    def __repr__(self) -> str:
        return f"<Evictor {len(self._tasks)} preemptions in flight>"

    def start(self, plan: Plan, preemptor: PodInfo) -> None:
        """Begin to evict. Victims that are being deleted already need nothing more."""
        self._metrics.preempted(len(plan.victims), violations=plan.violations)
        victims = [victim.pod for victim in plan.victims if not victim.terminating]
        if not victims:
            return
        self._core.preempts(preemptor.uid)
        task = asyncio.create_task(self._carry_out(plan, victims, preemptor), name=f"preempt for {preemptor.key}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def drain(self, timeout_s: float) -> None:
        """Wait for the evictions in flight."""
        if self._tasks:
            await asyncio.wait(set(self._tasks), timeout=timeout_s)

    async def _carry_out(self, plan: Plan, victims: list[Pod], preemptor: PodInfo) -> None:
        started_s, failed = self._clock(), True
        try:
            lesser = self._core.cluster.nominations.below(preemptor.priority, plan.node)
            await asyncio.gather(*(self._clear_nomination(pod) for pod in lesser))
            # The last victim is deleted when the others are: its deletion is the event that lets the preemptor try again.
            results = await asyncio.gather(*(self._evict(pod, plan.node, preemptor) for pod in victims[:-1]))
            failed = not (all(results) and await self._evict(victims[-1], plan.node, preemptor))
        except Exception:  # a bug must not hold the preemptor for ever: it is tried again below
            log.exception("preemption on %s for %s failed", plan.node, preemptor.key)
        finally:
            self._metrics.preemption_s.labels("error" if failed else "success").observe(self._clock() - started_s)
            self._core.preempted(preemptor.uid, failed=failed)
            self._notify()

    async def _evict(self, victim: Pod, node: str, preemptor: PodInfo) -> bool:
        """Mark and delete one victim; False when that failed."""
        meta = victim.metadata
        condition = messages.disruption_patch(victim, by=preemptor.scheduler_name, now=self._now())

        async def mark() -> None:
            if not messages.is_disrupted(victim):
                await self._patch(victim, condition)

        async def delete() -> None:
            await self._client.delete(PODS, meta.name, namespace=meta.namespace, uid=meta.uid)

        async with self._slots:
            for step in (mark, delete):
                gone = await self._tried(step, victim)
                if gone is None:
                    return False
                if gone:
                    return True
        log.info("%s preempted %s on %s", preemptor.key, victim.key, node)
        self._events.pod_event(
            victim,
            warning=False,
            reason=EventReason.PREEMPTED,
            action="Preempting",
            note=messages.preempted(preemptor.uid, node),
            by=preemptor.scheduler_name,
        )
        return True

    async def _clear_nomination(self, pod: PodInfo) -> None:
        """Remove the nomination of a waiting pod of lower priority. A failed write does no harm: the cache has it already."""
        self._core.cluster.nominations.nominate(pod, "")
        patch = messages.clear_nomination_patch(pod.pod)
        async with self._slots:
            await self._tried(lambda: self._patch(pod.pod, patch), pod.pod)

    async def _patch(self, pod: Pod, patch: Json) -> None:
        meta = pod.metadata
        await self._client.patch(
            PODS, meta.name, patch, namespace=meta.namespace, subresource="status", content_type=STRATEGIC
        )

    async def _tried(self, step: Callable[[], Awaitable[None]], pod: Pod) -> bool | None:
        """Try one write until it succeeds or cannot. True: the pod is gone. False: written. None: it failed."""
        problem: ClientError | None = None
        for attempt in range(TRIES):
            if attempt:
                await self._client.sleep(0.05 * 5.0 ** (attempt - 1))
            if not self._permitted():
                return None
            try:
                await step()
            except NotFound as error:
                if means_gone(error, pod.metadata.name):
                    return True
                problem = error
            except ApiError as error:
                if means_another(error):
                    return True
                problem = error
                if not may_pass(error):
                    break
            except ClientError as error:
                problem = error
            else:
                return False
        log.warning("%s cannot be evicted: %s", pod.key, problem)
        return None
