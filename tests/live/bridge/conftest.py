"""One stage for the bridge's live tests: a robot with hardware, edge and cloud, operator and scheduler, and a user with the editor's role alone."""

import json
import secrets
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest

from campaigns.rigs.live import PATIENCE_S, eventually, pool
from rigel_bridge.main import main
from robotapp_claims.protocol.sweep_snapshot import DEFAULT_QUARANTINE_S
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.nodes import Device, cloud, edge, robot
from robotapp_testbed.machines.telemetry import SimulatedTelemetry

USER = "tenant"
_HARDWARE = (
    Device(id="cam", type="usb", model="cam", identity="8086:0b3a"),
    Device(id="can0", type="can", interface="can0"),
    Device(id="gpu0", type="gpu", model="nvidia", interface="pcie"),
)
_LABELS = {"hardware.robotics.io/gpu": "nvidia", "disk": "ssd"}
NODES = topology.Topology(
    [
        robot("amr-07", devices=_HARDWARE, labels=_LABELS),
        edge("edge-1", devices=_HARDWARE, labels=_LABELS),
        cloud("cloud-1"),
    ]
)


@dataclass(frozen=True)
class Stage:
    """One namespace in which the user `tenant` holds the role `robotapp-editor` and nothing else."""

    plane: ControlPlane
    namespace: str
    pool: str
    """A pool of domains whose ids come back at once."""

    def run(self, verb: str, *arguments: str, identity: str = USER) -> int:
        """`rigel-bridge VERB` in this process, as that user."""
        return main([verb, *arguments, "-n", self.namespace, *self.cluster(identity)])

    def cluster(self, identity: str = USER) -> list[str]:
        return [f"--kubeconfig={self.plane.kubeconfig(identity)}", f"--kubectl={self.plane.bin_dir / 'kubectl'}"]

    def app(self, name: str) -> dict[str, Any]:
        found: dict[str, Any] = self.plane.api.get(self._path(name))
        return found

    def apps(self) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = self.plane.api.get(self._path(""))["items"]
        return items

    def edit(self, name: str, spec: dict[str, Any]) -> None:
        self.plane.api.patch(self._path(name), {"spec": spec})

    def listed(self, kind: str) -> list[dict[str, Any]]:
        text = self.plane.kubectl("get", kind, "-n", self.namespace, "-o", "json")
        items: list[dict[str, Any]] = json.loads(text)["items"]
        return items

    def gone(self, name: str) -> None:
        """Waits until no claim names the app any more. An id of the default pool rests before that."""
        patience_s = DEFAULT_QUARANTINE_S + PATIENCE_S
        eventually(lambda: not self.claims(name), timeout_s=patience_s, what=lambda: self.claims(name))

    def claims(self, name: str) -> list[str]:
        items = self.plane.api.get("/apis/robotics.io/v1alpha1/robotclaims")["items"]
        holders = [(item["metadata"]["name"], item["spec"]["holder"]) for item in items]
        return [claim for claim, who in holders if (who["namespace"], who["name"]) == (self.namespace, name)]

    def _path(self, name: str) -> str:
        return f"/apis/robotics.io/v1alpha1/namespaces/{self.namespace}/robotapps/{name}".rstrip("/")


@pytest.fixture(scope="module")
def stage(installed_plane: ControlPlane) -> Iterator[Stage]:
    plane, mark = installed_plane, secrets.token_hex(2)
    with ExitStack() as stack:
        topology.apply(plane, NODES)
        stack.callback(topology.remove, plane, NODES)
        stack.enter_context(SimulatedTelemetry(plane, NODES))
        ids = stack.enter_context(pool(plane, f"pool-{mark}"))
        namespace = stack.enter_context(created(plane, f"bridge-{mark}"))
        role = ("--clusterrole=robotapp-editor", f"--user={USER}", "-n", namespace)
        plane.kubectl("create", "rolebinding", USER, *role)
        programs = [
            product.start_operator(plane, name=f"operator-{mark}", sweep_seconds=1, no_leader_election=True),
            product.start_scheduler(plane, name=f"scheduler-{mark}", sweep_seconds=1),
        ]
        for program in programs:
            stack.callback(program.stop)
        yield Stage(plane, namespace, ids)
