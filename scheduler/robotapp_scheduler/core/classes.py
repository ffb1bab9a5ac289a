"""Cached results per pod class, repaired from the change log.

A *class* is everything any enabled plugin reads of a pod. Per plugin and value of its `reads` one column is kept (first
reason, or raw score, per row); per class their combination (first failing plugin per row, weighted total). Both remember
the position in the change log up to which they are true, so a pod of a known class costs the few rows that changed.
"""

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.columns import BoolArray, FloatArray, IntArray
from robotapp_scheduler.core.framework import (
    MAX_SCORE,
    Loaded,
    PluginError,
    Scores,
    Verdict,
    checked_mask,
    checked_scores,
    normalized,
)
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes, Row

MOST_REPAIRED: Final = 48
"""With more log entries than this a column is computed anew: the vector form costs as much as ~50 single rows."""
FEW_ROWS: Final = 8
"""Up to here plain integers beat arrays."""
COLUMNS_PER_PLUGIN: Final = 32
HOLE: Final = -1
"""Reason code of rows that are no node."""
BAD_SCORE: Final = "score is NaN, infinite or outside 0 to 100 for a feasible node"
_BAD: Final = np.iinfo(np.int64).min

Codes = npt.NDArray[np.int32]


class Reason(NamedTuple):
    """Why a plugin refuses a row; `resolvable` False = UnschedulableAndUnresolvable."""

    plugin: str
    texts: tuple[str, ...]
    resolvable: bool


class Reasons:
    """Reasons as small codes; 0 means "passes"."""

    def __init__(self) -> None:
        self.values: list[Reason] = [Reason("", (), resolvable=True)]
        self._codes: dict[Reason, int] = {}

    def __repr__(self) -> str:
        return f"Reasons({len(self.values) - 1})"

    def code(self, reason: Reason) -> int:
        """The code of a reason."""
        code = self._codes.get(reason)
        if code is None:
            code = self._codes[reason] = len(self.values)
            self.values.append(reason)
        return code


class FilterColumn:
    """One filter plugin's verdict per row: reason code, 0 where it passes. `skipped` = the plugin has no opinion."""

    def __init__(self, plugin: Loaded, reasons: Reasons) -> None:
        self.plugin = plugin
        self.skipped = False
        self.codes: Codes = np.zeros(0, dtype=np.int32)
        self.clean = False
        """No row is rejected."""
        self.detail: FloatArray | None = None
        self.detail_unit = ""
        self.position = -1
        self.epoch = 0
        """Grows when the column was computed anew, so that combinations of it are too."""
        self._reasons = reasons

    def refresh(self, pod: PodInfo, cluster: Cluster, full: Nodes) -> None:
        """Bring the column up to the head of the log."""
        if self.skipped or (self.position == cluster.log.position and self._fits(full)):
            return  # a plugin has no opinion because of the pod alone: that never changes
        rows = stale_rows(self.plugin, self.position, cluster, fits=self._fits(full))
        if rows is None:
            clean = self.clean
            self._store(full, pod)
            # A column that lets everything pass, before and after, changes no combination.
            self.epoch += not (clean and self.clean and self._fits(full)) or self.position < 0
        elif rows and not self.skipped:
            self._patch(rows, pod, cluster)
        self.position = cluster.log.position

    def compute(self, pod: PodInfo, nodes: Nodes) -> None:
        """Fill the column for exactly these rows, without regard to the log."""
        self._store(nodes, pod)

    def _fits(self, full: Nodes) -> bool:
        return self.skipped or len(self.codes) == full.n

    def _store(self, nodes: Nodes, pod: PodInfo) -> None:
        found = self._ask(pod, nodes)
        self.skipped = found is None
        self.clean = found is None
        if found is not None:
            self.codes, self.detail = found
            self.clean = not self.codes.any()

    def _patch(self, rows: list[int], pod: PodInfo, cluster: Cluster) -> None:
        passes = self.plugin.filter_row
        if passes is not None and len(rows) <= FEW_ROWS and all(passes(pod, Row(cluster.nodes, row)) for row in rows):
            if not self.clean:
                self.codes[rows] = 0
            return
        found = self._ask(pod, Nodes(cluster, rows))
        codes, detail = found if found is not None else (np.zeros(len(rows), dtype=np.int32), None)
        self.codes[rows] = codes
        self.clean = self.clean and not codes.any()
        if detail is not None:
            if self.detail is None:
                self.detail = np.full(len(self.codes), np.nan)
            self.detail[rows] = detail

    def _ask(self, pod: PodInfo, nodes: Nodes) -> tuple[Codes, FloatArray | None] | None:
        plugin = self.plugin
        if plugin.filter is None:
            return None
        with np.errstate(all="ignore"):
            answer = plugin.filter(pod, nodes)
        if answer is None:
            return None
        verdict = answer if isinstance(answer, Verdict) else Verdict(answer)
        mask = checked_mask(plugin.name, verdict.mask, nodes.n)
        if verdict.detail_unit:
            self.detail_unit = verdict.detail_unit
        if mask.all():
            return np.zeros(nodes.n, dtype=np.int32), None
        detail = None if verdict.detail is None else np.array(verdict.detail, dtype=np.float64)
        return self._coded(verdict, mask), detail

    def _coded(self, verdict: Verdict, mask: BoolArray) -> Codes:
        plugin = self.plugin
        texts: Sequence[tuple[str, ...]] = verdict.reasons or ((plugin.reason,),)
        resolvable = plugin.resolvable if verdict.resolvable is None else verdict.resolvable
        tables = [
            np.array([self._reasons.code(Reason(plugin.name, text, kind)) for text in texts], dtype=np.int32)
            for kind in (False, True)
        ]
        which = np.zeros(len(mask), dtype=np.intp) if verdict.codes is None else verdict.codes
        codes = np.where(resolvable, tables[1][which], tables[0][which]).astype(np.int32)
        codes[mask] = 0
        return codes


