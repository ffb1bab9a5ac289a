"""The bind check of RobotApps' pods (claims.md rule 1): checks for one namespace in the same turn of the event loop share their reads.

Pods of other namespaces do not: an error of one read is the error of all pods that share it.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Final

from robotapp_scheduler.core.framework.handle import Readiness, Reserved
from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.shell.metrics.metrics import Metrics

WAITED: Final = {
    Readiness.READY: Code.SUCCESS,
    Readiness.WAIT: Code.UNSCHEDULABLE,
    Readiness.GONE: Code.UNSCHEDULABLE,
    Readiness.ERROR: Code.ERROR,
}
"""Result of the bind check → label of the metric of Permit waits."""
_Pending = tuple[PodInfo, str, asyncio.Future[Reserved]]
CheckAll = Callable[[Sequence[tuple[PodInfo, str]]], Awaitable[Mapping[str, Reserved]]]


class DomainChecks:
    """One per process. `check_all` checks several pods, each with its node; its results are by pod uid."""

    def __init__(self, check_all: CheckAll, metrics: Metrics, *, clock: Callable[[], float]) -> None:
        self._check_all = check_all
        self._metrics = metrics
        self._clock = clock
        self._pending: dict[str, list[_Pending]] = {}
        """By namespace."""
        self._reads: set[asyncio.Task[None]] = set()

    def __repr__(self) -> str:
        return f"<DomainChecks, {len(self._reads)} under way>"

    async def check(self, pod: PodInfo, node: str) -> Reserved:
        """Whether the claim of the pod's domain stands. The pod must have been pending before."""
        answer: asyncio.Future[Reserved] = asyncio.get_running_loop().create_future()
        pending = self._pending.setdefault(pod.namespace, [])
        pending.append((pod, node, answer))
        if len(pending) == 1:  # the task starts in the next turn of the loop, with all checks of this one
            read = asyncio.create_task(self._read(pod.namespace))
            self._reads.add(read)
            read.add_done_callback(self._reads.discard)
        return await answer

    async def _read(self, namespace: str) -> None:
        pending = self._pending.pop(namespace)
        started_s = self._clock()
        try:
            found = await self._check_all([(pod, node) for pod, node, _ in pending])
        except Exception as error:  # noqa: BLE001 - every error is raised where the result is awaited
            _fail(pending, error)
            return
        except asyncio.CancelledError:
            _fail(pending, None)
            raise
        for pod, _, answer in pending:
            checked = found[pod.uid]
            self._metrics.permit_wait_s.labels(WAITED[checked.readiness]).observe(self._clock() - started_s)
            if not answer.done():
                answer.set_result(checked)


def _fail(pending: Sequence[_Pending], error: Exception | None) -> None:
    """Raise the error where these results are awaited; None = cancel them."""
    for _, _, answer in pending:
        if answer.done():
            continue
        if error is None:
            answer.cancel()
        else:
            answer.set_exception(error)
