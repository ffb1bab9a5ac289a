"""What a simulation shows: how far it is, and what it found, for people and for programs."""

import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Final, TextIO

from robotapp_api.values.printable import printable
from robotapp_scheduler.simulation.run import Outcome, Placement, chosen_text

EVERY_S: Final = 0.5
CLEAR: Final = "\r\x1b[K"
LEFT_OUT: Final = "not simulated: claims of domains and devices, evictions, time"
NONE: Final = "No pod waits for this scheduler."


def replace_line(stream: TextIO, text: str = "") -> None:
    """Show on a terminal what is being done now, in place of the text before; nothing removes the line."""
    if stream.isatty():
        stream.write(f"{CLEAR}{text}")
        stream.flush()


class Progress:
    """One line on a terminal, written over and gone in the end; a file or a pipe gets nothing.

    Call it with (pods decided, pods that waited) as often as you like.
    """

    def __init__(self, stream: TextIO, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._next_s = clock() + EVERY_S if stream.isatty() else float("inf")
        self._shown = False

    def __repr__(self) -> str:
        return f"Progress(shown={self._shown})"

    def __call__(self, decided: int, waiting: int) -> None:
        now_s = self._clock()
        if now_s < self._next_s:
            return
        self._next_s, self._shown = now_s + EVERY_S, True
        again = f", trying {decided - waiting} refused ones again" if decided > waiting else ""
        self._stream.write(f"{CLEAR}{min(decided, waiting)} of {waiting} pods decided{again}")
        self._stream.flush()

    def end(self) -> None:
        """Take the line away."""
        if self._shown:
            self._stream.write(CLEAR)
            self._stream.flush()


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
    rows = [tuple(map(_line, row)) for row in rows]
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
    return [_line(line) for line in (*lines, *outcome.problems, LEFT_OUT)]


def _line(text: str) -> str:
    """As one line: dumps come from others."""
    return printable(text, keep="")
