"""A fleet that is only written down: nodes, telemetry, and an app with its instance for each robot. No operator, no scheduler."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from robotapp_api.model.names import API_VERSION
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.network import Topology

NAMESPACE: Final = "default"
HALLS: Final = 20
COMPONENTS: Final = ("driver", "perception", "planner")
_COLLECTION: Final = f"/apis/{API_VERSION}/namespaces/{NAMESPACE}"
_CONDITIONS: Final = ("Accepted", "Allocated", "Placed", "BudgetMet", "Ready")
_TIME: Final = "2026-01-01T00:00:00Z"


@dataclass(frozen=True, slots=True)
class MadeFleet:
    """The robots by name; `topology` has their nodes and one edge server per hall."""

    robots: tuple[str, ...]
    topology: Topology

    def write(self, cp: ControlPlane) -> None:
        """Defines our kinds and writes all objects except telemetry."""
        crds = [obj for path in sorted(product.CRDS.glob("*.yaml")) for obj in product.objects_of(path.read_text())]
        product.define(cp, crds)
        topology.apply(cp, self.topology)
        cp.api.each(lambda robot: _write_app(cp, robot), self.robots)

    def set_phase(self, cp: ControlPlane, robot: str, phase: str) -> None:
        """Changes what the instance on this robot is doing."""
        path = f"{_COLLECTION}/robotappinstances/{name_app(robot)}/status"
        cp.api.patch(path, {"status": {"phase": phase}})


def make_fleet(count: int) -> MadeFleet:
    """Returns a fleet of so many robots."""
    robots = tuple(f"robot-{number:04}" for number in range(count))
    edges = tuple(f"edge-{number:02}" for number in range(HALLS))
    return MadeFleet(robots, topology.fleet(robots, edges, 1))


def name_app(robot: str) -> str:
    """Returns the name of the robot's app, and of its only instance."""
    return f"drive-{robot}"


def _write_app(cp: ControlPlane, robot: str) -> None:
    name = name_app(robot)
    app = cp.api.create(f"{_COLLECTION}/robotapps", _make_app(name, robot))
    cp.api.patch(f"{_COLLECTION}/robotapps/{name}/status", {"status": _make_app_status()})
    uid = app["metadata"]["uid"]
    cp.api.create(f"{_COLLECTION}/robotappinstances", _make_instance(name, robot, uid))
    cp.api.patch(f"{_COLLECTION}/robotappinstances/{name}/status", {"status": _make_instance_status(robot)})


def _make_app(name: str, robot: str) -> Mapping[str, Any]:
    components = [{"name": component, "image": "ros:humble"} for component in COMPONENTS]
    edge = {"topic": "/points", "type": "sensor_msgs/msg/PointCloud2", "from": "driver", "to": "perception"}
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": name},
        "spec": {
            "ros": {"distro": "humble"},
            "robots": {"nodeSelector": {"matchLabels": {"robotics.io/robot": robot}}},
            "components": components,
            "edges": [edge | {"latency": {"budget": "30ms"}}],
        },
    }


def _make_conditions() -> list[Mapping[str, Any]]:
    common = {"status": "True", "reason": "Fine", "message": "", "lastTransitionTime": _TIME}
    return [common | {"type": kind} for kind in _CONDITIONS]


def _make_app_status() -> Mapping[str, Any]:
    return {"phase": "Running", "observedGeneration": 1, "conditions": _make_conditions()}


def _make_instance(name: str, robot: str, uid: str) -> Mapping[str, Any]:
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotAppInstance",
        "metadata": {"name": name},
        "spec": {"app": name, "appUID": uid, "instance": robot, "robot": robot},
    }


def _make_instance_status(robot: str) -> Mapping[str, Any]:
    components = [{"name": component, "node": robot, "ready": True} for component in COMPONENTS]
    return {"phase": "Running", "conditions": _make_conditions(), "components": components}
