"""The process behind POST /simulate: one dump from standard input, one JSON answer, within limits of its own.

The first line is the order (which configuration, which plugins may be imported), the rest is the dump. It runs beside
the scheduler in the same container, so it takes what is left: low priority, bounded memory and time.
"""

import json
import os
import resource
import sys
from collections.abc import Callable
from typing import Any, BinaryIO, Final

import msgspec

from robotapp_api.values import strict_yaml
from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.load import ConfigError, SchedulerConfig
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.simulation.dump import DumpError, Reader
from robotapp_scheduler.simulation.report import as_json
from robotapp_scheduler.simulation.run import simulate
from robotapp_scheduler.watch.routes import kinds

MOST_MEMORY: Final = 768 << 20
"""Where the order gives no other number."""
MOST_CPU_S: Final = 60
NICE: Final = 10
BODY: Final = "body of the request"


class Order(msgspec.Struct):
    """What to do with the dump that follows."""

    config: str = ""
    """Text of the running configuration, used unless the dump brings its own; empty = built in."""
    third_party: list[str] = []
    """Plugins that may be imported: those of the running configuration."""
    replay: int = 0
    memory: int = MOST_MEMORY
    """Bytes that may be taken."""


class _Brought(msgspec.Struct):
    config: Any = None


def limit() -> None:
    """Takes no more than what is left beside the scheduler."""
    os.nice(NICE)
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))


def limit_memory(size: int) -> None:
    """Lets this process take no more bytes: whatever exceeds them raises MemoryError."""
    resource.setrlimit(resource.RLIMIT_DATA, (size, size))


def answer(source: BinaryIO, *, limit_bytes: Callable[[int], None] = lambda _: None) -> dict[str, Any]:
    """The outcome, or `{"error": …}` for what the caller did wrong. `limit_bytes` gets the order's limit, before the dump is read."""
    order = msgspec.json.decode(source.readline(), type=Order)
    limit_bytes(order.memory)
    try:
        content = source.read()
        reader = Reader(kinds())
        reader.add(content, BODY)
        config = _config(order, content)
        del content
        return as_json(simulate(reader.dump, config, replay=order.replay))
    except ConfigError as error:
        return {"error": "the configuration cannot be used", "problems": list(error.problems)}
    except DumpError as error:
        return {"error": str(error)}
    except RecursionError:
        return {"error": f"{BODY}: config: nested too deep; nothing in a configuration needs more than a dozen levels"}
    except MemoryError:
        return {"error": f"this takes more than the {order.memory >> 20} MiB a simulation may use"}


def _config(order: Order, content: bytes) -> SchedulerConfig:
    """The one the dump brings, else that of the order. The reader has been through it: it is JSON."""
    brought = msgspec.json.decode(content, type=_Brought).config
    known = catalogue()
    if brought is not None:
        return configuration.parse(brought, catalogue=known, third_party=order.third_party)
    if not order.config:
        return configuration.built_in(known)
    return configuration.parse(strict_yaml.loads(order.config), catalogue=known)


if __name__ == "__main__":
    limit()
    json.dump(answer(sys.stdin.buffer, limit_bytes=limit_memory), sys.stdout)
