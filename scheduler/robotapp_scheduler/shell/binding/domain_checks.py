"""The bind check of RobotApps' pods (claims.md rule 1): those that ask in the same turn of the event loop share their reads."""

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
"""The bind check in upstream's words for a permission."""
CheckAll = Callable[[Sequence[tuple[PodInfo, str]]], Awaitable[Mapping[str, Reserved]]]


class DomainChecks:
    """One per process. `check_all` answers for several pods, each with its node, by uid."""

    def __init__(self, check_all: CheckAll, metrics: Metrics, *, clock: Callable[[], float]) -> None:
        self._check_all = check_all
        self._metrics = metrics
        self._clock = clock
        self._asked: list[tuple[PodInfo, str, asyncio.Future[Reserved]]] = []
        self._reads: set[asyncio.Task[None]] = set()

    def __repr__(self) -> str:
        return f"<DomainChecks, {len(self._reads)} under way>"

    async def check(self, pod: PodInfo, node: str) -> Reserved:
        """Whether the claim of the pod's domain stands; the pod was seen pending before."""
        answer: asyncio.Future[Reserved] = asyncio.get_running_loop().create_future()
        self._asked.append((pod, node, answer))
        if len(self._asked) == 1:  # it begins when all who are about to ask have asked
            read = asyncio.create_task(self._read())
            self._reads.add(read)
            read.add_done_callback(self._reads.discard)
        return await answer

    async def _read(self) -> None:
        asked, self._asked = self._asked, []
        started_s = self._clock()
        try:
            found = await self._check_all([(pod, node) for pod, node, _ in asked])
        except Exception as error:  # noqa: BLE001 - whatever it is, it is raised where the answer is awaited
            _fail(asked, error)
            return
        except asyncio.CancelledError:
            _fail(asked, None)
            raise
        for pod, _, answer in asked:
            checked = found[pod.uid]
            self._metrics.permit_wait_s.labels(WAITED[checked.readiness]).observe(self._clock() - started_s)
            if not answer.done():
                answer.set_result(checked)


def _fail(asked: Sequence[tuple[PodInfo, str, asyncio.Future[Reserved]]], error: Exception | None) -> None:
    for _, _, answer in asked:
        if answer.done():
            continue
        if error is None:
            answer.cancel()
        else:
            answer.set_exception(error)
