"""`python -m robotapp_scheduler`: read flags and configuration, then run until stopped; or run one of the tools."""

import asyncio
import contextlib
import importlib
import os
import sys
from collections.abc import Mapping, Sequence
from typing import Final

from robotapp_client.serving import logs
from robotapp_client.serving.server import PortError
from robotapp_client.tools.restart import RESTORED, start_again
from robotapp_client.transport.errors import LoginError
from robotapp_scheduler.config import flags
from robotapp_scheduler.config.load import ConfigError
from robotapp_scheduler.shell.process import process

TOOLS: Final[Mapping[str, str]] = {
    "simulate": "robotapp_scheduler.simulation.command",
    "export": "robotapp_scheduler.simulation.export",
    "bench-plugin": "robotapp_scheduler.simulation.bench_command",
}
"""Verb → module whose `main(argv)` returns the exit status; imported when the verb is used."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a tool (`simulate`, `export`, `bench-plugin`) or, without such a verb, the scheduler.

    0 after a clean stop, 1 when leadership was lost, 2 when flags or configuration cannot be used, 75 when etcd seems to have been
    restored twice within a minute.
    """
    given = sys.argv[1:] if argv is None else argv
    status = run_tool(given)
    if status is not None:
        return status
    options = flags.parse(given)
    logs.set_up(options.log_format, options.log_level)
    _fast_loop()
    try:
        ended = asyncio.run(process.run(options))
    except ConfigError as error:
        source = options.config or options.config_map or "built-in configuration"
        for problem in error.problems:
            print(f"{source}: {problem}", file=sys.stderr)  # noqa: T201 - for the user
        return 2
    except (LoginError, PortError) as error:
        print(f"robotapp-scheduler: {error}", file=sys.stderr)  # noqa: T201 - for the user
        return 2
    return start_again() if ended == RESTORED else ended


def run_tool(argv: Sequence[str]) -> int | None:
    """The exit status of the tool that these arguments name; None when they name none.

    Besides the tool's own: 2 when its output cannot be written, 130 when interrupted, 141 when the reader of its output is gone.
    """
    if not argv or argv[0] not in TOOLS:
        return None
    try:
        status: int = importlib.import_module(TOOLS[argv[0]]).main(argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # `… | head`
        status = _discard_output(141)
    except OSError as error:
        status = _discard_output(2)
        sys.stderr.write(f"error: standard output: {error.strerror or error}\n")
    except KeyboardInterrupt:
        status = _discard_output(130)
    return status


def _discard_output(status: int) -> int:
    """Send what is left in the buffer to /dev/null: the interpreter would raise the same error again at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
    return status


def _fast_loop() -> None:
    with contextlib.suppress(ImportError):  # not on every platform, and saves 5 to 10 % only
        import uvloop

        asyncio.set_event_loop_policy(uvloop.EventLoopPolicy())
