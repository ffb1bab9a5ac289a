"""Robots whose nodes or labels come and go under a running fleet, and what must not change meanwhile."""

import random
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from campaigns.rigs.live import Tenant, eventually
from robotapp_api.model.names import Label
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_client.api.times import utc_now
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.components import SIMULATED_BY_KWOK
from robotapp_testbed.machines import topology

NODES: Final = "/api/v1/nodes"
EVERY_ROBOT: Final = {"nodeSelector": {"matchExpressions": [{"key": Label.ROBOT.value, "operator": "Exists"}]}}
HALF_PERIOD_S: Final = 0.5
"""Off for as long as on: labels flap at 1 Hz."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What a robot that vanishes for a while must not lose, by kind: uids of objects and ids of instances."""

    deployments: Mapping[str, tuple[str, int]]
    """Name -> uid and generation: another generation would be another template or scale."""
    pods: frozenset[str]
    domains: Mapping[str, str]
    """Claim -> instance."""

    def lost(self, now: "Seen") -> list[str]:
        """What is not any more what it was."""
        return [
            *(f"Deployment {name}" for name, was in self.deployments.items() if now.deployments.get(name) != was),
            *(f"pod {uid}" for uid in self.pods - now.pods),
            *(f"claim {name}" for name, was in self.domains.items() if now.domains.get(name) != was),
        ]


def _now() -> str:
    return whole_seconds(utc_now())


class Fleet:
    """Robots with one node each, which bears the robot's name."""

    def __init__(self, cp: ControlPlane, nodes: topology.Topology, tenant: Tenant, *, seed: int) -> None:
        self.cp = cp
        self.nodes = {node.name: node for node in nodes}
        self.tenant = tenant
        self.chance = random.Random(seed)
        self.writes = 0

    @property
    def robots(self) -> list[str]:
        return [name for name, node in self.nodes.items() if Label.ROBOT in node.manifest()["metadata"]["labels"]]

    def seen(self) -> Seen:
        deployments = {d["metadata"]["name"]: d["metadata"] for d in self.tenant.deployments()}
        return Seen(
            {name: (meta["uid"], meta["generation"]) for name, meta in deployments.items()},
            frozenset(pod["metadata"]["uid"] for pod in self.tenant.listed("pods")),
            {c["metadata"]["name"]: c["spec"]["holder"]["instance"] for c in self.tenant.claims()},
        )

    def labels(self, robots: Iterable[str], *, on: bool) -> None:
        """Put the labels of these nodes on, or take all of ours off as a tool gone wrong would."""

        def write(name: str) -> None:
            wanted = self.nodes[name].manifest()["metadata"]["labels"]
            ours = {key: value if on else None for key, value in wanted.items() if key.startswith("robotics.io/")}
            self.cp.api.patch(f"{NODES}/{name}", {"metadata": {"labels": ours}})
            self.writes += 1

        self.cp.api.each(write, list(robots))

    def flap(self, seconds: float) -> None:
        """Each robot's labels go off and on, at moments of its own; in the end all are on."""
        deadline_s = time.monotonic() + seconds
        off: set[str] = set()
        while time.monotonic() < deadline_s:
            began_s = time.monotonic()
            turning = {name for name in self.robots if self.chance.random() < 0.9}
            self.labels(turning - off, on=False)
            self.labels(turning & off, on=True)
            off ^= turning
            time.sleep(max(0.0, HALF_PERIOD_S - (time.monotonic() - began_s)))
        self.labels(off, on=True)

    def rejoin(self, robots: Iterable[str], *, after_s: float) -> None:
        """Delete these nodes, and let them join again."""
        gone = list(robots)
        self.delete(gone)
        time.sleep(after_s)
        self.bring(gone)

    def ready(self, robot: str, status: str) -> None:
        """The kubelet is silent ("Unknown") or in contact again ("True"), and its pods fare as the node controller has it."""
        simulated = SIMULATED_BY_KWOK if status == "True" else None
        self.cp.api.patch(f"{NODES}/{robot}", {"metadata": {"labels": {Label.SIMULATED.value: simulated}}})
        ready = {"type": "Ready", "status": status, "reason": "Test", "message": "", "lastTransitionTime": _now()}
        self.cp.api.patch(f"{NODES}/{robot}/status", {"status": {"conditions": [ready]}})
        lost = [{"type": kind, "status": "False"} for kind in ("Ready", "ContainersReady")]
        for pod in self.tenant.listed("pods"):
            if pod["spec"].get("nodeName") == robot and status != "True":
                path = f"/api/v1/namespaces/{self.tenant.namespace}/pods/{pod['metadata']['name']}/status"
                self.cp.api.patch(path, {"status": {"conditions": lost}})

    def delete(self, robots: Iterable[str]) -> None:
        self.cp.api.each(lambda name: self.cp.api.delete(f"{NODES}/{name}"), list(robots))

    def bring(self, robots: Iterable[str]) -> None:
        topology.apply(self.cp, [self.nodes[name] for name in robots])

    def online(self, app: str, *, robots: int | None = None) -> None:
        """Wait until the app's status knows all its robots again. robots: how many those are, else the whole fleet."""
        wanted = len(self.robots) if robots is None else robots

        def look() -> bool:
            status: dict[str, Any] = self.tenant.app(app).get("status") or {}
            counts = status.get("instanceCounts", {})
            desired = counts.get("desired")
            return desired == counts.get("ready") == wanted and not counts.get("offline")

        eventually(look, what=lambda: self.tenant.app(app).get("status"))
