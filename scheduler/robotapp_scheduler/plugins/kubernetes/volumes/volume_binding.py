"""VolumeBinding: nodes that reach the pod's volumes, or on which its unbound claims can be satisfied."""

from collections.abc import Hashable

import msgspec
import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import (
    BindContext,
    Code,
    FilterResult,
    PreFilter,
    ScoreResult,
    Status,
    Verdict,
)
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan
from robotapp_scheduler.plugins.kubernetes.common.arguments import NEW, is_new
from robotapp_scheduler.plugins.kubernetes.node_resources.scoring_strategies import ShapePoint, interpolated
from robotapp_scheduler.plugins.kubernetes.volumes.claims import (
    capacity_grew,
    names_claim,
    of_pod,
    sorted_claims,
    trouble,
    unresolvable,
)
from robotapp_scheduler.plugins.kubernetes.volumes.matching import PLUGIN, REASONS, Match, match
from robotapp_scheduler.plugins.kubernetes.volumes.node_reach import Reach
from robotapp_scheduler.plugins.kubernetes.volumes.score import score

UNBOUND = "pod has unbound immediate PersistentVolumeClaims"
USUAL_SHAPE = (ShapePoint(0, 10), ShapePoint(100, 0))
TEXTS = tuple(tuple(text for i, text in enumerate(REASONS) if bits >> i & 1) for bits in range(1 << len(REASONS)))


class VolumeBindingArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """bindTimeoutSeconds: how long a claim may take to be bound. shape: the score (0 to 10) of a volume by how much of it is used."""

    bind_timeout_seconds: int = 600
    shape: tuple[ShapePoint, ...] = ()
    """None: `USUAL_SHAPE`."""
    compat_version: str = NEW


class VolumeBinding:
    """Bound claims bind to their volume's nodes; others get the smallest volume that fits, or one made for them."""

    name = PLUGIN
    reads = ("volumes",)
    node_reads = ("labels", "name")
    row_local = True
    events = (
        Change.STORAGE_CLASS | Change.PVC | Change.PV | Change.NODE_ADDED | Change.LABELS | Change.CSI_NODE
        | Change.CSI_DRIVER | Change.CAPACITY
    )  # fmt: skip
    hint_reads = ("mounts",)
    resolvable = False
    Args = VolumeBindingArgs

    def __init__(self, args: VolumeBindingArgs | None = None) -> None:
        args = args or VolumeBindingArgs()
        if args.bind_timeout_seconds < 0:
            raise ValueError("bindTimeoutSeconds: invalid BindTimeoutSeconds, should not be a negative value")
        if args.bind_timeout_seconds >= 1 << 63:
            raise ValueError("bindTimeoutSeconds: more than the format can hold")
        self._timeout_s = float(args.bind_timeout_seconds)
        self._points = interpolated(args.shape or USUAL_SHAPE)
        self._scores = is_new(args.compat_version)
        self._reach = Reach()
        self._last: tuple[Hashable, Match | None] = (None, None)
        """The newest match over all nodes and what it was made of: filter, score and plan of a cycle share it."""

    def narrows(self, pod: PodInfo) -> bool:
        """Does the pod mount claims?"""
        return pod.volumes is not None and bool(pod.volumes.claims)

    def pre_filter(self, pod: PodInfo, nodes: Snapshot) -> PreFilter | None:
        """Refuses a pod with a claim that is missing, lost, on its way out, or to be bound before it is scheduled."""
        if not self.narrows(pod):
            return None
        store = nodes.cluster.volumes
        text = trouble(pod, store) or (UNBOUND if sorted_claims(pod, store).immediate else "")
        return unresolvable(text) if text else None

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where every claim's volume can be used or could be bound or made; Skip for a pod without claims."""
        if pod.volumes is None or not pod.volumes.claims:
            return None
        bits = self._match(pod, nodes).bits
        return Verdict(bits == 0, codes=bits, reasons=TEXTS)

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """How empty the chosen volumes stay; 0 everywhere for a pod without unbound claims."""
        if not self._scores or pod.volumes is None or not pod.volumes.claims:
            return None
        found = self._match(pod, nodes)
        if not found.given and not found.made:
            return np.zeros(nodes.n, dtype=np.int64)
        return score(found, nodes.cluster.volumes, self._points)

    def plan(self, pod: PodInfo, nodes: Snapshot) -> VolumePlan | None:
        """What placing the pod on the one node in view asks of its claims; None when all are bound."""
        if pod.volumes is None or not sorted_claims(pod, nodes.cluster.volumes).delayed:
            return None
        known = self._last[1] if self._last[0] == _state(pod, nodes) else None
        row = nodes.cluster.nodes.row_of[nodes.names[0]]
        found, at = (known, row) if known is not None else (self._match(pod, nodes), 0)
        bindings = [
            (given.claim.key, given.volumes[int(given.chosen[at])].metadata.name)
            for given in found.given
            if given.chosen[at] >= 0
        ]
        provisions = [made.claim.key for made in found.made if made.where[at]]
        return VolumePlan(nodes.names[0], tuple(bindings), tuple(dict.fromkeys(provisions)), self._timeout_s)

    def pre_flight(self, pod: PodInfo, ctx: BindContext) -> Code:  # noqa: ARG002 - the contract's signature
        """Volumes may take minutes to be made."""
        return Code.SKIP if ctx.volumes is None else Code.WAIT

    async def pre_bind(self, pod: PodInfo, node: str, ctx: BindContext) -> Status | None:  # noqa: ARG002 - as above
        """Write the plan that was made for the node, and wait until every claim is bound."""
        trouble = await ctx.handle.volumes.bind(pod, ctx.volumes) if ctx.volumes is not None else ""
        return Status(Code.ERROR, trouble) if trouble else None

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """New volumes and nodes may help every pod, a claim those that use it, more capacity those that lack some."""
        old, new = event.old, event.new
        if of_pod(event):
            return bool(event.change & Change.PV)  # a forgotten pod gave a volume back
        match event.change:
            case Change.PVC:
                return names_claim(pod, event, ephemeral=True)
            case Change.STORAGE_CLASS:
                return old is None or old.allowed_topologies != new.allowed_topologies
            case Change.CSI_NODE:
                return old is None or old.taken_over != new.taken_over
            case Change.CSI_DRIVER:
                return old is not None and old.spec.storage_capacity and (new is None or not new.spec.storage_capacity)
            case Change.CAPACITY:
                return old is None or capacity_grew(old, new)
        return True

    def _match(self, pod: PodInfo, nodes: Snapshot) -> Match:
        state = _state(pod, nodes) if nodes.full else None
        if state is not None and self._last[0] == state and self._last[1] is not None:
            return self._last[1]
        store = nodes.cluster.volumes
        found = match(nodes, sorted_claims(pod, store), store, self._reach)
        if state is not None:
            self._last = (state, found)
        return found


def _state(pod: PodInfo, nodes: Snapshot) -> Hashable:
    """Everything a match over all nodes depends on."""
    cluster = nodes.cluster
    return (id(cluster), pod.uid, cluster.volumes.key_of(pod), cluster.nodes.generation, cluster.nodes.size)
