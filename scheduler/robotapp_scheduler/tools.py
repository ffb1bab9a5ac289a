"""The program's other verbs: `simulate`, `export`, `bench-plugin`. They need no running scheduler."""

import importlib
import os
import sys
from collections.abc import Mapping, Sequence
from typing import Final

TOOLS: Final[Mapping[str, str]] = {
    "simulate": "robotapp_scheduler.simulation.command",
    "export": "robotapp_scheduler.simulation.export",
    "bench-plugin": "robotapp_scheduler.simulation.bench_command",
}
"""Verb to the module whose `main(argv)` gives the exit status; imported when asked for."""


def run(argv: Sequence[str]) -> int | None:
    """The exit status of the tool these arguments name; None when they name none.

    Besides the tool's own: 2 what it says cannot be written, 130 interrupted, 141 nobody reads what it says.
    """
    if not argv or argv[0] not in TOOLS:
        return None
    try:
        status: int = importlib.import_module(TOOLS[argv[0]]).main(argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # `… | head`: nobody wants the rest
        status = _say_no_more(141)
    except OSError as error:
        status = _say_no_more(2)
        sys.stderr.write(f"error: standard output: {error.strerror or error}\n")
    except KeyboardInterrupt:
        status = _say_no_more(130)
    return status


def _say_no_more(status: int) -> int:
    """What is still in the buffer goes nowhere: the interpreter would fail with it once more at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
    return status
