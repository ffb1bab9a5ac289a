"""A score plugin's raw value per row, kept per value of what it reads and repaired from the change log."""

import logging
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.change_log import ChangeLogDelta
from robotapp_scheduler.core.framework.incremental import ScoreRow
from robotapp_scheduler.core.framework.interface import MAX_SCORE, PerDomain, PluginError, ScoreResult, Scores
from robotapp_scheduler.core.framework.plugin_results import checked_scores, normalized
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.nodes.columns import BoolArray, IntArray, Vocabulary
from robotapp_scheduler.core.nodes.resource_arrays import MOST_CODES, NO_CODE
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.incremental import FEW_ROWS, MOST_ROW_CALLS, Column, stale_rows

log = logging.getLogger(__name__)

Feasible = npt.NDArray[np.intp] | slice
"""Positions of the feasible rows; a slice when all are."""
BAD_SCORE: Final = "score is NaN, infinite or outside 0 to 100 for a feasible node"
_BAD: Final = np.iinfo(np.int64).min
_UNKNOWN: Final = -1


class ScoreColumn(Column):
    """One score plugin's raw value per row.

    Scores that need no normalising are kept as integers; unusable ones (NaN, outside 0…100) carry a marker that only
    matters where the row is feasible.
    """

    def __init__(self, plugin: RegisteredPlugin) -> None:
        super().__init__(plugin)
        self._raw: npt.NDArray[Any] = np.zeros(0, dtype=np.int64)
        self._domains: PerDomain | None = None
        """The values when they follow from a label; `raw` spreads them over the rows when it is read."""
        self._present: tuple[Feasible, tuple[Vocabulary, int, int], BoolArray] | None = None
        """A feasible set, the label by its vocabulary and version with the number of rows, and which of its codes occur in the set."""
        self.constant: int | None = None
        """The normalised score, when it is the same for every row whatever the feasible set is."""
        self.normalize = plugin.normalize
        self._equal_raw: Any = 0
        self.bad = False
        self._by_code: IntArray | None = None
        """Scores by the code of a node's amounts, _UNKNOWN where there is none yet."""
        self._generation = -1
        """The generation of these codes."""
        self.changes = 0
        """Grows when any raw value may be different."""

    def fail(self) -> None:
        """Leave out a shadow plugin whose scores cannot be used: it must not hold a pod back."""
        self.skipped = True
        log.warning("shadow plugin %s: %s; left out for pods of this kind", self.plugin.name, BAD_SCORE)

    @property
    def raw(self) -> npt.NDArray[Any]:
        """The plugin's score of each row, before normalising."""
        if self._domains is not None and len(self._raw) != len(self._domains.label.codes):
            self._raw = self._domains.values[self._domains.label.codes]
        return self._raw

    @property
    def local(self) -> bool:
        """Whether a row's normalised score depends on that row alone."""
        return self.constant is not None or self.normalize == "none"

    def refresh(self, pod: PodInfo, full: Snapshot, delta: ChangeLogDelta | None) -> None:
        """Bring the column up to the head of the log, with as few rows computed as possible."""
        if self.skipped:
            return
        fits = full.n == (len(self._raw) if self._domains is None else len(self._domains.label.codes))
        stale = stale_rows(self, pod, full, delta) if fits else None
        if stale is None:
            before = (self.skipped, self.constant, self.normalize, self.position < 0, fits)
            self.compute(pod, full)
            # One score for every row before and after, or normalised for each feasible set anyway: no sum changes.
            same = before == (self.skipped, self.constant, self.normalize, False, True) and (
                self.constant is not None or not self.local
            )
            self.epoch += not (same or self.skipped)
        elif stale.n:
            self._patch(stale, pod)
        self.position = full.cluster.log.position

    def compute(self, pod: PodInfo, nodes: Snapshot) -> None:
        """Fill the column for exactly these rows."""
        raw = self._score(pod, nodes)
        self.changes += 1
        self.skipped = raw is None
        if isinstance(raw, int):
            self._store_equal(raw, nodes.n)
        elif isinstance(raw, PerDomain):
            self._raw, self._domains = raw.values[:0], raw
            self.constant = self._constant(raw.values)
        elif raw is not None:
            # `_patch` writes into it later, and a plugin may return a column of the snapshot, which is read-only.
            self._raw, self._domains = raw if raw.flags.writeable else raw.copy(), None
            self.constant = self._constant(raw if nodes.no_holes else raw[nodes.valid])

    def _store_equal(self, score: int, rows: int) -> None:
        if len(self._raw) != rows or self._equal_raw != score or self.constant is None or self._domains is not None:
            self._raw, self._domains = np.full(rows, score, dtype=np.int64), None
            self.constant = self._constant(self._raw)

    def normalized(self, pod: PodInfo, full: Snapshot, feasible: Feasible) -> IntArray | int:  # noqa: ARG002 - RelativeColumn
        """0…100 for the feasible rows; one number when all are equal."""
        if self.constant is not None:
            return self.constant
        if self._domains is not None:
            return self._normalized_domains(self._domains, feasible)
        raw = self._raw[feasible]
        if self.normalize == "none":
            if self.bad and len(raw) and raw.min() == _BAD:
                raise PluginError(self.plugin.name, BAD_SCORE)
            return raw
        if raw.dtype.kind == "f" and not np.isfinite(raw).all():
            raise PluginError(self.plugin.name, BAD_SCORE)
        return normalized(self.plugin.name, self.normalize, raw)

    def _normalized_domains(self, domains: PerDomain, feasible: Feasible) -> IntArray:
        """Scores for all rows; only the feasible ones count for the maximum and minimum."""
        values, (codes, vocabulary, version) = domains
        known = self._present
        stamp = (vocabulary, version, len(codes))  # a plugin may go by another label than before, at the same version
        if known is None or known[0] is not feasible or known[1] != stamp:
            present = np.bincount(codes[feasible], minlength=len(values)) > 0
            known = self._present = (feasible, stamp, present)
        scores: IntArray = np.zeros(len(values), dtype=np.int64)
        scores[known[2]] = normalized(self.plugin.name, self.normalize, values[known[2]])
        return scores[codes]

    def check(self, feasible: BoolArray) -> None:
        """Raises PluginError when a score of these rows cannot be used."""
        if self.constant is None and (self._raw[feasible] == _BAD).any():
            raise PluginError(self.plugin.name, BAD_SCORE)

    def raw_at(self, row: int) -> float | None:
        """The plugin's score of a row before normalising; None when it is not finite."""
        value = float(self.raw[row])
        return value if np.isfinite(value) else None

    def _patch(self, stale: Snapshot, pod: PodInfo) -> None:
        score_row = self.plugin.score_row
        if self._domains is not None:
            self._raw, self._domains = self.raw, None
        if score_row is not None and stale.n <= MOST_ROW_CALLS:
            for position, row in zip(stale.row_list, stale.each):  # noqa: B905 - the same rows
                self._store_row(position, score_row(pod, row))
            return
        rows = stale.rows
        raw = self._score(pod, stale) if score_row is None else self._score_amounts(pod, stale, score_row)
        if raw is None or isinstance(raw, int):
            if stale.n <= FEW_ROWS:
                for position in stale.row_list:
                    self._store_row(position, raw or 0)
                return
            raw = np.full(stale.n, raw or 0, dtype=np.int64)
        elif isinstance(raw, PerDomain):
            raw = raw.values[raw.label.codes]
        if raw.dtype.kind == "f" and self._raw.dtype.kind in "iu":
            self._raw = self._raw.astype(np.float64)
        self._raw[rows] = raw
        self.changes += 1
        if self.constant is not None:
            differ = raw != self._equal_raw
            if np.count_nonzero(differ if stale.no_holes else differ & stale.valid):
                self.constant = None
                self.epoch += 1

    def _store_row(self, row: int, score: int) -> None:
        self.changes += 1
        self._raw[row] = score
        if self.constant is not None and score != self._equal_raw:
            self.constant = None
            self.epoch += 1

    def _score_amounts(
        self, pod: PodInfo, stale: Snapshot, score_row: ScoreRow
    ) -> npt.NDArray[Any] | PerDomain | int | None:
        """As `_score`, of a plugin with `score_row`: rows whose amounts were scored before are not computed again."""
        coded = stale.amount_codes
        if coded is None:
            return self._score(pod, stale)
        generation, codes = coded
        known = self._by_code
        if known is None or self._generation != generation:
            known = self._by_code = np.full(MOST_CODES, _UNKNOWN, dtype=np.int64)
            self._generation = generation
        scores: IntArray = known[codes]
        missing = [i for i, score in enumerate(scores.tolist()) if score == _UNKNOWN]
        if len(missing) > MOST_ROW_CALLS:
            answer = self._score(pod, stale)
            if not isinstance(answer, np.ndarray) or self.normalize != "none":
                return answer
            scores = answer
        else:
            for i in missing:
                scores[i] = score_row(pod, stale.each[i])
        if missing:
            known[codes] = scores
            known[NO_CODE] = _UNKNOWN
        return scores

    def _score(self, pod: PodInfo, nodes: Snapshot) -> npt.NDArray[Any] | PerDomain | int | None:
        plugin = self.plugin
        if plugin.score is None:
            return None
        if plugin.sound and not isinstance(answer := plugin.score(pod, nodes), Scores):
            return answer
        with np.errstate(all="ignore"):
            answer = plugin.score(pod, nodes)
        return self._checked(answer, nodes)

    def _checked(self, answer: ScoreResult, nodes: Snapshot) -> npt.NDArray[Any] | PerDomain | int | None:
        plugin = self.plugin
        if answer is None or isinstance(answer, int):
            return answer
        if isinstance(answer, PerDomain) and plugin.normalize != "none":
            checked_scores(plugin.name, answer.values, len(answer.label.vocabulary.values))
            return answer
        if isinstance(answer, PerDomain):
            answer = answer.values[answer.label.codes]
        scores, self.normalize = answer if isinstance(answer, Scores) else (answer, plugin.normalize)
        raw = checked_scores(plugin.name, scores, nodes.n)
        return self._integral(raw) if self.normalize == "none" else raw

    def _integral(self, raw: npt.NDArray[Any]) -> IntArray:
        if raw.dtype.kind == "f":
            scores = np.where(np.isfinite(raw), raw, -1.0)
            # -0.5 must not become a valid 0.
            scores = np.where(scores < 0.0, -1.0, scores).astype(np.int64)
        else:
            scores = raw.astype(np.int64, copy=False)
        # As unsigned numbers, negative ones are the largest of all.
        if len(scores) and scores.view(np.uint64).max() > MAX_SCORE:
            scores = scores.copy()
            self.bad = True
            scores[(scores < 0) | (scores > MAX_SCORE)] = _BAD
        return scores

    def _constant(self, raw: npt.NDArray[Any]) -> int | None:
        if len(raw) == 0 or raw[0] != raw[-1] or np.count_nonzero(raw != raw[0]) or (self.bad and raw[0] == _BAD):
            return None
        if raw.dtype.kind == "f" and not np.isfinite(raw[0]):
            return None
        self._equal_raw = raw[0]
        if self.plugin.sound:
            return int(raw[0])
        return int(normalized(self.plugin.name, self.normalize, raw[:1])[0])


