"""Which volumes the pods of each node use. Only pods with claims or old inline disks are ever counted here."""

from collections.abc import Callable, Collection, Iterable, Mapping
from itertools import chain
from typing import NamedTuple, TypeVar

from robotapp_scheduler.core.api.storage_v1 import VolumeAttachment
from robotapp_scheduler.core.pods.pod_volumes import Disk, PodVolumes

K = TypeVar("K")
ClaimKey = tuple[str, str]
Identity = tuple[str, str]
"""(CSI driver, handle) of a volume."""


class NodeUse(NamedTuple):
    """CSI volumes of one node, by driver: handles mounted by pods, and how many are attached in all."""

    handles: Mapping[str, frozenset[str]]
    attached: Mapping[str, int]


NOTHING = NodeUse({}, {})


class VolumeUsers:
    """Claims, disks and attachments per node.

    `identity(claim key)` is a claim's CSI volume; `handle(volume name)` is the handle of a PersistentVolume.
    """

    def __init__(self, identity: Callable[[ClaimKey], Identity | None], handle: Callable[[str], str]) -> None:
        self._identity = identity
        self._handle = handle
        self._claims: dict[str, dict[ClaimKey, int]] = {}
        self._where: dict[ClaimKey, dict[str, int]] = {}
        self._mounted: dict[ClaimKey, int] = {}
        """Mounts by name of placed pods per claim (ephemeral volumes are made for one pod)."""
        self._moved: dict[ClaimKey, int] | None = None
        """In a dry run: how the mounts changed since it began."""
        self._disks: dict[str, dict[str, tuple[Disk, ...]]] = {}
        self._drives: dict[str, dict[str, tuple[Identity, ...]]] = {}
        """Inline disks that a CSI driver attaches, by node and pod."""
        self._attachments: dict[str, dict[str, VolumeAttachment]] = {}
        self._attached_at: dict[str, dict[str, None]] = {}
        """Volume name to the nodes it is attached to."""
        self._uses: dict[str, NodeUse] = {}

    def __repr__(self) -> str:
        return f"VolumeUsers({len(self._mounted)} claims in use, {len(self._disks)} nodes with inline disks)"

    def count(self, node: str, uid: str, namespace: str, volumes: PodVolumes, sign: int) -> None:
        """Count a pod in (+1) or out (-1)."""
        for use in volumes.claims:
            key = (namespace, use.name)
            _add(self._claims.setdefault(node, {}), key, sign)
            _add(self._where.setdefault(key, {}), node, sign)
            if not self._where[key]:
                del self._where[key]
            if not use.ephemeral:
                _add(self._mounted, key, sign)
                if self._moved is not None:
                    _add(self._moved, key, sign)
        if not self._claims.get(node, True):
            del self._claims[node]
        drives = tuple((drive.driver, drive.handle) for drive in volumes.drives if drive.handle)
        _keep(self._disks, node, uid, volumes.disks, sign)
        _keep(self._drives, node, uid, drives, sign)
        self._uses.pop(node, None)

    def begin_dry_run(self) -> None:
        """From now on pods are moved only for a dry run of preemption."""
        self._moved = {}

    def end_dry_run(self) -> None:
        """All moves are undone."""
        self._moved = None

    def in_use(self, claims: Collection[ClaimKey], *, nominated: bool) -> bool:
        """Is a claim of one pod in use, as kube-scheduler counts in a dry run?

        Each claim that was in use at its start stands for one mount, however many pods have it, and what was moved since
        is counted by mounts: of two pods that share a claim only one has to go. Where none was
        in use the mounts of pods that may come count only with `nominated`.
        """
        moved = self._moved or {}
        before = sum(self._mounted.get(claim, 0) > moved.get(claim, 0) for claim in claims)
        if not before and not nominated:
            return False
        return before + sum(moved.get(claim, 0) for claim in claims) > 0

    def nodes_of(self, claim: ClaimKey) -> tuple[str, ...]:
        """Nodes where placed pods mount a claim, by name."""
        return tuple(sorted(self._where.get(claim, ())))

    def disks(self) -> Iterable[tuple[str, Iterable[tuple[Disk, ...]]]]:
        """Nodes with inline disks, and the disks per pod."""
        return ((node, pods.values()) for node, pods in self._disks.items())

    def attach(self, attachment: VolumeAttachment) -> None:
        """An attachment appeared or changed."""
        node = attachment.spec.node_name
        self._attachments.setdefault(node, {})[attachment.metadata.name] = attachment
        self._attached_at.setdefault(attachment.spec.source.persistent_volume_name, {})[node] = None
        self._uses.pop(node, None)

    def detach(self, attachment: VolumeAttachment) -> None:
        """An attachment is gone."""
        node = attachment.spec.node_name
        self._attachments.get(node, {}).pop(attachment.metadata.name, None)
        nodes = self._attached_at.get(attachment.spec.source.persistent_volume_name, {})
        nodes.pop(node, None)
        if not nodes:
            self._attached_at.pop(attachment.spec.source.persistent_volume_name, None)
        self._uses.pop(node, None)

    def claim_changed(self, claim: ClaimKey) -> None:
        """The nodes that mount a claim are looked up anew."""
        for node in self._where.get(claim, ()):
            self._uses.pop(node, None)

    def volume_changed(self, name: str) -> None:
        """The nodes a volume is attached to are looked up anew."""
        for node in self._attached_at.get(name, ()):
            self._uses.pop(node, None)

    def all_changed(self) -> None:
        """Any claim may stand for another volume now."""
        self._uses.clear()

    def on(self, node: str) -> NodeUse:
        """CSI volumes in use on a node."""
        use = self._uses.get(node)
        if use is None:
            use = self._uses[node] = self._look(node)
        return use

    def _look(self, node: str) -> NodeUse:
        claims, attachments, drives = self._claims.get(node), self._attachments.get(node), self._drives.get(node)
        if not claims and not attachments and not drives:
            return NOTHING
        by_pods: dict[str, set[str]] = {}
        for driver, handle in chain.from_iterable((drives or {}).values()):
            by_pods.setdefault(driver, set()).add(handle)
        for key in claims or ():
            found = self._identity(key)
            if found is not None:
                by_pods.setdefault(found[0], set()).add(found[1])
        every = {driver: set(handles) for driver, handles in by_pods.items()}
        for attachment in (attachments or {}).values():
            handle = self._handle(attachment.spec.source.persistent_volume_name)
            if attachment.spec.attacher and handle:
                every.setdefault(attachment.spec.attacher, set()).add(handle)
        return NodeUse(
            {driver: frozenset(handles) for driver, handles in by_pods.items()},
            {driver: len(handles) for driver, handles in every.items()},
        )


def _keep(kept: dict[str, dict[str, tuple[K, ...]]], node: str, uid: str, own: tuple[K, ...], sign: int) -> None:
    """Note what a pod has on a node, or strike it out."""
    if own and sign > 0:
        kept.setdefault(node, {})[uid] = own
    elif own:
        on_node = kept.get(node, {})
        on_node.pop(uid, None)
        if not on_node:
            kept.pop(node, None)


def _add(counts: dict[K, int], key: K, sign: int) -> None:
    count = counts.get(key, 0) + sign
    if count:
        counts[key] = count
    else:
        counts.pop(key, None)
