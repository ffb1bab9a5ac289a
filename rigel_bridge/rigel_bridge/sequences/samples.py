"""Figures of a run from what it left: placement from the state, statistics from CSV files. Pure."""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Final

MAX_VALUES: Final = 4_000_000
"""Of one file, all columns together."""
MAX_COLUMNS: Final = 64
MAX_NAME: Final = 100
MAX_VALUE: Final = 1e100
"""Squares of larger ones are no numbers any more; a time of that size is none either."""
_SUFFIXES: Final = ("_ms", "_us", "_s")


def statistics(values: Sequence[float]) -> dict[str, float]:
    """Count, mean, standard deviation and the 50th, 95th and 99th percentile (nearest rank)."""
    ordered = sorted(values)
    mean = math.fsum(ordered) / len(ordered)
    spread = math.sqrt(math.fsum((value - mean) ** 2 for value in ordered) / len(ordered))
    ranks = {f"p{rank}": ordered[math.ceil(rank / 100 * len(ordered)) - 1] for rank in (50, 95, 99)}
    return {"count": len(ordered), "mean": mean, "std": spread, **ranks}


def columns(content: bytes) -> dict[str, dict[str, float]]:
    """Statistics of each column of a CSV file whose name has a unit of time (rtt_ms); none when it is no such file."""
    try:
        rows = csv.reader(io.StringIO(content.decode("utf-8-sig")))
        header = next(rows, [])
        timed = ((index, name.strip()[:MAX_NAME]) for index, name in enumerate(header) if _is_time(name))
        wanted = dict(islice(timed, MAX_COLUMNS))
        values: dict[str, list[float]] = {name: [] for name in wanted.values()}
        for row in islice(rows, MAX_VALUES // len(wanted)) if wanted else ():
            for index, name in wanted.items():
                values[name] += _number(row[index]) if index < len(row) else ()
    except (UnicodeDecodeError, csv.Error):
        return {}
    return {name: statistics(found) for name, found in values.items() if found}


def _is_time(name: str) -> bool:
    return name.strip().lower().endswith(_SUFFIXES)


def _number(text: str) -> Iterator[float]:
    try:
        value = float(text)
    except ValueError:
        return
    if abs(value) <= MAX_VALUE:  # false for what is no number
        yield value


def placement(instances: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Where each component runs, by instance."""
    return [
        {"instance": item["metadata"]["name"], **{key: part.get(key) for key in ("name", "node", "ready", "restarts")}}
        for item in instances
        for part in item.get("status", {}).get("components", ())
    ]


def edges(instances: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Round-trip times of the edges as the operator saw them."""
    shown = ("topic", "from", "to", "budget", "p95", "measured", "met")
    return [
        {key: edge[key] for key in shown if edge.get(key) is not None}
        for item in instances
        for edge in item.get("status", {}).get("edges", ())
    ]
