"""Reads why pods do not get to their containers: a mount that fails, or a pull secret that is missing, is in their events alone.

Events are read for the few pods that wait, a few at a time. The operator may not read Secrets, so this is how a missing one
gets its name.
"""

import logging
from collections.abc import Awaitable, Callable
from typing import Final

import msgspec

from robotapp_client import ApiClient, ClientError, Forbidden
from robotapp_client.api.client import with_query
from robotapp_client.api.resources import EVENTS
from robotapp_operator.plan.spec.objects import Pod
from robotapp_operator.plan.status.pods.pod_warnings import PodWarning, awaits_sandbox, explain_warnings
from robotapp_operator.queue.work import name_of
from robotapp_operator.queue.workqueue import Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.enqueue import enqueue_status

log = logging.getLogger(__name__)

AT_ONCE: Final = 5
"""Pods whose events are read in one turn of a namespace."""
MOST_EVENTS: Final = 50
"""Of one pod; the API server keeps one for each cause."""
SOON_S: Final = 2.0
LATER_S: Final = 15.0
NEW_S: Final = 12.0
"""A pod that has waited for so long is looked at less often."""
GIVE_BACK_S: Final = 30.0
"""A device that the driver has refused for so long is given back."""
IN_USE: Final = " is in use by "
"""Words of the driver about a device that another claim has prepared."""
REFUSED_S: Final = 300.0
"""Pause after the API server has refused to list events, as by the rights of an older chart."""


class _Series(msgspec.Struct, rename="camel"):
    last_observed_time: str | None = None


class _Event(msgspec.Struct, rename="camel"):
    reason: str | None = ""
    note: str | None = ""
    event_time: str | None = None
    deprecated_last_timestamp: str | None = None
    series: _Series | None = None

    @property
    def last_seen(self) -> str:
        """Returns when it was seen last: RFC 3339 in UTC, so that texts sort as times do."""
        series = self.series.last_observed_time if self.series else None
        return series or self.deprecated_last_timestamp or self.event_time or ""


class _Events(msgspec.Struct):
    items: list[_Event] | None = None


_DECODER: Final = msgspec.json.Decoder(_Events)


class PodEvents:
    """Keeps `cache.pod_failures` for the pods of `cache.waiting_pods`. `clock` is monotonic."""

    def __init__(
        self,
        client: ApiClient,
        cache: Cache,
        queue: Queue,
        *,
        clock: Callable[[], float],
        on_refused: Callable[[Pod], Awaitable[None]] | None = None,
    ) -> None:
        """on_refused: called again and again with a pod that could not have its device for GIVE_BACK_S, because another claim keeps it, or
        because its own claim was deleted.
        """
        self._on_refused = on_refused
        self._client = client
        self._cache = cache
        self._queue = queue
        self._clock = clock
        self._read_s: dict[str, dict[str, float]] = {}
        """By namespace and uid of a waiting pod: when its events were read last."""
        self._began_s: dict[str, float] = {}
        self._refused_s: dict[str, float] = {}
        """By the uid of a waiting pod: when it was first seen that it cannot have its device."""

    def __repr__(self) -> str:
        return f"<PodEvents: {sum(map(len, self._read_s.values()))} pods>"

    async def look(self, group: str) -> float | None:
        """Reads events of pods of one namespace. Returns after how many seconds to look again, None for not before a pod waits."""
        namespace = name_of(group)
        pods = self._cache.waiting_pods.get(namespace, {})
        read_s = {uid: at for uid, at in self._read_s.pop(namespace, {}).items() if uid in pods}
        for times in (self._began_s, self._refused_s):
            for uid in [uid for uid in times if not self._cache.is_waiting(uid)]:
                del times[uid]
        if not pods:
            return None
        self._read_s[namespace] = read_s
        now_s = self._clock()
        for uid in pods:
            self._began_s.setdefault(uid, now_s)
        for uid in sorted(pods, key=lambda uid: (read_s.get(uid, float("-inf")), uid))[:AT_ONCE]:
            read_s[uid] = now_s
            try:
                await self._read(pods[uid])
                if self._is_refused(pods[uid], now_s) and self._on_refused is not None:
                    await self._on_refused(pods[uid])
            except Forbidden as refusal:
                log.warning(
                    "events of namespace %s cannot be listed, so mounts that fail have no name: %s", namespace, refusal
                )
                return REFUSED_S
            except ClientError as error:
                log.info("events of a pod in namespace %s cannot be read: %s", namespace, error)
                return LATER_S
        is_new = any(uid not in read_s or now_s - self._began_s[uid] < NEW_S for uid in pods)
        return SOON_S if is_new else LATER_S

    def _is_refused(self, pod: Pod, now_s: float) -> bool:
        """Whether the pod could not have its device for so long that it shall have another one.

        A driver that is away refuses nothing: its claims stay as they are. The event outlives the refusal, so a pod that waits for
        something later, such as its image, has its device.
        """
        uid = pod.metadata.uid
        failure = self._cache.pod_failures.get(uid, "")
        is_unprepared = failure.startswith("FailedPrepareDynamicResources") and awaits_sandbox(pod)
        if not (is_unprepared and (IN_USE in failure or self._cache.allocations.lacks_its_claim(pod))):
            self._refused_s.pop(uid, None)
            return False
        return now_s - self._refused_s.setdefault(uid, now_s) >= GIVE_BACK_S

    async def _read(self, pod: Pod) -> None:
        meta = pod.metadata
        query = {"fieldSelector": f"regarding.uid={meta.uid},type=Warning", "limit": str(MOST_EVENTS)}
        answer = await self._client.read(with_query(EVENTS.path(meta.namespace), query), _DECODER.decode)
        newest = sorted(answer.items or (), key=lambda event: event.last_seen, reverse=True)
        text = explain_warnings([PodWarning(event.reason or "", event.note or "") for event in newest])
        if self._cache.is_waiting(meta.uid) and self._cache.pod_failures.get(meta.uid, "") != text:
            self._cache.pod_failures[meta.uid] = text
            self._cache.touch(meta.app_uid, meta.instance)
            enqueue_status(self._queue, meta.app_uid, meta.instance)
