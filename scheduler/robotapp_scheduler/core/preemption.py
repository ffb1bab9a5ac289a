"""The part of a refusal that speaks about preemption, in kube-scheduler's words.

Nothing is preempted yet: where lower-priority pods stand in the way the text says so.
"""

from typing import Final

import numpy as np

from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.evaluation import Evaluation
from robotapp_scheduler.core.framework import Code, Status, histogram
from robotapp_scheduler.core.pods import PodInfo

NOT_HELPFUL: Final = "Preemption is not helpful for scheduling"
NO_VICTIMS: Final = "No preemption victims found for incoming pod"
NOT_OFFERED: Final = "Preemption is not offered by this scheduler"
NEVER: Final = " preemption: not eligible due to preemptionPolicy=Never."
QUIRK: Final = " not found"
"""Upstream's tail after one of these rejected the pod as a whole: another plugin ends the chain before preemption."""
BEFORE_DYNAMIC_RESOURCES: Final = frozenset({"NodeAffinity", "VolumeRestrictions", "VolumeBinding", "VolumeZone"})


def tail(
    cluster: Cluster, pod: PodInfo, evaluation: Evaluation | None, *, outside: int = 0, status: Status | None = None
) -> str:
    """What follows the histogram, with its leading space; empty when nothing does.

    `outside` nodes were excluded by name before the filters; they never are candidates.
    """
    if status is not None:
        return QUIRK if status.code is Code.UNRESOLVABLE and status.plugin in BEFORE_DYNAMIC_RESOURCES else ""
    if evaluation is None:
        return ""
    if pod.pod.spec.preemption_policy == "Never":
        return NEVER
    helpless, resolvable = outside, 0
    for code, count in evaluation.counts().items():
        if evaluation.reasons.values[code].resolvable:
            resolvable += count
        else:
            helpless += count
    blocked = _with_lower_priority(cluster, pod, evaluation) if resolvable else 0
    texts = {NOT_HELPFUL: helpless, NO_VICTIMS: resolvable - blocked, NOT_OFFERED: blocked}
    return " preemption: " + histogram(helpless + resolvable, texts)


def _with_lower_priority(cluster: Cluster, pod: PodInfo, evaluation: Evaluation) -> int:
    """Resolvable rows on which a pod of lower priority runs."""
    if not cluster.any_below(pod.priority):
        return 0
    values = evaluation.reasons.values
    resolvable = np.array([value.resolvable for value in values])
    positions = np.flatnonzero((evaluation.reason > 0) & resolvable[np.maximum(evaluation.reason, 0)])
    rows = positions if evaluation.rows is None else evaluation.rows[positions]
    names = (cluster.nodes.names[int(row)] for row in rows)
    return sum(any(other.priority < pod.priority for other in cluster.pods_on(name)) for name in names)
