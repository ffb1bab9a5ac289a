"""NodeDeclaredFeatures: what a pod's spec needs of the kubelet must be among the features the node declares."""

import msgspec
import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import FilterResult
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.pod_signature import required_features_of
from robotapp_scheduler.plugins.kubernetes.common.arguments import NEW, is_new


class DeclaredFeaturesArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """compatVersion "1.35": as in that release of Kubernetes, features of nodes do not count."""

    compat_version: str = NEW


class NodeDeclaredFeatures:
    """Ordinary pods need none."""

    name = "NodeDeclaredFeatures"
    reads = ("needs",)
    node_reads = ("features",)
    row_local = True
    events = Change.NODE_ADDED | Change.FEATURES
    reason = "node(s) didn't match Pod's required features"
    resolvable = False
    Args = DeclaredFeaturesArgs

    def __init__(self, args: DeclaredFeaturesArgs | None = None) -> None:
        self._looks = is_new((args or DeclaredFeaturesArgs()).compat_version)

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where every needed feature is declared."""
        if not pod.needs or not self._looks:
            return None
        codes, sets = nodes.feature_sets
        return np.array([pod.needs <= declared for declared in sets], dtype=np.bool_)[codes]

    def hint(self, pod: PodInfo, event: Event) -> bool:  # noqa: ARG002 - the contract's signature
        """A node declares something else; or the pod's own needs are different."""
        return event.resource != "pods" or required_features_of(event.old.spec) != required_features_of(event.new.spec)
