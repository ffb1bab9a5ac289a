"""The pages of the process that places pods, rendered on request, and the health checks behind two of them.

`/livez` is 200 while the event loop turns and leadership is renewed; `/readyz` names what is still missing. Both need no rights.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest

from robotapp_scheduler.port.request_handler import Page
from robotapp_scheduler.shell.config.reload import Running
from robotapp_scheduler.watch.routes import resources

STALE_LIMIT_S: Final = 60.0
"""Readiness ends when a watch has followed nothing for longer. A restart would not help, so liveness does not."""


@dataclass(slots=True)
class Checks:
    """Every check is called at request time."""

    ready: dict[str, Callable[[], bool]] = field(default_factory=dict)
    stale: Callable[[], Mapping[str, float]] = dict
    """Seconds for which changes of a resource may have gone unseen; readiness names those beyond STALE_LIMIT_S."""
    missing: Callable[[], Iterable[str]] = tuple
    """Kinds that cannot be listed, which readiness names."""
    live: dict[str, Callable[[], bool]] = field(default_factory=dict)

    def livez(self) -> tuple[int, bytes]:
        """HTTP status and text."""
        return _checked(self.live)

    def readyz(self) -> tuple[int, bytes]:
        stale = sorted(f"watch-{name}" for name, age_s in self.stale().items() if age_s > STALE_LIMIT_S)
        missing = [f"kind-{name}" for name in self.missing()]
        return _checked(self.ready | self.live, failed=[*missing, *stale])


def _checked(checks: Mapping[str, Callable[[], bool]], *, failed: Sequence[str] = ()) -> tuple[int, bytes]:
    missing = [*failed, *sorted(name for name, check in checks.items() if not check())]
    return (503, "".join(f"[-]{name} failed\n" for name in missing).encode()) if missing else (200, b"ok")


def pages(checks: Checks, registry: CollectorRegistry, running: Running) -> dict[str, Page]:
    """For `RequestHandler`."""
    return {
        "livez": checks.livez,
        "readyz": checks.readyz,
        "metrics": lambda: (200, generate_latest(registry)),
        "configz": lambda: (200, msgspec.json.encode({"kubescheduler.config.k8s.io": running.as_json()})),
        "kinds": lambda: (200, msgspec.json.encode({"resources": kinds()})),
        "simulation-config": lambda: (200, msgspec.json.encode(simulation_config(running))),
    }


def kinds() -> list[dict[str, Any]]:
    """The resources a dump for /simulate is made of, for clients that collect one."""
    return [
        {
            "group": each.group,
            "version": each.version,
            "plural": each.plural,
            "kind": each.kind,
            "namespaced": each.namespaced,
        }
        for each in resources()
    ]


def simulation_config(running: Running) -> dict[str, Any]:
    """The configuration in use, for a simulation."""
    return {"config": running.text, "third_party": running.config.third_party}
