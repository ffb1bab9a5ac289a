"""A stand-in for the node agents: writes the NodeTelemetry of every simulated node, labelled as simulated."""

import functools
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isinf
from types import TracebackType
from typing import Any, Self

from robotapp_api.model.names import API_VERSION, Label
from robotapp_api.model.telemetry import node_owner
from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.failures import ApiStatusError, TestbedError
from robotapp_testbed.machines.heartbeat import Heartbeat
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import Device

PATH = f"/apis/{API_VERSION}/nodetelemetries"
_NODES = "/api/v1/nodes"
PEER_LIMIT = 64
_SHORTEST_INTERVAL_S = 10
_NODES_PER_INTERVAL_SECOND = 50


@dataclass
class _Agent:
    """What one node's agent would know."""

    absent: set[str] = field(default_factory=set)
    load: dict[str, int] = field(default_factory=dict)
    sequence: int = 0
    silent: bool = False


class SimulatedTelemetry:
    """Writes at once whatever is changed through it, and everything again as heartbeat while it runs.

    A round trip has no jitter, unless it is given some: median and 95th percentile are the value of the topology.
    """

    def __init__(self, cp: ControlPlane, topology: Topology, *, interval_s: int | None = None) -> None:
        self._cp = cp
        self._topology = topology
        self._interval_s = interval_s or max(_SHORTEST_INTERVAL_S, len(topology) // _NODES_PER_INTERVAL_SECOND)
        self._agents = {node.name: _Agent() for node in topology}
        self._p95_ms: dict[frozenset[str], float] = {}
        self._lock = threading.Lock()
        self._heart = Heartbeat("simulated telemetry", self.write, interval_s=self._interval_s)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self) -> Self:
        """Write all objects, then keep the heartbeat."""
        uids = node_uids(self._cp)
        self._cp.api.each(lambda name: self._create(name, uids.get(name, "")), self._agents)
        self.write()
        self._heart.start()
        return self

    def stop(self) -> None:
        """No more heartbeats; the objects stay, and age."""
        self._heart.stop()

    def set_rtt(self, one: str, other: str, value_ms: float) -> None:
        """Infinite: no probe between the two is answered."""
        self._topology.set_rtt(one, other, value_ms)
        self.write(one, other)

    def set_p95(self, one: str, other: str, value_ms: float | None) -> None:
        """The 95th percentile of this pair, where it is another one than the median; None: it is the median again."""
        pair = frozenset((one, other))
        if value_ms is None:
            self._p95_ms.pop(pair, None)
        else:
            self._p95_ms[pair] = value_ms
        self.write(one, other)

    def unplug(self, node: str, device_id: str) -> None:
        self._agents[node].absent.add(self._device(node, device_id).id)
        self.write(node)

    def plug(self, node: str, device_id: str) -> None:
        self._agents[node].absent.discard(self._device(node, device_id).id)
        self.write(node)

    def set_load(self, node: str, **percent: int) -> None:
        """`cpu`, `memory` and `gpu`, in whole percent."""
        self._agents[node].load.update(percent)
        self.write(node)

    def silence(self, node: str) -> None:
        """The node's agent stops writing, as if it had crashed."""
        self._agents[node].silent = True

    def speak(self, node: str) -> None:
        self._agents[node].silent = False
        self.write(node)

    def write(self, *names: str) -> None:
        """Write the status of these nodes, or of all, now."""
        probes = self._probes()
        wanted = [name for name in names or self._agents if not self._agents[name].silent]
        self._cp.api.each(lambda name: self._write_one(name, probes.get(name, ())), wanted)

    def status(self, name: str, *, asked: Iterable[str] = ()) -> dict[str, Any]:
        """The status an agent on this node would write; `asked` are the peers its object asks to measure."""
        agent, node = self._agents[name], self._topology.node(name)
        status: dict[str, Any] = {
            "intervalSeconds": self._interval_s,
            "seq": agent.sequence,
            "arch": node.arch,
            "kernel": {"realtime": node.realtime},
            "devices": [
                _device_status(
                    device, present=device.id not in agent.absent, is_usb=device in first_of_usb(node.devices)
                )
                for device in node.devices
            ],
            "rtt": [self._rtt_status(name, peer) for peer in self._peers(name, asked)],
        }
        if agent.load:
            status["load"] = {f"{kind}Percent": value for kind, value in agent.load.items()}
        return status

    def _create(self, name: str, uid: str) -> None:
        create(self._cp, name, uid=uid, labels={Label.SIMULATED: "true"})

    def _write_one(self, name: str, asked: Iterable[str]) -> None:
        with self._lock:
            self._agents[name].sequence += 1
            status = self.status(name, asked=asked)
        try:
            self._cp.api.patch(f"{PATH}/{name}/status", {"status": status})
        except ApiStatusError as error:
            if error.status != 404:
                raise
            self._begin_again(name, status)

    def _begin_again(self, name: str, status: Mapping[str, Any]) -> None:
        """The object went with its node: a node that came back has an agent again."""
        try:
            uid = self._cp.api.get(f"{_NODES}/{name}")["metadata"]["uid"]
        except ApiStatusError as error:
            if error.status != 404:
                raise
            return
        self._create(name, uid)
        self._cp.api.patch(f"{PATH}/{name}/status", {"status": status})

    def _probes(self) -> Mapping[str, list[str]]:
        items = self._cp.api.get(PATH)["items"]
        return {item["metadata"]["name"]: item.get("spec", {}).get("probe", []) for item in items}

    def _peers(self, name: str, asked: Iterable[str]) -> list[str]:
        """All others while they fit; else those asked for, one of each zone, and the own zone."""
        if len(self._topology) <= PEER_LIMIT + 1:
            return [node.name for node in self._topology if node.name != name]
        wanted = [peer for peer in asked if peer in self._topology.nodes]
        for members in self._zones.values():
            wanted += members[:1] if members[0] != name else members[1:2]
        wanted += self._zones[self._topology.node(name).zone]
        return [peer for peer in dict.fromkeys(wanted) if peer != name][:PEER_LIMIT]

    @functools.cached_property
    def _zones(self) -> Mapping[str, list[str]]:
        """Names of the nodes of each zone."""
        found: dict[str, list[str]] = {}
        for node in self._topology:
            found.setdefault(node.zone, []).append(node.name)
        return found

    def _rtt_status(self, name: str, peer: str) -> dict[str, Any]:
        value_ms, seq = self._topology.rtt_ms(name, peer), self._agents[name].sequence
        if isinf(value_ms):
            return {"peer": peer, "lossPPM": 1_000_000, "seq": seq}
        value_us, p95_us = (round(ms * 1000) for ms in (value_ms, self._p95_ms.get(frozenset((name, peer)), value_ms)))
        return {"peer": peer, "p50Us": value_us, "p95Us": p95_us, "lossPPM": 0, "seq": seq}

    def _device(self, node: str, device_id: str) -> Device:
        devices = self._topology.node(node).devices
        for device in devices:
            if device.id == device_id:
                return device
        raise TestbedError(
            f"{node} has no device {device_id!r}, it has {', '.join(each.id for each in devices) or 'none'}"
        )


