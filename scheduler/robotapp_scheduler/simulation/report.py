"""What a simulation found, for people and for programs."""

from dataclasses import asdict
from typing import Any, Final

from robotapp_scheduler.simulation.run import Outcome, Placement, chosen_text

LEFT_OUT: Final = "not simulated: claims of domains and devices, evictions, time"

NONE: Final = "No pod waits for this scheduler."


def as_json(outcome: Outcome) -> dict[str, Any]:
    """Plain JSON."""
    return {
        "config": outcome.config,
        "nodes": outcome.nodes,
        "placed": outcome.placed,
        "refused": len(outcome.placements) - outcome.placed,
        "moved": outcome.moved,
        "placements": [asdict(placement) for placement in outcome.placements],
        "otherSchedulers": outcome.others,
        "ignored": outcome.ignored,
        "problems": outcome.problems,
        "note": LEFT_OUT,
    }


def as_table(outcome: Outcome) -> str:
    """A table with one line per pod, or a sentence where none waits, then what was left out."""
    if not outcome.placements:
        return "\n".join([NONE, "", *_summary(outcome)]) + "\n"
    heading = ("NAMESPACE", "POD", "NODE", "WAS", "WHY")
    rows: list[tuple[str, ...]] = [heading, *(_row(placement) for placement in outcome.placements)]
    if not any(placement.was for placement in outcome.placements):
        rows = [(*row[:3], row[4]) for row in rows]
    widths = [max(len(row[at]) for row in rows) for at in range(len(rows[0]) - 1)]
    lines = [
        "   ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[-1]]) for row in rows
    ]
    return "\n".join([*(line.rstrip() for line in lines), "", *_summary(outcome)]) + "\n"


def _row(placement: Placement) -> tuple[str, str, str, str, str]:
    why = placement.message if placement.node is None else chosen_text(placement.score, placement.feasible)
    return placement.namespace, placement.name, placement.node or "-", placement.was, why


def _summary(outcome: Outcome) -> list[str]:
    total = len(outcome.placements)
    lines = [f"{outcome.placed} of {total} pods placed on {outcome.nodes} nodes, configuration {outcome.config}"]
    again = sum(1 for placement in outcome.placements if placement.was)
    if again:
        lines.append(f"{outcome.moved} of {again} pods placed again would be elsewhere")
    for name, count in sorted(outcome.others.items()):
        lines.append(f"{count} pods wait for scheduler {name}")
    if outcome.ignored:
        found = ", ".join(f"{count} {kind}" for kind, count in sorted(outcome.ignored.items()))
        lines.append(f"ignored, no rule reads them: {found}")
    return [*lines, *outcome.problems, LEFT_OUT]
