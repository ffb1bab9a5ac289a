"""Filters with nominated pods: a node must admit a pod both with its nominated pods counted and without them."""

from collections.abc import Mapping, Sequence

import numpy as np

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.dry_run import DryRun
from robotapp_scheduler.core.cache.snapshot import AdjustedSnapshot, Snapshot
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.preemption.filter_dependencies import Influence
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.filter_results import Codes


def with_nominated(cluster: Cache, pod: PodInfo, evaluation: Evaluation, *, node: str = "") -> Evaluation:
    """The evaluation, with the filters run a second time for nodes on which pods of this priority or higher are nominated.

    Returns `evaluation` itself when there are none. `node`: the name of the node when the evaluation covers only one.
    """
    if not len(cluster.nominations):
        return evaluation
    nominated: dict[int, list[PlacedPod]] = {}
    for name, records in cluster.nominations.at_least(pod.priority, but=pod.uid, node=node).items():
        row = cluster.nodes.row_of.get(name)
        if row is not None and evaluation.has(row):
            nominated[row] = records
    if not nominated:
        return evaluation
    rows = sorted(nominated)
    positions = evaluation.positions(np.array(rows, dtype=np.intp))
    # The reason of the pass with the nominated pods is reported, as in kube-scheduler, where it comes first.
    first = _reasons(cluster, Influence(pod, evaluation), evaluation, rows, nominated)
    return evaluation.replaced(positions, np.where(first != 0, first, evaluation.reason[positions]))


def _reasons(
    cluster: Cache,
    influence: Influence,
    evaluation: Evaluation,
    rows: Sequence[int],
    nominated: Mapping[int, Sequence[PlacedPod]],
) -> Codes:
    records = [record for row in rows for record in nominated[row]]
    if not any(influence.touched(record) for record in records):
        view = AdjustedSnapshot(cluster, rows, amounts(cluster, [nominated[row] for row in rows]))
        return influence.codes(view, evaluation)[0]
    if influence.can_come_at_once(records):
        with DryRun(cluster) as dry_run:
            for record in records:
                dry_run.put(record)
            return influence.first_reasons(Snapshot(cluster, rows))
    found = np.zeros(len(rows), dtype=np.int32)
    with DryRun(cluster) as dry_run:
        for i, row in enumerate(rows):
            for record in nominated[row]:
                dry_run.put(record)
            found[i] = influence.first_reasons(Snapshot(cluster, [row]))[0]
            dry_run.back(0)
    return found


def amounts(cluster: Cache, per_row: Sequence[Sequence[PlacedPod]]) -> IntArray:
    """Sums of what pods hold, one column per list of pods: their number, then each resource (as PriorityColumns has it)."""
    total = np.zeros((len(cluster.nodes.resources.names) + 1, len(per_row)), dtype=np.int64)
    for i, records in enumerate(per_row):
        total[0, i] = len(records)
        for record in records:
            for code, amount in record.requested:
                total[code + 1, i] += amount
    return total
