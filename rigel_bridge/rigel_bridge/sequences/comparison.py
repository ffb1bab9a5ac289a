"""Runs of several sequences side by side. Pure."""

from collections.abc import Mapping, Sequence
from typing import Any

from rigel_bridge.document.failures import printable

Summary = Mapping[str, Any]
"""What one run leaves in summary.json."""


def table(runs: Sequence[Summary]) -> str:
    """A Markdown table: one row per figure, one column per run. A figure that a run has not is a dash."""
    rows = [("", [str(run["sequence"]) for run in runs])]
    rows += [(name, [_shown(run.get(key)) for run in runs]) for name, key in _PLAIN]
    rows += [(f"node of {name}", [_node(run, name) for run in runs]) for name in _names(runs, "components", "name")]
    rows += [(f"p95 of {name}", [_edge(run, name) for run in runs]) for name in _names(runs, "edges", "topic")]
    for column in sorted({name for run in runs for name in run.get("samples", {})}):
        for figure in ("count", "mean", "std", "p50", "p95", "p99"):
            rows.append(
                (f"{column} {figure}", [_shown(run.get("samples", {}).get(column, {}).get(figure)) for run in runs])
            )
    head, *body = [f"| {' | '.join(map(_cell, (name, *cells)))} |\n" for name, cells in rows]
    return head + f"|{'---|' * (len(runs) + 1)}\n" + "".join(body)


_PLAIN = (("outcome", "outcome"), ("scheduler", "scheduler"), ("Ready after (s)", "ready_after_s"))


def _cell(text: str) -> str:
    """Names of columns and files come from containers: none of them moves a terminal's cursor or begins another cell."""
    return printable(text).replace("|", "\\|")


def is_summary(value: Any) -> bool:
    """Whether a value has the shape of what a run leaves."""
    if not isinstance(value, dict) or not isinstance(value.get("sequence"), str):
        return False
    samples = value.get("samples", {})
    return (
        _all_have(value.get("components", []), "name")
        and _all_have(value.get("edges", []), "topic")
        and isinstance(samples, dict)
        and all(isinstance(each, dict) for each in samples.values())
    )


def _all_have(values: Any, key: str) -> bool:
    return isinstance(values, list) and all(isinstance(each, dict) and key in each for each in values)


def _names(runs: Sequence[Summary], part: str, key: str) -> list[str]:
    return list(dict.fromkeys(str(each[key]) for run in runs for each in run.get(part, ())))


def _node(run: Summary, component: str) -> str:
    nodes = [str(each.get("node") or "-") for each in run.get("components", ()) if each["name"] == component]
    return ", ".join(dict.fromkeys(nodes)) or "-"


def _edge(run: Summary, topic: str) -> str:
    """`12ms of 30ms`, the first of several instances; worst edges come first."""
    found = next((each for each in run.get("edges", ()) if each["topic"] == topic), None)
    if found is None:
        return "-"
    time = found.get("p95", "unknown")
    return (
        f"{time} of {found['budget']}{'' if found.get('met', True) else ' (over)'}" if "budget" in found else str(time)
    )


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
