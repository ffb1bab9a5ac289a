"""The random cluster of one repetition: nodes of three zones, some with hardware, each with some load. Pure."""

import math
import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from robotapp_testbed.machines.nodes import Device, SimulatedNode, cloud, edge

Json = dict[str, Any]
LEAST_NODES: Final = 3
FIRST, SECOND, OTHER = "edge-zone-1", "edge-zone-2", "cloud-zone-1"
GPU: Final = Device("gpu-0", "gpu", model="nvidia")
CAN: Final = Device("can-can0", "can", interface="can0")
CAMERA: Final = "hardware.robotics.io/sensor-usb-cam"
MOST_IN_AN_EDGE_ZONE: Final = 4
"""So that the pods of one scenario can fill such a zone."""
MOST_LOAD: Final = 0.45
"""Largest share of a node's processors, and of its memory, that load takes: every node has room for some pods."""
MILLI, MIB_PER_CPU = 1000, 2048
"""A node has two GiB of memory for each processor."""


@dataclass(frozen=True, slots=True)
class Room:
    """What pods request, or what is left on a node."""

    cpu_m: int
    memory_mib: int

    @property
    def requests(self) -> dict[str, str]:
        return {"cpu": f"{self.cpu_m}m", "memory": f"{self.memory_mib}Mi"}


@dataclass(frozen=True, slots=True)
class Cluster:
    """`load` is what pods that are bound beforehand request, by node name."""

    nodes: tuple[SimulatedNode, ...]
    load: Mapping[str, Room]

    def in_zone(self, zone: str) -> list[str]:
        return [node.name for node in self.nodes if node.zone == zone]

    def zone_of(self, name: str) -> str:
        return next((node.zone for node in self.nodes if node.name == name), "")

    def labelled(self, key: str, value: str = "true") -> list[str]:
        return [node.name for node in self.nodes if node.all_labels().get(key) == value]

    def places(self, names: Iterable[str], pod: Room) -> int:
        """How many such pods fit on these nodes together."""
        return sum(self._places(node, pod) for node in self.nodes if node.name in set(names))

    def _places(self, node: SimulatedNode, pod: Room) -> int:
        cpus, used = int(node.cpu), self.load[node.name]
        cpu_m = cpus * MILLI - used.cpu_m
        memory_mib = cpus * MIB_PER_CPU - used.memory_mib
        return max(0, min(math.floor(cpu_m / pod.cpu_m), math.floor(memory_mib / pod.memory_mib)))


def draw(rng: random.Random, *, most_nodes: int, mark: str) -> Cluster:
    """Three to `most_nodes` nodes, small clusters as often as large ones of twice the size; names begin with `mark`."""
    count = round(math.exp(rng.uniform(math.log(LEAST_NODES), math.log(most_nodes))))
    zones = _zones(rng, count)
    with_gpu = set(rng.sample(range(count), rng.randint(1, max(1, count // 4))))
    with_can, with_camera = rng.randrange(count), rng.randrange(count)
    nodes = []
    for index, zone in enumerate(zones):
        devices = [*([GPU] if index in with_gpu else []), *([CAN] if index == with_can else [])]
        labels = {CAMERA: "true"} if index == with_camera else {}
        nodes.append(_node(f"{mark}-{index:03}", zone, devices, labels, cpus=rng.choice((4, 8, 16))))
    rng.shuffle(nodes)
    return Cluster(tuple(nodes), {node.name: _load(rng, node) for node in nodes})


def _zones(rng: random.Random, count: int) -> list[str]:
    """One zone per node; each of the three has one."""
    most = min(MOST_IN_AN_EDGE_ZONE, count // 3)
    first, second = rng.randint(1, most), rng.randint(1, most)
    return [FIRST] * first + [SECOND] * second + [OTHER] * (count - first - second)


def _node(name: str, zone: str, devices: Sequence[Device], labels: Mapping[str, str], *, cpus: int) -> SimulatedNode:
    make = cloud if zone == OTHER else edge
    return make(name, zone=zone, devices=devices, labels=labels, cpu=str(cpus), memory=f"{cpus * MIB_PER_CPU}Mi")


def _load(rng: random.Random, node: SimulatedNode) -> Room:
    cpus = int(node.cpu)
    return Room(
        int(rng.uniform(0, MOST_LOAD) * cpus * MILLI),
        int(rng.uniform(0, MOST_LOAD) * cpus * MIB_PER_CPU),
    )
