"""ImageLocality: prefer nodes that hold the pod's images already."""

from typing import Final

import msgspec
import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.interface import MAX_SCORE, ScoreResult
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.kubernetes.common.arguments import NEW, is_new

MIB: Final = 1024 * 1024
LEAST_BYTES: Final = 23 * MIB
MOST_BYTES: Final = 1000 * MIB
"""Per image."""


class ImageLocalityArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """compatVersion "1.35": as in that release of Kubernetes, images of volumes do not count."""

    compat_version: str = NEW


class ImageLocality:
    """Sizes count in proportion to the nodes that have the image, so that one node does not attract every pod."""

    name = "ImageLocality"
    reads = ("images",)
    node_reads = ("images",)
    events = Change.NONE
    Args = ImageLocalityArgs

    def __init__(self, args: ImageLocalityArgs | None = None) -> None:
        self._counts_volumes = is_new((args or ImageLocalityArgs()).compat_version)

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """0…100 between 23 MiB and 1000 MiB per image."""
        images = nodes.cluster.topology.images
        wanted = pod.images if self._counts_volumes else pod.images[: -pod.image_volumes or None]
        if not images.any(wanted):
            return 0
        table = nodes.cluster.nodes
        found = nodes.pick(images.bytes_of(wanted, table.size, table.count))
        most = MOST_BYTES * len(wanted)
        score: IntArray = MAX_SCORE * (np.clip(found, LEAST_BYTES, most) - LEAST_BYTES) // (most - LEAST_BYTES)
        return score
