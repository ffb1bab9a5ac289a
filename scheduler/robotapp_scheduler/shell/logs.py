"""Log lines: one JSON object per line for machines, or plain text for people. Fields given as `extra` are kept."""

import asyncio
import json
import logging
import sys
import time
from typing import Any

_FORMAT = "%(asctime)s %(levelname)-7s %(name)s %(message)s"


class JsonLines(logging.Formatter):
    """time, level, logger, message, the record's `fields`, and the stack of an exception."""

    def format(self, record: logging.LogRecord) -> str:
        when = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        line = {
            "time": f"{when}.{int(record.msecs):03}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **getattr(record, "fields", {}),
        }
        if record.exc_info:
            line["stack"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


def set_up(log_format: str, level: str) -> None:
    """Log to standard error from now on."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines() if log_format == "json" else logging.Formatter(_FORMAT))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    logging.getLogger("asyncio").setLevel(logging.WARNING)


def without_broken_off(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """An exception handler for the loop: uvloop reports a fatal error, with a stack, when bytes come in on a TLS connection
    that we have just broken off (a leader without a lease waits for no answer). Everything else is told as ever.
    """
    broken_off = context.get("message") == "Fatal error on SSL protocol" and "closed=True" in repr(
        context.get("transport")
    )
    if not broken_off:
        loop.default_exception_handler(context)
