"""Says on a PodGroup of the API server's own API whether its pods were placed: the condition PodGroupInitiallyScheduled.

False is written when an attempt failed, True once as many pods as it asks for are bound; what is true stays so. Groups of
`scheduling.x-k8s.io` belong to another controller, whose status we leave alone.
"""

import logging
from collections.abc import Callable, Sequence

from robotapp_api.client.api import ApiClient
from robotapp_api.client.apply import STRATEGIC
from robotapp_api.client.errors import ClientError, NotFound
from robotapp_api.client.resources import WORKLOAD_PODGROUPS
from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.decision import Decision
from robotapp_scheduler.core.objects import PodCondition
from robotapp_scheduler.core.pod_groups import INITIALLY_SCHEDULED, WORKLOADS, GroupRef, PodGroup, PodGroups
from robotapp_scheduler.core.whole import UNSCHEDULABLE_GROUP
from robotapp_scheduler.shell.newest import Newest
from robotapp_scheduler.shell.report import utc_now

log = logging.getLogger(__name__)

SCHEDULED = "Scheduled"


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
        self._waiting: Newest[GroupRef, tuple[str, str, str]] = Newest()

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
        for ref in self._groups.take_completed():
            if ref.api == WORKLOADS:
                self._say(ref, "True", SCHEDULED, "")

    async def run(self) -> None:
        """Write until cancelled."""
        while True:
            ref, (status, reason, message) = await self._waiting.take()
            group = self._groups.find(ref)
            if group is not None and self._permitted():
                await self._write(ref, group, _condition(group, status, reason, message, self._now()))

    def _say(self, ref: GroupRef, status: str, reason: str, message: str) -> None:
        group = self._groups.find(ref)
        if group is None:
            return
        said = _said(group)
        if said is not None and (
            said.status == "True" or (said.status, said.reason, said.message) == (status, reason, message)
        ):
            return
        self._waiting.put(ref, (status, reason, message))

    async def _write(self, ref: GroupRef, group: PodGroup, condition: dict[str, object]) -> None:
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
            return
        except ClientError as error:
            # The pods say it, too; the next attempt says it here again.
            log.warning("the condition of PodGroup %s/%s cannot be written: %s", ref.namespace, ref.name, error)


def _failure(decisions: Sequence[Decision], needed: int, there: int) -> str:
    """The text a pod was given that would have had a place; without one, that none had, and why not the first."""
    for decision in decisions:
        if decision.message.startswith(UNSCHEDULABLE_GROUP):
            return decision.message.removeprefix(UNSCHEDULABLE_GROUP)
    first = decisions[0]
    return f"minCount ({needed}) cannot be satisfied: {there} scheduled, 0 remaining; {first.pod.name}: {first.message}"


def _said(group: PodGroup) -> PodCondition | None:
    return next((found for found in group.status.conditions or () if found.type == INITIALLY_SCHEDULED), None)


def _condition(group: PodGroup, status: str, reason: str, message: str, now: str) -> dict[str, object]:
    said = _said(group)
    changed: dict[str, object] = {"lastTransitionTime": now} if said is None or said.status != status else {}
    return {
        "type": INITIALLY_SCHEDULED,
        "status": status,
        "reason": reason,
        "message": message,
        "observedGeneration": group.metadata.generation,
        **changed,
    }
