"""Percentiles, ratios and the table on screen."""

import math
import statistics
from collections.abc import Mapping, Sequence


def percentile(values: Sequence[float], percent: float) -> float:
    """Nearest-rank percentile; NaN without values."""
    if not values:
        return math.nan
    ordered = sorted(values)
    return ordered[max(0, math.ceil(percent / 100 * len(ordered)) - 1)]


def medians(runs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Median of every figure over the runs that have it."""
    names = {name: None for run in runs for name in run}
    return {name: statistics.median(run[name] for run in runs if name in run) for name in names}


def ratios(ours: Mapping[str, float], theirs: Mapping[str, float]) -> dict[str, float]:
    """ours / theirs per figure; NaN where theirs is zero."""
    return {name: ours[name] / theirs[name] if theirs[name] else math.nan for name in ours if name in theirs}


def table(columns: Mapping[str, Mapping[str, float]]) -> str:
    """Figures as rows, contestants as columns."""
    names = {name: None for figures in columns.values() for name in figures}
    width = max(len(name) for name in names)
    heads = "".join(f"{head:>18}" for head in columns)
    lines = [f"{'':{width}}{heads}"]
    for name in names:
        cells = "".join(f"{_number(figures.get(name)):>18}" for figures in columns.values())
        lines.append(f"{name:{width}}{cells}")
    return "\n".join(lines)


def _number(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "-"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
