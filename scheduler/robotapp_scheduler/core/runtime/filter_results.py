"""Cached result of a filter plugin per node row, kept per value of what it reads and repaired from the change log."""

from collections.abc import Sequence
from math import isnan
from typing import Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.snapshot import LabelColumn, Snapshot
from robotapp_scheduler.core.events.change_log import ChangeLogDelta
from robotapp_scheduler.core.framework.interface import Verdict
from robotapp_scheduler.core.framework.plugin_results import checked_mask
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.incremental import MOST_ROW_CALLS, Column, stale_rows

HOLE: Final = -1
"""Reason code of rows that are no node."""
EVERYWHERE: Final = True
"""Result of a filter that rejects no node now."""

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


class FilterColumn(Column):
    """One filter plugin's result per row: reason code, 0 where the node passes. `skipped`: the plugin does not apply to such pods."""

    def __init__(self, plugin: RegisteredPlugin, reasons: Reasons) -> None:
        super().__init__(plugin)
        self.codes: Codes = np.zeros(0, dtype=np.int32)
        self.clean = False
        """No row is rejected."""
        self.detail: FloatArray | None = None
        self.detail_unit = ""
        self._reasons = reasons
        self._table: tuple[Sequence[tuple[str, ...]], tuple[bool, ...], Codes] | None = None
        """The reasons the plugin named last, and their codes."""
        self._label_result: tuple[object, ...] | None = None
        """When `codes` follow from a label: the plugin's result per code of it, its version and the number of rows."""

    def refresh(self, pod: PodInfo, full: Snapshot, delta: ChangeLogDelta | None) -> None:
        """Bring the column up to the head of the log, with as few rows computed as possible."""
        if self.skipped:
            return  # a plugin skips because of the pod alone: that never changes
        fits = len(self.codes) == full.n
        stale = stale_rows(self, pod, full, delta) if fits else None
        if stale is None:
            clean, skipped, codes = self.clean, self.skipped, self.codes
            self._store(full, pod)
            # The same verdict for every row, before and after, changes no combination.
            same = (clean, skipped) == (self.clean, self.skipped) and (
                self.clean or codes is self.codes or np.array_equal(codes, self.codes)
            )
            self.epoch += not same or self.position < 0
        elif stale.n:
            self._patch(stale, pod)
        self.position = full.cluster.log.position

    def compute(self, pod: PodInfo, nodes: Snapshot) -> None:
        """Fill the column for exactly these rows, without regard to the log."""
        self._store(nodes, pod)

    def number(self, position: int, code: int) -> float | None:
        """The `detail` of a row that this plugin rejected with this code.

        None where the row has another code (another plugin rejected it, or room kept for nominated pods).
        """
        if self.detail is None or self.codes.item(position) != code:
            return None
        found = self.detail.item(position)
        return None if isnan(found) else found

    def _store(self, nodes: Snapshot, pod: PodInfo) -> None:
        found = self._filter(pod, nodes)
        clean, self.clean = self.clean, found is None
        self.skipped = found is None
        if found is EVERYWHERE:
            self.clean = True
            if len(self.codes) != nodes.n or self.codes.any():
                self.codes = np.zeros(nodes.n, dtype=np.int32)
            self.detail = None
        elif found is not None:
            codes, self.detail = found
            self.clean = clean if codes is self.codes else not codes.any()
            self.codes = codes
        if not isinstance(found, tuple):
            self._label_result = None

    def _patch(self, stale: Snapshot, pod: PodInfo) -> None:
        self._label_result = None
        found = EVERYWHERE if self._passes(stale, pod) else self._filter(pod, stale)
        if not isinstance(found, tuple):
            if not self.clean:
                self.codes[stale.rows] = 0
            return
        codes, detail = found
        rows = stale.rows
        self.codes[rows] = codes
        self.clean = self.clean and not codes.any()
        if detail is not None:
            if self.detail is None:
                self.detail = np.full(len(self.codes), np.nan)
            self.detail[rows] = detail

    def _passes(self, stale: Snapshot, pod: PodInfo) -> bool:
        """True when `filter_row` passes all of these few rows; False: `filter` decides."""
        passes = self.plugin.filter_row
        if passes is None or stale.n > MOST_ROW_CALLS:
            return False
        for row in stale.each:  # noqa: SIM110 - a generator for one row costs more than the row
            if not passes(pod, row):
                return False
        return True

    def _filter(self, pod: PodInfo, nodes: Snapshot) -> tuple[Codes, FloatArray | None] | Literal[True] | None:
        plugin = self.plugin
        if plugin.filter is None:
            return None
        if plugin.sound:
            answer = plugin.filter(pod, nodes)
        else:
            with np.errstate(all="ignore"):
                answer = plugin.filter(pod, nodes)
        if answer is None or answer is EVERYWHERE:
            return answer
        verdict = answer if isinstance(answer, Verdict) else Verdict(answer)
        if verdict.detail_unit:
            self.detail_unit = verdict.detail_unit
        if verdict.label is not None:
            mask = checked_mask(plugin.name, verdict.mask, len(verdict.mask))
            return self._spread(verdict, mask, verdict.label, nodes)
        mask = checked_mask(plugin.name, verdict.mask, nodes.n)
        if mask.all():
            return EVERYWHERE
        detail = None if verdict.detail is None else np.array(verdict.detail, dtype=np.float64)
        return self._coded(verdict, mask), detail

    def _spread(
        self, verdict: Verdict, mask: BoolArray, label: LabelColumn, nodes: Snapshot
    ) -> tuple[Codes, None] | Literal[True]:
        """Reason codes per row from a result per code of a label; the array from before when the result is the same."""
        result: tuple[object, ...] | None = None
        if nodes.full and not isinstance(verdict.resolvable, np.ndarray):
            which = b"" if verdict.codes is None else verdict.codes.tobytes()
            # The label by its vocabulary: a plugin may go by another one than before, at the same version.
            place = (label.vocabulary, label.version, nodes.n)
            result = (*place, mask.tobytes(), which, verdict.reasons, verdict.resolvable)
            if result == self._label_result:
                return self.codes, None
        if mask.all():
            return EVERYWHERE
        codes = self._coded(verdict, mask)[label.codes]
        self._label_result = result
        return codes, None

    def _numbered(self, texts: Sequence[tuple[str, ...]], resolvable: tuple[bool, ...]) -> Codes:
        """The codes of these reasons. Most plugins name the same ones, in a constant, every time."""
        known = self._table
        if known is None or known[0] is not texts or known[1] is not resolvable or not isinstance(texts, tuple):
            reasons = (Reason(self.plugin.name, text, kind) for text, kind in zip(texts, resolvable, strict=True))
            codes: Codes = np.array([*map(self._reasons.code, reasons)], dtype=np.int32)
            known = self._table = (texts, resolvable, codes)
        return known[2]

    def _coded(self, verdict: Verdict, mask: BoolArray) -> Codes:
        plugin = self.plugin
        texts: Sequence[tuple[str, ...]] = verdict.reasons or ((plugin.reason,),)
        resolvable = plugin.resolvable if verdict.resolvable is None else verdict.resolvable
        if isinstance(resolvable, tuple) and verdict.codes is not None:
            codes: Codes = self._numbered(texts, resolvable)[verdict.codes]
            codes[mask] = 0
            return codes
        tables = [
            np.array([self._reasons.code(Reason(plugin.name, text, kind)) for text in texts], dtype=np.int32)
            for kind in (False, True)
        ]
        which = np.zeros(len(mask), dtype=np.intp) if verdict.codes is None else verdict.codes
        codes = np.where(resolvable, tables[1][which], tables[0][which]).astype(np.int32)
        codes[mask] = 0
        return codes


class NodeToStatus(NamedTuple):
    """The filters' combined result: first reason per row (0 = feasible), how many rows are feasible, and when that changed."""

    reason: Codes
    feasible: int
    revision: int
    """Grows whenever `reason` changes."""
    combines: int
    """Grows when any row may have changed."""
