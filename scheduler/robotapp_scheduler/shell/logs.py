"""What of the event loop's own messages is no line in the log."""

import asyncio
from typing import Any


def without_broken_off(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """An exception handler for the loop: uvloop reports a fatal error, with a stack, when bytes come in on a TLS connection
    that we have just broken off (a leader without a lease waits for no answer). Everything else is told as ever.
    """
    broken_off = context.get("message") == "Fatal error on SSL protocol" and "closed=True" in repr(
        context.get("transport")
    )
    if not broken_off:
        loop.default_exception_handler(context)
