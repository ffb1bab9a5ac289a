"""Writes the condition PodGroupInitiallyScheduled of PodGroups of the API server's own API.

False is written when an attempt failed, True once as many pods as it requires are bound; what is true stays so. Groups of
`scheduling.x-k8s.io` belong to another controller, whose status we leave alone.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from robotapp_api.model.names import PodReason
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.bodies import STRATEGIC
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import WORKLOAD_PODGROUPS
from robotapp_client.transport.errors import ApiError, ClientError, NotFound, may_pass, means_another
from robotapp_scheduler.core.api.pod_group import INITIALLY_SCHEDULED, PodGroup
from robotapp_scheduler.core.cycle.all_or_nothing import UNSCHEDULABLE_GROUP
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.pods.pod_group_index import WORKLOADS, GroupRef, PodGroups
from robotapp_scheduler.shell.status.pod_status import LatestQueue, utc_now

log = logging.getLogger(__name__)

SCHEDULED = "Scheduled"
PAUSE_S = 1.0
MOST_PAUSE_S = 60.0
"""Between the tries of a word that cannot be written for now, per group."""


class Word(NamedTuple):
    """What is reported about one life of a group."""

    uid: str
    status: str
    reason: str
    message: str


@dataclass(slots=True)
class _Record:
    """The last word about a group, until the watch shows it: the group may look as before a word on its way."""

    word: Word
    pause: Backoff
    due_s: float | None = None
    """When it is put in the queue once more; None while nothing stands in its way, and when it was given up."""
    warned: bool = False


class GroupReporter:
    """`decided` and `tick` only note what is to be written; `run` writes it, the newest condition per group."""

    def __init__(
        self,
        client: ApiClient,
        groups: PodGroups,
        *,
        permitted: Callable[[], bool],
        now: Callable[[], str] = utc_now,
    ) -> None:
        """`permitted` is called before every write: whether this process still holds the lease."""
        self._client = client
        self._groups = groups
        self._permitted = permitted
        self._now = now
        self._waiting: LatestQueue[GroupRef, _Record] = LatestQueue()
        self._records: dict[GroupRef, _Record] = {}

    def __repr__(self) -> str:
        return f"<GroupReporter {len(self._waiting)} conditions to write>"

    def decided(self, decisions: Sequence[ScheduleResult]) -> None:
        """An attempt for the pods of one batch ended. Says something only about a group that found no place."""
        ref = decisions[0].pod.pod_group
        if ref is None or ref.api != WORKLOADS or any(decision.placed for decision in decisions):
            return
        needed = self._groups.quorum(ref)
        if not needed:
            return
        broken = any(decision.reason == PodReason.SCHEDULER_ERROR for decision in decisions)
        reason = PodReason.SCHEDULER_ERROR if broken else PodReason.UNSCHEDULABLE
        group = self._groups.find(ref)
        if group is not None:
            text = _failure(decisions, needed, self._groups.placed(ref))
            self._say(ref, group, Word(group.metadata.uid, "False", reason, text))

    def tick(self) -> None:
        """Once a second: groups of which enough pods are bound now, and words whose pause is over."""
        self._records = {ref: record for ref, record in self._records.items() if self._is_changed(ref, record)}
        if not self._permitted():
            return
        for ref, uid in self._groups.take_completed():
            group = self._groups.find(ref)
            if ref.api == WORKLOADS and group is not None and group.metadata.uid == uid:
                self._say(ref, group, Word(uid, "True", SCHEDULED, ""))
        now_s = self._client.clock()
        for ref, record in self._records.items():
            if record.due_s is not None and record.due_s <= now_s:
                record.due_s = None
                self._waiting.put(ref, record)

    async def run(self) -> None:
        """Write until cancelled."""
        while True:
            ref, record = await self._waiting.take()
            group = self._groups.find(ref)
            if group is None or not _may_be_written(record.word, group) or record.due_s is not None:
                continue
            if self._permitted():
                await self._write(ref, group, record)
            else:
                record.due_s = self._client.clock()

    def _say(self, ref: GroupRef, group: PodGroup, word: Word) -> None:
        record = self._records.get(ref)
        if record is not None and record.word.uid != word.uid:
            record = None
        last = record.word if record is not None else _shown(group)
        if word == last or (last is not None and last.status == "True") or not _may_be_written(word, group):
            return
        if record is None:
            pause = Backoff(base_s=PAUSE_S, cap_s=MOST_PAUSE_S, uniform=self._client.uniform)
            record = self._records[ref] = _Record(word, pause)
        record.word = word
        if record.due_s is None:
            self._waiting.put(ref, record)

    def _is_changed(self, ref: GroupRef, record: _Record) -> bool:
        group = self._groups.find(ref)
        if group is None or not _may_be_written(record.word, group):
            return False
        # While a write is due or waiting, the status in the cache may be older than the last write: it is not compared.
        return record.due_s is not None or self._waiting.get(ref) is record or _shown(group) != record.word

    async def _write(self, ref: GroupRef, group: PodGroup, record: _Record) -> None:
        condition = _condition(group, record.word, self._now())
        patch = {"metadata": {"uid": group.metadata.uid}, "status": {"conditions": [condition]}}
        try:
            await self._client.patch(
                WORKLOAD_PODGROUPS,
                ref.name,
                patch,
                namespace=ref.namespace,
                subresource="status",
                content_type=STRATEGIC,
            )
        except ClientError as error:
            self._failed(ref, record, error)
        else:
            record.pause.reset()
            record.warned = False

    def _failed(self, ref: GroupRef, record: _Record, error: ClientError) -> None:
        """What may pass is tried again after a pause, the rest is given up: only another word is tried after it."""
        if isinstance(error, NotFound) or (isinstance(error, ApiError) and means_another(error)):
            return
        if may_pass(error):
            least_s = error.pause_s if isinstance(error, ApiError) else 0.0
            record.due_s = self._client.clock() + record.pause.next_s(at_least_s=least_s)
        if not record.warned:
            record.warned = True
            # The conditions of the pods have it, too.
            log.warning("the condition of PodGroup %s/%s cannot be written: %s", ref.namespace, ref.name, error)


def _failure(decisions: Sequence[ScheduleResult], needed: int, there: int) -> str:
    """The text a pod was given that would have had a place; without one, that none had, and why not the first."""
    for decision in decisions:
        if decision.message.startswith(UNSCHEDULABLE_GROUP):
            return decision.message.removeprefix(UNSCHEDULABLE_GROUP)
    first = decisions[0]
    return f"minCount ({needed}) cannot be satisfied: {there} scheduled, 0 remaining; {first.pod.name}: {first.message}"


def _may_be_written(word: Word, group: PodGroup) -> bool:
    """Of this life of the group, which does not show True yet: that stays."""
    shown = _shown(group)
    return group.metadata.uid == word.uid and (shown is None or shown.status != "True")


def _shown(group: PodGroup) -> Word | None:
    """The group's condition in the cache."""
    for found in group.status.conditions or ():
        if found.type == INITIALLY_SCHEDULED:
            return Word(group.metadata.uid, found.status, found.reason, found.message)
    return None


def _condition(group: PodGroup, word: Word, now: str) -> dict[str, object]:
    shown = _shown(group)
    changed: dict[str, object] = {"lastTransitionTime": now} if shown is None or shown.status != word.status else {}
    return {
        "type": INITIALLY_SCHEDULED,
        "status": word.status,
        "reason": word.reason,
        "message": word.message,
        "observedGeneration": group.metadata.generation,
        **changed,
    }
