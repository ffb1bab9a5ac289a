"""A small world of simulated nodes and the network between them.

nodes = fleet(robots=["amr-07", "amr-08"], edges=2, clouds=1)
apply(cp, nodes)
with SimulatedTelemetry(cp, nodes) as telemetry:
    telemetry.set_rtt("edge-1", "amr-07", 45.0)
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import Device, SimulatedNode, Tier, cloud, edge, robot
from robotapp_testbed.machines.telemetry import PATH as TELEMETRY
from robotapp_testbed.machines.telemetry import SimulatedTelemetry

__all__ = [
    "Device",
    "SimulatedNode",
    "SimulatedTelemetry",
    "Tier",
    "Topology",
    "apply",
    "cloud",
    "edge",
    "fleet",
    "remove",
    "robot",
]

_NODES = "/api/v1/nodes"


def fleet(
    robots: int | Sequence[str] = 2,
    edges: int | Sequence[str] = 2,
    clouds: int | Sequence[str] = 1,
    *,
    devices: Mapping[str, Sequence[Device]] | None = None,
) -> Topology:
    """Robots and edge servers spread over halls (as many as edges), clouds apart. Numbers give names such as robot-1.

    `devices` are per node name.
    """
    attached = devices or {}
    names = {tier: _names(tier, wanted) for tier, wanted in zip(Tier, (robots, edges, clouds), strict=True)}
    halls = max(len(names[Tier.EDGE]), 1)
    made = [
        robot(name, zone=_hall(index, halls), devices=attached.get(name, ()))
        for index, name in enumerate(names[Tier.ROBOT])
    ]
    made += [
        edge(name, zone=_hall(index, halls), devices=attached.get(name, ()))
        for index, name in enumerate(names[Tier.EDGE])
    ]
    made += [cloud(name, devices=attached.get(name, ())) for name in names[Tier.CLOUD]]
    return Topology(made)


def apply(cp: ControlPlane, nodes: Iterable[SimulatedNode]) -> None:
    """Create the nodes, Ready and free of the not-ready taint; existing ones get the wanted labels, taints and status."""
    cp.api.each(lambda node: _apply_one(cp, node), nodes)


def remove(cp: ControlPlane, nodes: Iterable[SimulatedNode]) -> None:
    """The nodes and their telemetry, as far as they exist."""
    cp.api.each(
        lambda path: _delete(cp, path), [f"{kind}/{node.name}" for node in nodes for kind in (_NODES, TELEMETRY)]
    )


def _delete(cp: ControlPlane, path: str) -> None:
    try:
        cp.api.delete(path)
    except ApiStatusError as error:
        if error.status != 404:
            raise


def _apply_one(cp: ControlPlane, node: SimulatedNode) -> None:
    manifest = node.manifest()
    path = f"{_NODES}/{node.name}"
    try:
        stored: dict[str, Any] = cp.api.create(_NODES, manifest)
    except ApiStatusError as error:
        if error.status != 409:
            raise
        stored = cp.api.patch(path, {"metadata": manifest["metadata"]})
        cp.api.patch(f"{path}/status", {"status": manifest["status"]})
    if stored["spec"].get("taints", []) != manifest["spec"]["taints"]:  # admission taints every new node as not ready
        cp.api.patch(path, {"spec": manifest["spec"]})


def _names(tier: Tier, wanted: int | Sequence[str]) -> list[str]:
    return [f"{tier}-{number + 1}" for number in range(wanted)] if isinstance(wanted, int) else list(wanted)


def _hall(index: int, halls: int) -> str:
    return f"hall-{index % halls + 1}"
