"""DynamicResources: devices behind resource claims are not allocated here, so pods with such claims are refused."""

import msgspec

from robotapp_scheduler.core.changes import Change
from robotapp_scheduler.core.framework import Code, PreFilter, Status
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes


class DynamicResourcesArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """Upstream's limits of an allocation, known so that they are refused with the reason."""

    filter_timeout: str | None = None
    binding_timeout: str | None = None

    def __post_init__(self) -> None:
        for name, value in (("filterTimeout", self.filter_timeout), ("bindingTimeout", self.binding_timeout)):
            if value is not None:
                raise ValueError(f"{name}: not supported here: devices of resource claims are not allocated")


class DynamicResources:
    """Allocation of resource claims is left to kube-scheduler."""

    name = "DynamicResources"
    events = Change.NONE
    Args = DynamicResourcesArgs

    def __init__(self, args: DynamicResourcesArgs | None = None) -> None:
        pass

    def pre_filter(self, pod: PodInfo, nodes: Nodes) -> PreFilter | None:  # noqa: ARG002 - the contract's signature
        """Refuses pods with resourceClaims."""
        for claim in pod.pod.spec.resource_claims:
            reason = f"resource claim {claim.name!r} is not allocated; this scheduler does not allocate devices"
            return PreFilter(status=Status(Code.UNRESOLVABLE, reason))
        return None
