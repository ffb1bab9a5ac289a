"""Says on a PodGroup of the API server's own API whether its pods were placed: the condition PodGroupInitiallyScheduled.

False is written when an attempt failed, True once as many pods as it asks for are bound; what is true stays so. Groups of
`scheduling.x-k8s.io` belong to another controller, whose status we leave alone.
"""

import logging
from collections.abc import Callable, Sequence
from typing import NamedTuple

from robotapp_api.client.api import ApiClient
from robotapp_api.client.apply import STRATEGIC
from robotapp_api.client.errors import ClientError, NotFound
from robotapp_api.client.resources import WORKLOAD_PODGROUPS
from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.decision import Decision
from robotapp_scheduler.core.pod_group import INITIALLY_SCHEDULED, PodGroup
from robotapp_scheduler.core.pod_groups import WORKLOADS, GroupRef, PodGroups
from robotapp_scheduler.core.whole import UNSCHEDULABLE_GROUP
from robotapp_scheduler.shell.newest import Newest
from robotapp_scheduler.shell.report import utc_now

log = logging.getLogger(__name__)

SCHEDULED = "Scheduled"


class Word(NamedTuple):
    """What is said about one life of a group."""

    uid: str
    status: str
    reason: str
    message: str


class GroupReporter:
    """`decided` and `tick` only note what is to be said; `run` writes it, the newest word per group."""

    def __init__(
        self,
        client: ApiClient,
        groups: PodGroups,
        *,
        permitted: Callable[[], bool],
        now: Callable[[], str] = utc_now,
    ) -> None:
        """`permitted` is asked before every write: whether we still lead."""
        self._client = client
        self._groups = groups
        self._permitted = permitted
        self._now = now
        self._waiting: Newest[GroupRef, Word] = Newest()
        self._said: dict[GroupRef, Word] = {}
        """The last word about each group until the watch shows it: the group may look as before a word on its way."""
        self._again: set[GroupRef] = set()
        """Groups that are whole, which could not be written: no further attempt would say it."""

    def __repr__(self) -> str:
        return f"<GroupReporter {len(self._waiting)} conditions to write>"

    def decided(self, decisions: Sequence[Decision]) -> None:
        """An attempt for the pods of one batch ended. Says something only about a group that found no place."""
        ref = decisions[0].pod.pod_group
        if ref is None or ref.api != WORKLOADS or any(decision.placed for decision in decisions):
            return
        needed = self._groups.quorum(ref)
        if not needed:
            return
        broken = any(decision.reason == PodReason.SCHEDULER_ERROR for decision in decisions)
        reason = PodReason.SCHEDULER_ERROR if broken else PodReason.UNSCHEDULABLE
        self._say(ref, "False", reason, _failure(decisions, needed, self._groups.placed(ref)))

    def tick(self) -> None:
        """Once a second: groups of which enough pods are bound now."""
        again, self._again = self._again, set()
        for ref in {*self._groups.take_completed(), *again}:
            if ref.api == WORKLOADS:
                self._say(ref, "True", SCHEDULED, "")
        self._said = {ref: word for ref, word in self._said.items() if self._is_news(ref, word)}

    async def run(self) -> None:
        """Write until cancelled."""
        while True:
            ref, word = await self._waiting.take()
            group = self._groups.find(ref)
            mine = group is not None and group.metadata.uid == word.uid and self._permitted()
            if group is None or not mine or not await self._write(ref, group, _condition(group, word, self._now())):
                self._unsaid(ref, word)

    def _say(self, ref: GroupRef, status: str, reason: str, message: str) -> None:
        group = self._groups.find(ref)
        if group is None:
            return
        shown, word = _shown(group), Word(group.metadata.uid, status, reason, message)
        last = self._said.get(ref)
        if last is None or last.uid != word.uid:
            last = shown
        if word == last or any(each is not None and each.status == "True" for each in (last, shown)):
            return
        self._said[ref] = word
        self._waiting.put(ref, word)

    def _is_news(self, ref: GroupRef, word: Word) -> bool:
        group = self._groups.find(ref)
        return group is not None and group.metadata.uid == word.uid and _shown(group) != word

    def _unsaid(self, ref: GroupRef, word: Word) -> None:
        """It was said in vain: the next attempt says it again, or the next tick where there will be none."""
        if self._said.get(ref) == word:
            del self._said[ref]
        if word.status == "True":
            self._again.add(ref)

    async def _write(self, ref: GroupRef, group: PodGroup, condition: dict[str, object]) -> bool:
        """Was it written?"""
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
        except NotFound:
            return False
        except ClientError as error:
            # The pods say it, too.
            log.warning("the condition of PodGroup %s/%s cannot be written: %s", ref.namespace, ref.name, error)
            return False
        return True


def _failure(decisions: Sequence[Decision], needed: int, there: int) -> str:
    """The text a pod was given that would have had a place; without one, that none had, and why not the first."""
    for decision in decisions:
        if decision.message.startswith(UNSCHEDULABLE_GROUP):
            return decision.message.removeprefix(UNSCHEDULABLE_GROUP)
    first = decisions[0]
    return f"minCount ({needed}) cannot be satisfied: {there} scheduled, 0 remaining; {first.pod.name}: {first.message}"


def _shown(group: PodGroup) -> Word | None:
    """What its condition says, as far as we have seen."""
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