class ScoreColumn:
    """One score plugin's raw value per row.

    Scores that need no normalising are kept as integers; unusable ones (NaN, outside 0…100) carry a marker that only
    matters where the row is feasible.
    """

    def __init__(self, plugin: Loaded) -> None:
        self.plugin = plugin
        self.skipped = False
        self.raw: npt.NDArray[Any] = np.zeros(0, dtype=np.int64)
        self.constant: int | None = None
        """The normalised score, when it is the same for every row whatever the feasible set is."""
        self.normalize = plugin.normalize
        self._equal_raw: Any = 0
        self.bad = False
        self.position = -1
        self.epoch = 0

    @property
    def local(self) -> bool:
        """Does a row's normalised score depend on that row alone?"""
        return self.constant is not None or self.normalize == "none"

    def refresh(self, pod: PodInfo, cluster: Cluster, full: Nodes) -> None:
        """Bring the column up to the head of the log."""
        fits = len(self.raw) == full.n
        if self.skipped or (self.position == cluster.log.position and fits):
            return
        rows = stale_rows(self.plugin, self.position, cluster, fits=fits)
        if rows is None:
            before = (self.skipped, self.constant, self.position < 0, fits)
            self.compute(pod, full)
            # Equal for every row, before and after: nothing that was added up changes.
            same = before == (self.skipped, self.constant, False, True) and (self.skipped or self.constant is not None)
            self.epoch += not same
        elif rows and not self.skipped:
            self._patch(rows, pod, cluster)
        self.position = cluster.log.position

    def compute(self, pod: PodInfo, nodes: Nodes) -> None:
        """Fill the column for exactly these rows."""
        raw = self._ask(pod, nodes)
        self.skipped = raw is None
        if raw is not None:
            self.raw = raw
            self.constant = self._constant(raw[nodes.valid])

    def normalized(self, feasible: npt.NDArray[np.intp]) -> IntArray | int:
        """0…100 for the feasible rows; one number when all are equal."""
        if self.constant is not None:
            return self.constant
        raw = self.raw[feasible]
        if self.normalize == "none":
            if self.bad and len(raw) and raw.min() == _BAD:
                raise PluginError(self.plugin.name, BAD_SCORE)
            return raw
        if raw.dtype.kind == "f" and not np.isfinite(raw).all():
            raise PluginError(self.plugin.name, BAD_SCORE)
        return normalized(self.plugin.name, self.normalize, raw)

    def at(self, row: int) -> int:
        """The normalised score of one feasible row of a `local` column."""
        if self.constant is not None:
            return self.constant
        score = int(self.raw[row])
        if score == _BAD:
            raise PluginError(self.plugin.name, BAD_SCORE)
        return score

    def _patch(self, rows: list[int], pod: PodInfo, cluster: Cluster) -> None:
        score_row = self.plugin.score_row
        if score_row is not None and len(rows) <= FEW_ROWS:
            self._patch_rows(rows, [score_row(pod, Row(cluster.nodes, row)) for row in rows])
            return
        nodes = Nodes(cluster, rows)
        raw = self._ask(pod, nodes)
        if raw is None:
            raw = np.zeros(len(rows), dtype=np.int64)
        if self.raw.dtype.kind in "iu" and raw.dtype.kind == "f":
            self.raw = self.raw.astype(np.float64)
        self.raw[rows] = raw
        if self.constant is not None and (raw[nodes.valid] != self._equal_raw).any():
            self.constant = None
            self.epoch += 1

    def _patch_rows(self, rows: list[int], scores: list[int]) -> None:
        for row, score in zip(rows, scores, strict=True):
            self.raw[row] = score
            if self.constant is not None and score != self._equal_raw:
                self.constant = None
                self.epoch += 1

    def _ask(self, pod: PodInfo, nodes: Nodes) -> npt.NDArray[Any] | None:
        plugin = self.plugin
        if plugin.score is None:
            return None
        with np.errstate(all="ignore"):
            answer = plugin.score(pod, nodes)
        if answer is None:
            return None
        scores, self.normalize = answer if isinstance(answer, Scores) else (answer, plugin.normalize)
        raw = checked_scores(plugin.name, scores, nodes.n)
        return self._integral(raw) if self.normalize == "none" else raw

    def _integral(self, raw: npt.NDArray[Any]) -> IntArray:
        if raw.dtype.kind == "f":
            scores = np.where(np.isfinite(raw), raw, -1.0)
            # -0.5 must not become a valid 0.
            scores = np.where(scores < 0.0, -1.0, scores).astype(np.int64)
        else:
            scores = raw.astype(np.int64)
        if len(scores) and (scores.min() < 0 or scores.max() > MAX_SCORE):
            self.bad = True
            scores[(scores < 0) | (scores > MAX_SCORE)] = _BAD
        return scores

    def _constant(self, raw: npt.NDArray[Any]) -> int | None:
        if len(raw) == 0 or raw.min() != raw.max() or (self.bad and raw.min() == _BAD):
            return None
        if raw.dtype.kind == "f" and not np.isfinite(raw[0]):
            return None
        self._equal_raw = raw[0]
        return int(normalized(self.plugin.name, self.normalize, raw[:1])[0])


