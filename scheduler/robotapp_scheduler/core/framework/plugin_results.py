"""Checks and arithmetic that the framework applies to the results of every plugin: shapes of arrays, scores of 0 to 100."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.framework.interface import MAX_SCORE, PluginError
from robotapp_scheduler.core.nodes.columns import BoolArray, IntArray


def checked_mask(plugin: str, mask: object, rows: int) -> BoolArray:
    """The mask of a filter. Raises PluginError when it is no bool array with one element per row."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (rows,):
        found = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else type(mask).__name__
        raise PluginError(plugin, f"filter must answer a bool array of shape ({rows},), got {found}")
    return mask


def checked_scores(plugin: str, scores: object, rows: int, *, hook: str = "score") -> npt.NDArray[Any]:
    """The raw scores of a plugin. Raises PluginError when they are no array with one number per row.

    NaN is allowed here: it is an error only where a node is feasible.
    """
    if not isinstance(scores, np.ndarray) or scores.dtype.kind not in "iuf" or scores.shape != (rows,):
        found = f"{scores.dtype} {scores.shape}" if isinstance(scores, np.ndarray) else type(scores).__name__
        raise PluginError(plugin, f"{hook} must answer a number array of shape ({rows},), got {found}")
    return scores


def _integers(raw: npt.NDArray[Any]) -> IntArray:
    return raw.astype(np.int64)  # truncates floats toward zero, as Go's int64() does


def _by_max(raw: npt.NDArray[Any]) -> IntArray:
    top = raw.max()
    return _integers(MAX_SCORE * raw // top) if top > 0 else np.zeros(len(raw), dtype=np.int64)


def _inverse(raw: npt.NDArray[Any]) -> IntArray:
    top = raw.max()
    if top <= 0:
        return np.full(len(raw), MAX_SCORE, dtype=np.int64)
    return MAX_SCORE - _integers(MAX_SCORE * raw // top)


def _minmax(raw: npt.NDArray[Any]) -> IntArray:
    low, high = raw.min(), raw.max()
    if high == low:
        return np.zeros(len(raw), dtype=np.int64)
    # Dividing first is upstream's order of operations: 29 of 100 gives 28.
    return _integers(float(MAX_SCORE) * ((raw - low) / (high - low)))


NORMALIZERS: Final[dict[str, Callable[[npt.NDArray[Any]], IntArray]]] = {
    "none": _integers,
    "max": _by_max,
    "inverse": _inverse,
    "minmax": _minmax,
}


def normalized(plugin: str, how: str, raw: npt.NDArray[Any]) -> IntArray:
    """Scores 0…100 of the feasible rows from their raw values (the array holds only those rows).

    "max": 100·s // max, 0 when max is 0. "inverse": 100 - 100·s // max, 100 when max is 0.
    "minmax": int(100·((s-min)/(max-min))), 0 when all are equal. "none": the integer part.
    Raises PluginError when the result leaves 0…100.
    """
    scores = NORMALIZERS[how](raw)
    if len(scores) and (scores.min() < 0 or scores.max() > MAX_SCORE):
        bad = int(scores.min()) if scores.min() < 0 else int(scores.max())
        raise PluginError(plugin, f"returns an invalid score {bad}, it should in the range of [0, {MAX_SCORE}]")
    return scores
