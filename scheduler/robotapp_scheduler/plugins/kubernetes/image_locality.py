"""ImageLocality: prefer nodes that hold the pod's images already."""

from typing import Final

import numpy as np

from robotapp_scheduler.core.changes import Change
from robotapp_scheduler.core.columns import IntArray
from robotapp_scheduler.core.framework import MAX_SCORE, ScoreResult
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes

MIB: Final = 1024 * 1024
LEAST_BYTES: Final = 23 * MIB
MOST_BYTES: Final = 1000 * MIB
"""Per image."""


class ImageLocality:
    """Sizes count in proportion to the nodes that have the image, so that one node does not attract every pod."""

    name = "ImageLocality"
    reads = ("images",)
    node_reads = ("images",)
    events = Change.NONE

    def score(self, pod: PodInfo, nodes: Nodes) -> ScoreResult:
        """0…100 between 23 MiB and 1000 MiB per image."""
        images = nodes.cluster.topology.images
        if not images.any(pod.images):
            return 0
        table = nodes.cluster.nodes
        found = nodes.pick(images.bytes_of(pod.images, table.size, table.count))
        most = MOST_BYTES * len(pod.images)
        score: IntArray = MAX_SCORE * (np.clip(found, LEAST_BYTES, most) - LEAST_BYTES) // (most - LEAST_BYTES)
        return score
