"""Simulated nodes: robots, edge servers and cloud machines as Node objects with status. Pure."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from robotapp_api.model.names import HARDWARE_PREFIX, Label
from robotapp_testbed.control_plane.components import SIMULATED_BY_KWOK

_CREATED = "2024-01-01T00:00:00Z"  # the age of a condition is of no interest; a fixed text keeps manifests equal


class Tier(StrEnum):
    ROBOT = "robot"
    EDGE = "edge"
    CLOUD = "cloud"


@dataclass(frozen=True, slots=True)
class Device:
    """A device as telemetry reports it. It also gives the node its hardware label."""

    id: str
    type: str
    model: str = ""
    interface: str = ""
    identity: str = ""
    path: str = ""

    @property
    def label(self) -> tuple[str, str]:
        """`hardware.robotics.io/<type>[-<interface>]` and `<model|true>`."""
        suffix = f"-{self.interface}" if self.interface else ""
        return f"{HARDWARE_PREFIX}{self.type}{suffix}", self.model or "true"


@dataclass(frozen=True, slots=True)
class SimulatedNode:
    name: str
    tier: Tier
    zone: str
    cpu: str
    memory: str
    arch: str = "amd64"
    pods: int = 110
    robot: str = ""
    devices: tuple[Device, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict)
    annotations: Mapping[str, str] = field(default_factory=dict)
    taints: Sequence[Mapping[str, str]] = ()
    extended_resources: Mapping[str, str] = field(default_factory=dict)
    realtime: bool = False

    def all_labels(self) -> dict[str, str]:
        standard: dict[str, str] = {
            Label.SIMULATED: SIMULATED_BY_KWOK,
            Label.TIER: self.tier,
            Label.ZONE: self.zone,
            Label.HOSTNAME: self.name,
            "kubernetes.io/os": "linux",
            "kubernetes.io/arch": self.arch,
        }
        if self.robot:
            standard[Label.ROBOT] = self.robot
        hardware = dict(device.label for device in self.devices)
        return {str(key): str(value) for key, value in {**standard, **hardware, **self.labels}.items()}

    def manifest(self) -> dict[str, Any]:
        metadata = {"name": self.name, "labels": self.all_labels(), "annotations": dict(self.annotations)}
        return {
            "apiVersion": "v1",
            "kind": "Node",
            "metadata": metadata,
            "spec": {"taints": [dict(taint) for taint in self.taints]},
            "status": self.status(),
        }

    def status(self) -> dict[str, Any]:
        resources = {"cpu": self.cpu, "memory": self.memory, "pods": str(self.pods), **self.extended_resources}
        return {
            "phase": "Running",
            "capacity": resources,
            "allocatable": resources,
            "addresses": [
                {"type": "InternalIP", "address": _address(self.name)},
                {"type": "Hostname", "address": self.name},
            ],
            "conditions": [_condition("Ready", "True"), *(_condition(kind, "False") for kind in _PRESSURES)],
            "nodeInfo": {**_NODE_INFO, "architecture": self.arch},
        }


_PRESSURES = ("MemoryPressure", "DiskPressure", "PIDPressure", "NetworkUnavailable")
_NODE_INFO = {
    "operatingSystem": "linux",
    "kubeletVersion": "kwok",
    "kernelVersion": "simulated",
    "osImage": "simulated",
    "containerRuntimeVersion": "kwok://0",
    "bootID": "",
    "kubeProxyVersion": "",
    "machineID": "",
    "systemUUID": "",
}


def robot(
    name: str = "robot-1", *, zone: str = "hall-1", devices: Sequence[Device] = (), **changes: Any
) -> SimulatedNode:
    """The computer of robot `name`. `changes` are fields of SimulatedNode."""
    defaults = {"cpu": "4", "memory": "8Gi", "arch": "arm64", "robot": name}
    return SimulatedNode(name=name, tier=Tier.ROBOT, zone=zone, devices=tuple(devices), **{**defaults, **changes})


def edge(
    name: str = "edge-1", *, zone: str = "hall-1", devices: Sequence[Device] = (), **changes: Any
) -> SimulatedNode:
    """A server beside the robots."""
    return SimulatedNode(
        name=name, tier=Tier.EDGE, zone=zone, devices=tuple(devices), **{"cpu": "16", "memory": "64Gi", **changes}
    )


def cloud(
    name: str = "cloud-1", *, zone: str = "cloud", devices: Sequence[Device] = (), **changes: Any
) -> SimulatedNode:
    """A machine in a data centre."""
    return SimulatedNode(
        name=name, tier=Tier.CLOUD, zone=zone, devices=tuple(devices), **{"cpu": "64", "memory": "256Gi", **changes}
    )


def _condition(kind: str, status: str) -> dict[str, str]:
    times = {"lastHeartbeatTime": _CREATED, "lastTransitionTime": _CREATED}
    return {"type": kind, "status": status, "reason": "Simulated", "message": "simulated by kwok", **times}


def _address(name: str) -> str:
    number = zlib.crc32(name.encode())
    return f"10.{128 + (number >> 16) % 64}.{(number >> 8) % 256}.{number % 254 + 1}"