def node_uids(cp: ControlPlane) -> dict[str, str]:
    """By name."""
    return {node["metadata"]["name"]: node["metadata"].get("uid", "") for node in cp.api.get(_NODES)["items"]}


def create(cp: ControlPlane, name: str, *, uid: str, labels: Mapping[str, str]) -> None:
    """The NodeTelemetry of one node, without a status, owned by the node of this uid ("": by none); one that is there stays."""
    owners = [node_owner(name=name, uid=uid)] if uid else []
    metadata = {"name": name, "labels": dict(labels), "ownerReferences": owners}
    try:
        cp.api.create(PATH, {"apiVersion": API_VERSION, "kind": "NodeTelemetry", "metadata": metadata})
    except ApiStatusError as error:
        if error.status != 409:
            raise


def first_of_usb(devices: Iterable[Device]) -> tuple[Device, ...]:
    """The first function of every USB device, which an agent names `usb` as well."""
    return tuple({device.identity: device for device in reversed(list(devices)) if device.identity}.values())


def _device_status(device: Device, *, present: bool, is_usb: bool) -> dict[str, Any]:
    texts = {"model": device.model, "interface": device.interface, "identity": device.identity, "path": device.path}
    return {
        "id": device.id,
        "type": device.type,
        "present": present,
        **({"names": ["usb"]} if is_usb and device.type != "usb" else {}),
        **{key: value for key, value in texts.items() if value},
    }
