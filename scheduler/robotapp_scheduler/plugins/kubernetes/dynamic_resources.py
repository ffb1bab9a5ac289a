"""DynamicResources: devices behind resource claims are not allocated here, so pods with such claims are refused."""

from robotapp_scheduler.core.changes import Change
from robotapp_scheduler.core.framework import Code, PreFilter, Status
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes


class DynamicResources:
    """Allocation of resource claims is left to kube-scheduler."""

    name = "DynamicResources"
    events = Change.NONE

    def pre_filter(self, pod: PodInfo, nodes: Nodes) -> PreFilter | None:  # noqa: ARG002 - the contract's signature
        """Refuses pods with resourceClaims."""
        for claim in pod.pod.spec.resource_claims:
            reason = f"resource claim {claim.name!r} is not allocated; this scheduler does not allocate devices"
            return PreFilter(status=Status(Code.UNRESOLVABLE, reason))
        return None