class RelativeColumn(ScoreColumn):
    """A score that depends on which nodes are feasible (`score_among`): computed for each class, never kept.

    While the plugin's `relevant` returns False, it is a constant 0.
    """

    def refresh(self, pod: PodInfo, full: Snapshot, delta: ChangeLogDelta | None) -> None:
        """Call `relevant` again when something changed that it reads."""
        if self.skipped:
            return
        if self.position < 0 or delta is None or delta.kinds & self.watches:
            before = (self.constant, self.position < 0)
            self.compute(pod, full)
            self.epoch += before != (self.constant, False)
        self.position = full.cluster.log.position

    def compute(self, pod: PodInfo, nodes: Snapshot) -> None:
        """Call `relevant`; the scores are computed in `normalized`."""
        relevant = self.plugin.relevant
        self.changes += 1
        self.constant = None if relevant is None or relevant(pod, nodes) else 0
        self.watches = self.plugin.watches if self.constant is None else self.plugin.relevance

    def normalized(self, pod: PodInfo, full: Snapshot, feasible: Feasible) -> IntArray | int:
        """0…100 for the feasible rows."""
        if self.constant is not None or self.plugin.score_among is None:
            return self.constant or 0
        positions = np.arange(full.n) if isinstance(feasible, slice) else feasible
        with np.errstate(all="ignore"):
            answer = self.plugin.score_among(pod, full, positions)
        if answer is None or isinstance(answer, int):
            return answer or 0
        return normalized(self.plugin.name, "none", checked_scores(self.plugin.name, answer, len(positions)))

    def raw_at(self, row: int) -> float | None:  # noqa: ARG002 - of a score that exists for feasible rows only
        """None: `score_among` returns normalised scores."""
        return None

    @property
    def local(self) -> bool:
        """True only while the score is constant."""
        return self.constant is not None


def score_column(plugin: RegisteredPlugin) -> ScoreColumn:
    """An empty column for a score plugin."""
    return ScoreColumn(plugin) if plugin.score_among is None else RelativeColumn(plugin)
