"""`robotapp-agent`: read flags, then look once or run until stopped."""

import asyncio
import sys
from collections.abc import Sequence

from robotapp_agent.process import logs
from robotapp_agent.shell import options as flags


def main(argv: Sequence[str] | None = None) -> int:
    """0 after a clean stop, 2 when flags, credentials or the node's name cannot be used."""
    options = flags.parse(argv)
    logs.set_up(options.log_format, options.log_level)
    return _once(options) if options.once else _run(options)


def _once(options: flags.Options) -> int:
    from robotapp_agent.process import once

    status, problem = once.look(options)
    print(once.as_json(status) if options.json else once.as_text(status))  # noqa: T201 - what was asked for
    if problem:
        print(f"robotapp-agent: {problem}", file=sys.stderr)  # noqa: T201 - for the person who started us
    return 0


def _run(options: flags.Options) -> int:
    from robotapp_agent.process.run import run
    from robotapp_agent.shell.own_node import UnknownNodeError
    from robotapp_client.transport.errors import LoginError

    try:
        return asyncio.run(run(options))
    except (LoginError, UnknownNodeError) as error:
        print(f"robotapp-agent: {error}", file=sys.stderr)  # noqa: T201 - for the person who started us
        return 2
