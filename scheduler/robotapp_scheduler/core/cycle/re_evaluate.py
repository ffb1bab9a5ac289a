"""Evaluates a known pod again: its record and the table over all nodes as they would be now, for `/explain`; `as_waiting` also
for better nodes and what-if.

Nothing of it is kept: neither the ring, nor the caches, nor the counters notice. A bound pod is taken off its node while
it is looked at, so that it does not stand in its own way.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.dry_run import DryRun
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.explain.record import Record
from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner


class TableReason(msgspec.Struct, frozen=True, rename="camel"):
    """One reason nodes were refused for; index 0 of the list stands for "not refused"."""

    plugin: str
    reason: str
    unit: str = ""


class TableScore(msgspec.Struct, frozen=True, rename="camel"):
    """What one plugin gave, per node of the table; None where the node was refused."""

    plugin: str
    weight: int
    shadow: bool
    raw: list[float | None]
    normalized: list[int | None]


class Table(msgspec.Struct, frozen=True, rename="camel"):
    """All lists but `reasons` and `scores` have one element per node, in the order of `nodes`."""

    nodes: list[str]
    reasons: list[TableReason]
    refused: list[int]
    """Index into `reasons`: the first plugin that refused; 0 = feasible."""
    numbers: list[float | None]
    """What that plugin measured there, in the unit of the reason."""
    totals: list[int | None]
    scores: list[TableScore]


def re_evaluate(core: SchedulerCore, pod: Pod) -> tuple[Record, Table | None]:
    """Evaluate a pod again without placing it: the record of the result, and the table of all nodes (None: no filter ran).

    Raises KeyError when no profile has the pod's schedulerName.
    """
    with as_waiting(core.cluster, pod) as waiting:
        info = core.cluster.pod_info(waiting)
        runner = ProfileRunner(core.runner(info.scheduler_name).profile, core.cluster, caching=False)
        record, evaluation = core.consider(info, runner)
        return record, None if evaluation is None else _table(info, runner, evaluation)


@contextmanager
def as_waiting(cluster: Cache, pod: Pod, *, anew: bool = False) -> Iterator[Pod]:
    """The pod as one without a node, and the cluster without it; afterwards all is as before. anew: as if it was made now."""
    if not pod.spec.node_name:  # it waits, or is on its way: an assumption lasts milliseconds, and is left alone
        yield pod
        return
    made = cluster.now().isoformat() if anew else pod.metadata.creation_timestamp
    waiting = msgspec.structs.replace(
        pod,
        metadata=msgspec.structs.replace(pod.metadata, creation_timestamp=made),
        spec=msgspec.structs.replace(pod.spec, node_name=""),
    )
    # Not removed and applied again: its group would be one that was never placed, and it the last among equals on its node.
    record = cluster.placed[pod.metadata.uid]
    with DryRun(cluster, preemption=False) as dry_run:
        dry_run.take(record)
        cluster.apps.place(waiting, "")
        try:
            yield waiting
        finally:
            cluster.apps.place(pod, record.node)


def _table(pod: PodInfo, runner: ProfileRunner, evaluation: Evaluation) -> Table:
    if evaluation.feasible:
        try:
            runner.score(pod, evaluation)
        except PluginError:
            evaluation.scores = []
    rows = [int(row) for row in np.flatnonzero(evaluation.reason >= 0)]
    feasible = np.array([row for row in rows if evaluation.reason[row] == 0], dtype=np.intp)
    codes = sorted({int(code) for code in evaluation.reason if code > 0})
    units = {column.plugin.name: column.detail_unit for column in evaluation.filters}
    reasons = [TableReason("", "")]
    for code in codes:
        reason = evaluation.reasons.values[code]
        reasons.append(TableReason(reason.plugin, ", ".join(reason.texts), units.get(reason.plugin, "")))
    index = {0: 0} | {code: at for at, code in enumerate(codes, start=1)}
    totals = evaluation.totals
    scored = bool(evaluation.scores) and len(totals) == len(evaluation.reason) and len(feasible) > 0
    return Table(
        nodes=[runner.name_of(evaluation, row) for row in rows],
        reasons=reasons,
        refused=[index[int(evaluation.reason[row])] for row in rows],
        numbers=[_number(evaluation, row) for row in rows],
        totals=[int(total) if scored and (total := totals[row]) >= 0 else None for row in rows],
        scores=_scores(evaluation, rows, feasible) if scored else [],
    )


def _number(evaluation: Evaluation, row: int) -> float | None:
    code = int(evaluation.reason[row])
    if code <= 0:
        return None
    plugin = evaluation.reasons.values[code].plugin
    column = next((each for each in evaluation.filters if each.plugin.name == plugin), None)
    return None if column is None else column.number(row, code)


def _scores(
    evaluation: Evaluation, rows: list[int], feasible: "np.ndarray[Any, np.dtype[np.intp]]"
) -> list[TableScore]:
    found = []
    for column in evaluation.scores:
        if column.skipped:
            continue
        normalized = dict(zip(feasible.tolist(), evaluation.score_of(column, feasible), strict=True))
        found.append(
            TableScore(
                plugin=column.plugin.name,
                weight=column.plugin.weight,
                shadow=column.plugin.shadow,
                raw=[column.raw_at(row) if row in normalized else None for row in rows],
                normalized=[normalized.get(row) for row in rows],
            )
        )
    return found
