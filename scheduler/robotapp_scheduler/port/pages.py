"""The pages of the process that places pods, rendered on request."""

from typing import Any

import msgspec
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest

from robotapp_scheduler.port.health import Checks
from robotapp_scheduler.port.request_handler import Page
from robotapp_scheduler.shell.config.reload import Running
from robotapp_scheduler.simulation.kinds import resources


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
    """What a simulation is told of the configuration in use."""
    return {"config": running.text, "third_party": running.config.third_party}
