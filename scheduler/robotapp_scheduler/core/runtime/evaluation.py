"""All filters and scores of a profile for one pod class: first reason per row, weighted total per row."""

from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import NODE
from robotapp_scheduler.core.explain.record import EXAMPLES, NO_NODES, NodePluginScores, Refusal, TopNodes
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.filter_results import HOLE, Codes, FilterColumn, NodeToStatus, Reasons
from robotapp_scheduler.core.runtime.incremental import FEW_ROWS, bring_up, view_of
from robotapp_scheduler.core.runtime.ranking import Hashes
from robotapp_scheduler.core.runtime.score_results import ScoreColumn
from robotapp_scheduler.core.runtime.total_scores import TotalScores

_NODE: Final = int(NODE)


class Tally:
    """How many pods used an evaluation since its counts were last added to the metrics."""

    __slots__ = ("filtered", "scored")

    def __init__(self) -> None:
        self.filtered: dict[tuple[int, ...], int] = {}
        """Pods by the reason codes that occurred."""
        self.scored = 0


class Evaluation:
    """The combined columns of one pod class over all rows, or of one pod over a few."""

    def __init__(self, filters: list[FilterColumn], scores: list[ScoreColumn], reasons: Reasons) -> None:
        self.filters = filters
        self.scores = scores
        self.reasons = reasons
        self.reason: Codes = np.zeros(0, dtype=np.int32)
        """First failing reason per row; 0 = feasible, HOLE = no node."""
        self.tally = Tally()
        self.feasible = 0
        self.revision = 0
        """Grows whenever `reason` changes, so that what is derived from it can be kept."""
        self.refusals: tuple[int, tuple[Refusal, ...]] | None = None
        """The refusals in the form of `/explain`, and the `revision` they were made from."""
        self._front = NO_NODES
        """The best rows in the form of `/explain`, as of the last call of `front`."""
        self._examples: dict[int, tuple[int, ...]] = {}
        """The first positions by reason code, filled by `examples`."""
        self.rows: npt.NDArray[np.intp] | None = None
        """The table rows in view, None = all."""
        self._live_filters = [column for column in filters if not column.skipped]
        self._position = -1
        self._epochs = -1
        self._combines = 0
        self._counts: dict[int, int] = {}
        self._interest = int(NODE)
        for column in filters:
            self._interest |= column.plugin.interest
        self._verdicts = NodeToStatus(self.reason, self.feasible, self.revision, self._combines)
        self._totals = TotalScores(scores, self._interest)

    def __repr__(self) -> str:
        return f"Evaluation({self.feasible} of {len(self.reason)} rows feasible)"

    # --- Filters -------------------------------------------------------------------------------------------------

    def refresh_filters(self, pod: PodInfo, full: Snapshot) -> None:
        """Bring `reason` up to date."""
        head = full.cluster.log.position
        if head == self._position:
            return
        epochs, delta = bring_up(self._live_filters, pod, full, self._position)
        if self._position < 0:
            # A plugin skips because of the pod alone, so it skips all pods of this class.
            self._live_filters = [column for column in self.filters if not column.skipped]
            epochs = sum(column.epoch for column in self._live_filters)
        rows: Snapshot | None = None
        same_nodes = False
        if epochs == self._epochs and len(self.reason) == full.n and delta is not None:
            rows = view_of(delta, self._interest, full.cluster)
            same_nodes = not delta.kinds & _NODE
            if not same_nodes:
                self.refusals = None  # a row may stand for another node now
        if rows is None:
            self._combine_all(full)
        elif rows.n:
            self._combine_rows(rows, same_nodes=same_nodes)
        self._position, self._epochs = head, epochs

    def compute_filters(self, pod: PodInfo, nodes: Snapshot) -> None:
        """Fill `reason` for exactly these rows, nothing kept."""
        for column in self.filters:
            column.compute(pod, nodes)
        self._combine_all(nodes)

    def _combine_all(self, nodes: Snapshot) -> None:
        self.rows = None if isinstance(nodes.rows, slice) else nodes.rows
        rejecting = [column.codes for column in self.filters if not column.clean]
        reason: Codes = rejecting[0].copy() if rejecting else np.zeros(nodes.n, dtype=np.int32)
        for codes in rejecting[1:]:
            np.copyto(reason, codes, where=reason == 0)
        if not nodes.no_holes:
            reason[~nodes.valid] = HOLE
        self.reason = reason
        self._examples.clear()
        if rejecting or not nodes.no_holes:
            self._count_reasons()
        else:
            self._counts, self.feasible = {}, nodes.n
        self._combines += 1
        self._changed()

    def _combine_rows(self, rows: Snapshot, *, same_nodes: bool) -> None:
        rejecting = [column.codes for column in self._live_filters if not column.clean]
        if not rejecting and same_nodes and self.feasible == len(self.reason):
            return
        valid = rows.cluster.nodes.valid
        if rows.n <= FEW_ROWS:
            before = [*map(self.reason.item, rows.row_list)]
            after = [_first(rejecting, row) if valid.item(row) else HOLE for row in rows.row_list]
        else:
            codes = np.where(rows.valid, np.int32(0), np.int32(HOLE))
            for each in rejecting:
                np.copyto(codes, each[rows.rows], where=codes == 0)
            before, after = self.reason[rows.rows].tolist(), codes.tolist()
        if before == after:
            return
        for row, old, new in zip(rows.row_list, before, after, strict=True):
            if old != new:
                self.reason[row] = new
                self._drop_examples(row, old, new)
                self._counts[old] = self._counts.get(old, 0) - 1
                self._counts[new] = self._counts.get(new, 0) + 1
                self.feasible += (new == 0) - (old == 0)
        self._changed()

    def _changed(self) -> None:
        self.revision += 1
        self._verdicts = NodeToStatus(self.reason, self.feasible, self.revision, self._combines)

    def _count_reasons(self) -> None:
        found = np.bincount(self.reason - HOLE, minlength=1 - HOLE).tolist()
        self._counts = {code: count for code, count in enumerate(found, start=HOLE) if count and code > 0}
        self.feasible = found[-HOLE]

    def _drop_examples(self, position: int, old: int, new: int) -> None:
        """Forget the examples of a code when this position leaves or joins them."""
        for code in (old, new):
            known = self._examples.get(code)
            if known is not None and (len(known) < EXAMPLES or position <= known[-1]):
                del self._examples[code]

    # --- Scores --------------------------------------------------------------------------------------------------

    def refresh_scores(self, pod: PodInfo, full: Snapshot) -> None:
        """Bring the totals up to date. Raises PluginError when a plugin's score cannot be used."""
        self._totals.refresh(pod, full, self._verdicts)

    def compute_scores(self, pod: PodInfo, nodes: Snapshot) -> None:
        """Compute the totals of exactly these rows, nothing kept."""
        self._totals.compute(pod, nodes, self._verdicts)

    # The rest of this section needs totals: `refresh_scores` or `compute_scores` comes first.

    @property
    def totals(self) -> IntArray:
        """Weighted total per row, INFEASIBLE where `reason` is not 0."""
        return self._totals.total

    def score_of(self, column: ScoreColumn, positions: npt.NDArray[np.intp]) -> list[int]:
        """Normalised scores of one plugin at feasible positions."""
        return self._totals.score_of(column, positions)

    def choose(self, cluster: Cache, draw: int) -> int:
        """One of the feasible positions with the highest total, by the node names' hashes and a number drawn for the pod;
        one position at least must be feasible.
        """
        return self._totals.top(self._hashes(cluster)).choose(draw)

    def scores_at(self, cluster: Cache, position: int) -> NodePluginScores:
        """Node, total and scores of one feasible position."""
        totals = self._totals
        return NodePluginScores(
            position, self._name(cluster, position), totals.total.item(position), totals.scores_at(position)
        )

    def front(self, cluster: Cache, count: int) -> TopNodes:
        """The best `count` positions, better ones first; the same object while nothing about them changes.

        At least `count` positions must be feasible.
        """
        totals, known = self._totals, self._front
        positions, scorers = totals.top(self._hashes(cluster)).first(count), totals.scorers
        if known.positions is not positions or known.scorers is not scorers:
            names = tuple([self._name(cluster, position) for position in positions])
            total = tuple(map(totals.total.item, positions))
            known = self._front = TopNodes(positions, names, total, totals.scores_of(positions), scorers)
        return known

    def _name(self, cluster: Cache, position: int) -> str:
        return cluster.nodes.names[position if self.rows is None else self.rows.item(position)]

    def _hashes(self, cluster: Cache) -> Hashes:
        return cluster.nodes.name_hash if self.rows is None else cluster.nodes.name_hash[self.rows]

    # --- Copies ----------------------------------------------------------------------------------------------------

    def without(self, rows: list[int]) -> "Evaluation":
        """A copy for one attempt in which these table rows cannot be chosen."""
        positions = rows if self.rows is None else [i for i, row in enumerate(self.rows) if int(row) in rows]
        lost = [position for position in positions if self.reason[position] == 0]
        return self.replaced(np.array(lost, dtype=np.intp), np.full(len(lost), HOLE, dtype=np.int32))

    def replaced(self, positions: npt.NDArray[np.intp], reasons: Codes) -> "Evaluation":
        """A copy for one attempt with other reasons at these positions."""
        copy = Evaluation(self.filters, self.scores, self.reasons)
        copy.reason, copy.rows = self.reason.copy(), self.rows
        copy.tally = self.tally  # scores are counted where the filters were
        copy.reason[positions] = reasons
        copy._count_reasons()
        copy._changed()
        return copy

    def has(self, row: int) -> bool:
        """Whether the evaluation covers this row of the node table."""
        return self.rows is None or bool((self.rows == row).any())

    def positions(self, rows: npt.NDArray[np.intp] | slice) -> npt.NDArray[np.intp]:
        """The positions in `reason` of rows of the node table, all of which must be in view."""
        wanted = np.arange(rows.start, rows.stop) if isinstance(rows, slice) else rows
        if self.rows is None:
            return wanted
        return np.searchsorted(self.rows, wanted)  # rows in view are sorted

    # --- Results -------------------------------------------------------------------------------------------------

    def counts(self) -> dict[int, int]:
        """Rejected rows per reason code."""
        return {code: count for code, count in sorted(self._counts.items()) if count and code > 0}

    def examples(self, code: int) -> tuple[int, ...]:
        """The first positions with this reason."""
        found = self._examples.get(code)
        if found is None:
            found = self._examples[code] = tuple((self.reason == code).nonzero()[0][:EXAMPLES].tolist())
        return found

    def texts(self) -> dict[str, int]:
        """Rejected nodes per reason text; a node with several texts counts in each."""
        result: dict[str, int] = {}
        for code, count in self.counts().items():
            for text in self.reasons.values[code].texts:
                result[text] = result.get(text, 0) + count
        return result


def _first(rejecting: list[Codes], row: int) -> int:
    for codes in rejecting:
        if code := codes.item(row):
            return code
    return 0
