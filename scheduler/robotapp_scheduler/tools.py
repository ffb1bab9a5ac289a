"""The program's other verbs: `simulate`, `export`, `bench-plugin`. They need no running scheduler."""

import importlib
from collections.abc import Mapping, Sequence
from typing import Final

TOOLS: Final[Mapping[str, str]] = {
    "simulate": "robotapp_scheduler.simulation.command",
    "export": "robotapp_scheduler.simulation.export",
    "bench-plugin": "robotapp_scheduler.simulation.bench_command",
}
"""Verb to the module whose `main(argv)` gives the exit status; imported when asked for."""


def run(argv: Sequence[str]) -> int | None:
    """The exit status of the tool these arguments name; None when they name none."""
    if not argv or argv[0] not in TOOLS:
        return None
    status: int = importlib.import_module(TOOLS[argv[0]]).main(argv[1:])
    return status
