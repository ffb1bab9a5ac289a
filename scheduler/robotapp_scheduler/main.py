"""`python -m robotapp_scheduler`: read flags and configuration, then run until stopped."""

import asyncio
import contextlib
import sys
from collections.abc import Sequence

from robotapp_api.client.transport.errors import LoginError
from robotapp_api.serving import logs
from robotapp_api.serving.port import PortError
from robotapp_scheduler import tools
from robotapp_scheduler.config import flags
from robotapp_scheduler.config.load import ConfigError
from robotapp_scheduler.shell.process import process


def main(argv: Sequence[str] | None = None) -> int:
    """Run a tool (`simulate`, `export`, `bench-plugin`) or, without such a word, the scheduler.

    0 after a clean stop, 1 when leadership was lost, 2 when flags or configuration cannot be used.
    """
    given = sys.argv[1:] if argv is None else argv
    status = tools.run(given)
    if status is not None:
        return status
    options = flags.parse(given)
    logs.set_up(options.log_format, options.log_level)
    _fast_loop()
    try:
        return asyncio.run(process.run(options))
    except ConfigError as error:
        source = options.config or options.config_map or "built-in configuration"
        for problem in error.problems:
            print(f"{source}: {problem}", file=sys.stderr)  # noqa: T201 - for the person who started us
        return 2
    except (LoginError, PortError) as error:
        print(f"robotapp-scheduler: {error}", file=sys.stderr)  # noqa: T201 - for the person who started us
        return 2


def _fast_loop() -> None:
    with contextlib.suppress(ImportError):  # not on every platform, and saves 5 to 10 % only
        import uvloop

        asyncio.set_event_loop_policy(uvloop.EventLoopPolicy())
