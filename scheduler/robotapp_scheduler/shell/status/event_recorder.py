"""Pod events under the name of the profile that decided: reportingController is the schedulerName, as upstream's."""

import asyncio
import socket
from collections.abc import Iterable

from robotapp_api.model.names import EventReason
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_client.api.client import ApiClient, Json
from robotapp_client.tools.event_recorder import EventRecorder, reference
from robotapp_scheduler.core.api.core_v1 import Pod

QUEUE = 20_000
"""Deep enough for the events of a burst of placements, so that none is dropped while the API server catches up."""
IN_FLIGHT = 48
"""Writes at once: as many as bring Events to an end soon after the binds."""


class PodEvents:
    """One recorder per schedulerName."""

    def __init__(self, client: ApiClient, scheduler_names: Iterable[str], *, host: str | None = None) -> None:
        host = host or socket.gethostname()
        self._recorders = {
            name: EventRecorder(client, controller=name, instance=f"{name}-{host}", queue=QUEUE, in_flight=IN_FLIGHT)
            for name in scheduler_names
        }

    def __repr__(self) -> str:
        return f"<PodEvents {list(self._recorders.values())}>"

    def pod_event(self, pod: Pod, *, warning: bool, reason: str, action: str, note: str, by: str = "") -> None:
        """Queue one event about a pod, reported by its own profile or by that named `by`; never waits, never raises."""
        recorder = self._recorders.get(by or pod.spec.scheduler_name)
        if recorder is None:
            return
        meta = pod.metadata
        regarding = reference(
            api_version="v1",
            kind="Pod",
            name=meta.name,
            namespace=meta.namespace,
            uid=meta.uid,
            resource_version=meta.resource_version,
        )
        once = reason is EventReason.SCHEDULED  # no pod is bound twice
        recorder.event(regarding, reason=reason, note=note, action=action, warning=warning, once=once)

    def about(self, regarding: Json, *, reason: str, note: str, warning: bool) -> None:
        """Queue one event about our own configuration."""
        recorder = next(iter(self._recorders.values()))
        recorder.event(regarding, reason=reason, note=note, action="Configuring", warning=warning)

    def conflicts(self, found: Iterable[ClaimConflict]) -> None:
        """Two run with one thing: bare pods get an event here, in words for their namespace; apps from the operator."""
        recorder = next(iter(self._recorders.values()))
        for conflict in found:
            for pod in conflict.parties:
                if pod.is_app:
                    continue
                regarding = reference(
                    api_version=pod.api_version, kind=pod.kind, name=pod.name, namespace=pod.namespace, uid=pod.uid
                )
                note = conflict.message(for_namespace=pod.namespace)
                recorder.event(regarding, reason=EventReason.CLAIM_CONFLICT, note=note, action="Sweeping", warning=True)

    async def run(self) -> None:
        """Write until cancelled."""
        async with asyncio.TaskGroup() as group:
            for recorder in self._recorders.values():
                group.create_task(recorder.run())

    async def drain(self, timeout_s: float = 2.0) -> None:
        """Wait until what is queued is written."""
        await asyncio.gather(*(recorder.drain(timeout_s) for recorder in self._recorders.values()))
