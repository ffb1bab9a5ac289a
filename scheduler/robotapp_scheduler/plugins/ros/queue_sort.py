"""ROSQueueSort: by PriorityClass, then by ROS tier, then by time of arrival."""

from typing import Annotated, Any, Final

import msgspec

from robotapp_scheduler.core.api.ros import DEFAULT_QOS_CLASS, TIERS, thesis_tier, tier
from robotapp_scheduler.core.framework.argument_words import check_word, one_of
from robotapp_scheduler.core.pods.pod_info import PodInfo

ORDERS: Final = ("Priority", "Thesis")


class ROSQueueSortArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """order: Thesis puts the tier above PriorityClass. agingSeconds: a pod that waited so long gains one tier; 0 = off."""

    order: Annotated[str, one_of(ORDERS)] = "Priority"
    aging_seconds: float = 0.0


class ROSQueueSort:
    """Order of the active queue; smaller keys leave first."""

    name = "ROSQueueSort"
    Args = ROSQueueSortArgs

    def __init__(self, args: ROSQueueSortArgs | None = None) -> None:
        args = args or ROSQueueSortArgs()
        check_word("order", args.order, ORDERS)
        if not 0.0 <= args.aging_seconds <= 86_400.0:
            raise ValueError("agingSeconds: not in valid range [0-86400]")
        self._thesis = args.order == "Thesis"
        self._aging_s = args.aging_seconds

    def queue_key(self, pod: PodInfo, queued_s: float) -> tuple[Any, ...]:
        """System-critical pods, then PriorityClass, then tier (or the thesis' order), then time."""
        if self._thesis:
            return (-_tier(pod, thesis=True), -pod.priority, queued_s)
        level = _tier(pod, thesis=False)
        if self._aging_s > 0.0:
            # One virtual arrival time instead of two keys: a tier is worth agingSeconds of waiting.
            return (not pod.system_critical, -pod.priority, queued_s - level * self._aging_s)
        return (not pod.system_critical, -pod.priority, -level, queued_s)


def _tier(pod: PodInfo, *, thesis: bool) -> int:
    if pod.qos is None:
        return TIERS[DEFAULT_QOS_CLASS]
    qos_class, reliability, liveliness = pod.qos
    rule = thesis_tier if thesis else tier
    return rule(qos_class, reliability=reliability, liveliness=liveliness)
