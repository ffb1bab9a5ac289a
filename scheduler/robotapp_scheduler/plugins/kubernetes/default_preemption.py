"""DefaultPreemption: pods of lower priority make room for a pod that fits nowhere."""

import msgspec

from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import Failure, Outcome, preempt
from robotapp_scheduler.plugins.kubernetes.common.arguments import NEW, is_new


class DefaultPreemptionArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """On how many nodes an eviction is tried: the larger of a share of those that may help and a number.

    compatVersion "1.35": messages have the words of that release of Kubernetes.
    """

    min_candidate_nodes_percentage: int = 10
    min_candidate_nodes_absolute: int = 100
    compat_version: str = NEW


class DefaultPreemption:
    """Plans evictions; the shell carries them out, and holds the pod back meanwhile."""

    name = "DefaultPreemption"
    events = Change.NONE
    Args = DefaultPreemptionArgs

    def __init__(self, args: DefaultPreemptionArgs | None = None) -> None:
        args = args or DefaultPreemptionArgs()
        percentage, absolute = args.min_candidate_nodes_percentage, args.min_candidate_nodes_absolute
        if not 0 <= percentage <= 100:
            raise ValueError(f"minCandidateNodesPercentage: Invalid value: {percentage}: not in valid range [0, 100]")
        if absolute < 0:
            raise ValueError(f"minCandidateNodesAbsolute: Invalid value: {absolute}: not in valid range [0, inf)")
        if percentage == absolute == 0:
            raise ValueError(
                "minCandidateNodesPercentage: Invalid value: 0: cannot be zero at the same time as minCandidateNodesAbsolute"
            )
        self._percentage, self._absolute = percentage, absolute
        self._old_words = not is_new(args.compat_version)

    def post_filter(self, pod: PodInfo, failure: Failure) -> Outcome:  # noqa: ARG002 - the contract's signature
        """The node that the pod is nominated for, and the victims there."""
        found = preempt(failure, self._limit)
        if not self._old_words:
            return found
        # The text of DynamicResources' post_filter comes first; there is none when a node was found.
        return found._replace(text="" if found.plan is not None else f"no new claims to deallocate, {found.text}")

    def _limit(self, nodes: int) -> int:
        return min(max(nodes * self._percentage // 100, self._absolute), nodes)
