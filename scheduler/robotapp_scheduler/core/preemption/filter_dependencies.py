"""Which other pods a pod's filters depend on: where only amounts count they are compared, elsewhere the filters run again."""

from collections.abc import Collection

import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import OF_PODS
from robotapp_scheduler.core.framework.incremental import Beside
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.filter_results import HOLE, Codes, FilterColumn

_OF_PODS = int(OF_PODS)


class Influence:
    """The filters that apply to a pod, by what their results depend on.

    `room` is the filter that only compares amounts (it has the hook of that name). `others` are the filters whose results
    other pods may change: they have the hook `touched_by`, or they read facts of pods.
    """

    def __init__(self, pod: PodInfo, evaluation: Evaluation) -> None:
        self._pod = pod
        self._columns = [column for column in evaluation.filters if not column.skipped]
        self._reasons = evaluation.reasons
        self.live: list[RegisteredPlugin] = [column.plugin for column in self._columns]
        self.room: RegisteredPlugin | None = next((plugin for plugin in self.live if plugin.room is not None), None)
        self.others = [p for p in self.live if p is not self.room and (p.touched_by or p.interest & _OF_PODS)]

    def __repr__(self) -> str:
        return f"Influence(room={self.room}, others={self.others})"

    def touched(self, other: PlacedPod, *, without: Collection[str] = ()) -> bool:
        """May adding or removing this pod change the result of any filter but `room` and those in `without`?"""
        return any(
            plugin.touched_by is None or plugin.touched_by(self._pod, other)
            for plugin in self.others
            if plugin.name not in without
        )

    def can_come_at_once(self, others: list[PlacedPod]) -> bool:
        """Can all these pods be added at once, because each changes results on its own node only?"""
        return all(
            plugin.row_local or not any(plugin.touched_by is None or plugin.touched_by(self._pod, o) for o in others)
            for plugin in self.others
        )

    def beside(self, nodes: Snapshot) -> dict[str, Beside]:
        """By plugin name: tests that need only the pods that stay on a node."""
        found = {p.name: p.beside(self._pod, nodes) for p in self.others if p.beside is not None}
        return {name: test for name, test in found.items() if test is not None}

    def codes(self, nodes: Snapshot, evaluation: Evaluation, *, without: Collection[str] = ()) -> tuple[Codes, Codes]:
        """(first reason, reason of `room`) per row of `nodes`, which differs from the cluster in amounts only.

        The results of all other filters are taken from the evaluation; those in `without` are left out.
        """
        first = np.zeros(nodes.n, dtype=np.int32)
        room = np.zeros(nodes.n, dtype=np.int32)
        positions = evaluation.positions(nodes.rows)
        for column in self._columns:
            if column.plugin is self.room:
                room = self._reasons_of(column.plugin, nodes)
                np.copyto(first, room, where=first == 0)
            elif not column.clean and column.plugin.name not in without:
                np.copyto(first, column.codes[positions], where=first == 0)
        return first, room

    def first_reasons(self, nodes: Snapshot) -> Codes:
        """First reason per row of `nodes` as the cluster is now, from all filters."""
        first = np.where(nodes.valid, np.int32(0), np.int32(HOLE))
        for plugin in self.live:
            np.copyto(first, self._reasons_of(plugin, nodes), where=first == 0)
        return first

    def _reasons_of(self, plugin: RegisteredPlugin, nodes: Snapshot) -> Codes:
        column = FilterColumn(plugin, self._reasons)
        column.compute(self._pod, nodes)
        return np.zeros(nodes.n, dtype=np.int32) if column.skipped else column.codes