def stale_rows(plugin: Loaded, position: int, cluster: Cluster, *, fits: bool) -> list[int] | None:
    """Rows of a cached column to compute again; None = all of them."""
    if position < 0 or not fits:
        return None
    rows = cluster.log.since(position, plugin.interest, most=MOST_REPAIRED)
    if rows and not plugin.row_local:
        return None
    return rows


class ColumnCache:
    """Columns of all plugins of one profile, least recently used ones dropped per plugin."""

    def __init__(self, reasons: Reasons) -> None:
        self._reasons = reasons
        self._filters: dict[str, OrderedDict[Hashable, FilterColumn]] = {}
        self._scores: dict[str, OrderedDict[Hashable, ScoreColumn]] = {}

    def filter(self, plugin: Loaded, pod: PodInfo) -> FilterColumn:
        """The column of a filter plugin for pods like this one."""
        columns = self._filters.setdefault(plugin.name, OrderedDict())
        key = pod.live_features(plugin.reads) if plugin.reads_live else pod.features(plugin.reads)
        column = columns.get(key)
        if column is None:
            column = columns[key] = FilterColumn(plugin, self._reasons)
            if len(columns) > COLUMNS_PER_PLUGIN:
                columns.popitem(last=False)
        else:
            columns.move_to_end(key)
        return column

    def score(self, plugin: Loaded, pod: PodInfo) -> ScoreColumn:
        """The column of a score plugin for pods like this one."""
        columns = self._scores.setdefault(plugin.name, OrderedDict())
        key = pod.live_features(plugin.reads) if plugin.reads_live else pod.features(plugin.reads)
        column = columns.get(key)
        if column is None:
            column = columns[key] = ScoreColumn(plugin)
            if len(columns) > COLUMNS_PER_PLUGIN:
                columns.popitem(last=False)
        else:
            columns.move_to_end(key)
        return column
