"""Pods of this scheduler that a kubelet rejected after the bind: another scheduler filled the node first, or a device was gone.

The pod watch leaves out ended pods, so such a pod merely vanishes from it. A pod that vanishes without a deletion
and before it ever ran is read once, and the result is reported: as an event on the pod and as a metric by reason.
"""

import asyncio
import logging
from typing import Final

from robotapp_api.model.names import EventReason
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import ClientError
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.status import messages
from robotapp_scheduler.shell.status.pod_status import Events

log = logging.getLogger(__name__)

OUT_OF: Final = "OutOf"
ADMISSION: Final = frozenset({"UnexpectedAdmissionError", "NodeAffinity", "NodePorts", "NodeName", "TaintToleration"})
"""Reasons with which a kubelet fails a pod at admission, beside OutOfcpu, OutOfmemory, OutOfpods …"""
MOST_WAITING: Final = 1000


class KubeletRejections:
    """`look_at` notes a vanished pod and never waits; `run` reads and reports, on the leader only."""

    def __init__(self, client: ApiClient, events: Events, metrics: Metrics) -> None:
        self._client = client
        self._events = events
        self._metrics = metrics
        self._vanished: asyncio.Queue[Pod] = asyncio.Queue(MOST_WAITING)

    def __repr__(self) -> str:
        return f"<KubeletRejections {self._vanished.qsize()} pods to read>"

    def look_at(self, pod: Pod) -> None:
        """A pod of this scheduler is no longer in the watch; `pod` is its last version."""
        vanished = pod.spec.node_name and not pod.metadata.deletion_timestamp and pod.status.phase in {"", "Pending"}
        if vanished and not self._vanished.full():
            self._vanished.put_nowait(pod)

    async def run(self) -> None:
        """Read and report until cancelled."""
        while True:
            await self._judge(await self._vanished.get())

    async def _judge(self, pod: Pod) -> None:
        meta = pod.metadata
        try:
            found = await self._client.get(PODS, meta.name, namespace=meta.namespace, as_type=Pod)
        except ClientError as error:
            log.debug("what became of %s is not known: %s", pod.key, error)  # deleted, in nearly every case
            return
        reason = found.status.reason
        if found.metadata.uid != meta.uid or not rejected(found):
            return
        log.warning("%s was refused by %s: %s", pod.key, pod.spec.node_name, reason)
        self._metrics.node_rejections.labels(reason).inc()
        self._events.pod_event(
            found,
            warning=True,
            reason=EventReason.KUBELET_REJECTED,
            action="Binding",
            note=messages.note(messages.rejected_by_kubelet(pod.spec.node_name, reason, found.status.message)),
        )


def rejected(pod: Pod) -> bool:
    """Did the kubelet fail this pod at admission?"""
    reason = pod.status.reason
    return pod.status.phase == "Failed" and (reason.startswith(OUT_OF) or reason in ADMISSION)
