"""A made-up cluster for measuring: equal for equal numbers, so that two runs compare."""

from typing import Final

import msgspec

from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.core_v1 import Node, Pod

ZONES: Final = 10
TAINTED_EVERY: Final = 50
KINDS: Final = 5
"""Sizes of nodes and of the pods that run on them already."""


def nodes(count: int) -> list[Node]:
    """Nodes of five sizes in ten zones; every fiftieth is tainted."""
    return [
        msgspec.convert(
            {
                "metadata": {
                    "name": f"node-{number:05}",
                    "labels": {
                        str(Label.HOSTNAME): f"node-{number:05}",
                        str(Label.ZONE): f"zone-{number % ZONES}",
                        "kind": f"k{number % KINDS}",
                    },
                },
                "spec": {
                    "taints": [{"key": "reserved", "effect": "NoSchedule"}] if number % TAINTED_EVERY == 0 else []
                },
                "status": {"allocatable": {"cpu": str(8 * (1 + number % KINDS)), "memory": "64Gi", "pods": "250"}},
            },
            Node,
        )
        for number in range(count)
    ]


def bound(count: int, on: int) -> list[Pod]:
    """Pods that run already, spread over the first `on` nodes."""
    return [_pod(f"bound-{number:06}", number, node=f"node-{number % on:05}") for number in range(count)]


def waiting(count: int, scheduler_name: str, *, different: bool = False) -> list[Pod]:
    """Pods to place: replicas of one template or, `different`, each with a size of its own."""
    return [
        _pod(
            f"pod-{number:06}",
            number if different else 0,
            scheduler=scheduler_name,
            extra_milli=number if different else 0,
        )
        for number in range(count)
    ]


def _pod(name: str, number: int, *, node: str = "", scheduler: str = "default-scheduler", extra_milli: int = 0) -> Pod:
    requests = {"cpu": f"{10 * (1 + number % KINDS) + extra_milli % 100}m", "memory": f"{32 + extra_milli}Mi"}
    return msgspec.convert(
        {
            "metadata": {"name": name, "namespace": "bench", "uid": name, "labels": {"app": f"a{number % KINDS}"}},
            "spec": {
                "schedulerName": scheduler,
                "nodeName": node,
                "containers": [{"name": "main", "image": "main:1", "resources": {"requests": requests}}],
            },
        },
        Pod,
    )
