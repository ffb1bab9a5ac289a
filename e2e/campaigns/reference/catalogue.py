"""The five scenarios of the reference applications: their nodes, where their components may go, and the thesis' figures. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from campaigns.scenarios.contenders import KUBE_SCHEDULER, OURS, Contender
from robotapp_testbed.machines.nodes import Device, SimulatedNode, cloud, edge, robot

GENERATIONS: Final = (1, 2)
"""Of ROS."""
SCHEDULERS: Final[tuple[Contender, ...]] = (OURS, KUBE_SCHEDULER)
ROBOT, EDGE, CLOUD = "amr-07", "edge-1", "cloud-1"
FLEET: Final = ("amr-01", "amr-02", "amr-03")
EDGE_ZONE, CLOUD_ZONE = "edge-zone-1", "cloud-zone-1"
SENSOR: Final = Device("serial-0403-6001-a50285bi", "serial", model="thermometer", identity="0403:6001:A50285BI")
ROBOT_TO_EDGE_MS, ROBOT_TO_CLOUD_MS, EDGE_TO_CLOUD_MS = 2.0, 30.0, 28.0
"""One way. A round trip to the cloud takes longer than the 30 ms of teleop, and less than the 80 and 150 ms of the others."""


@dataclass(frozen=True, slots=True)
class Inferred:
    """Class and hardware that a profile generator infers of a package, and those that its Rigelfile expects (thesis, table 4.3)."""

    qos_class: str
    expected_class: str
    hardware: str
    expected_hardware: str


@dataclass(frozen=True, slots=True)
class Scenario:
    """An application of both generations of ROS.

    `plugins` are what the thesis' table 4.1 says that it exercises, by generation. `runs_on` keeps components off the robot: what
    these applications show is work on another node. `nodes` are the real ones, no more than the app needs: each imports its image
    of up to 650 MB. `volume_node` has the volume of the app's claim.
    """

    name: str
    title: str
    plugins: Mapping[int, tuple[str, ...]]
    thesis_profile: Inferred
    fault: str
    nodes: tuple[SimulatedNode, ...]
    runs_on: Mapping[str, tuple[str, ...]]
    volume_node: str = ""
    has_driver: bool = False

    @property
    def delays(self) -> dict[tuple[str, str], float]:
        """One way, in ms, between all pairs of nodes that are not both robots."""
        near, far = [node.name for node in self.nodes if node.name not in (EDGE, CLOUD)], {n.name for n in self.nodes}
        delays = {(name, EDGE): ROBOT_TO_EDGE_MS for name in near if EDGE in far}
        delays |= {(name, CLOUD): ROBOT_TO_CLOUD_MS for name in near if CLOUD in far}
        return delays | ({(EDGE, CLOUD): EDGE_TO_CLOUD_MS} if {EDGE, CLOUD} <= far else {})

    def app(self, ros: int) -> str:
        """Returns the name of the application, which is that of its folder."""
        return f"{self.name}-ros{ros}"


def _plugins(*names: str) -> dict[int, tuple[str, ...]]:
    return dict.fromkeys(GENERATIONS, names)


_EDGE_NODE: Final = edge(EDGE, zone=EDGE_ZONE)
_CLOUD_NODE: Final = cloud(CLOUD, zone=CLOUD_ZONE)
_OFF_BOARD: Final = ("Edge", "Cloud")
_ALL: Final = (
    Scenario(
        "teleop",
        "Teleoperation",
        _plugins("LatencyFilter", "LatencyScore", "DeadlineScore"),
        Inferred("realtime", "realtime", "none", "none"),
        "link cut 10 s",
        (robot(ROBOT), _EDGE_NODE, _CLOUD_NODE),
        {"operator": _OFF_BOARD},
    ),
    Scenario(
        "navigation",
        "Cloud Autonomous",
        _plugins("LatencyFilter", "LatencyScore", "TopologyScore"),
        Inferred("best_effort", "sensor_data", "none", "none"),
        "robot offline",
        (robot(ROBOT), _CLOUD_NODE),
        {},
    ),
    Scenario(
        "usb-sensor",
        "Industrial USB Sensor",
        _plugins("HardwareAffinityFilter", "LatencyFilter"),
        Inferred("sensor_data", "sensor_data", "usb", "usb"),
        "sensor unplugged 11 s",
        (robot(ROBOT, devices=[SENSOR]), _EDGE_NODE),
        {"listener": _OFF_BOARD},
        has_driver=True,
    ),
    Scenario(
        "fleet",
        "Multi-Robot Fleet",
        {1: ("TopologyScore",), 2: ("TopologyScore", "SharedDataFilter", "LatencyFilter")},
        Inferred("best_effort", "realtime", "none", "none"),
        "coordinator's pod killed",
        (*(robot(name) for name in FLEET), _EDGE_NODE),
        {},
        volume_node=EDGE,
    ),
    Scenario(
        "detection",
        "Object Detection",
        _plugins("HardwareAffinityFilter", "LatencyFilter", "LatencyScore"),
        Inferred("sensor_data", "sensor_data", "gpu", "gpu"),
        "detector's pod killed",
        (robot(ROBOT), _EDGE_NODE),
        {"detector": _OFF_BOARD},
    ),
)
SCENARIOS: Final = {scenario.name: scenario for scenario in _ALL}
"""By the name that `--app` takes, in the order of the thesis."""


@dataclass(frozen=True, slots=True)
class RoundTrips:
    """A row of the thesis' table 4.2: teleoperation within one pod, over loopback."""

    scheduler: str
    node: str
    count: int
    mean_ms: float
    p95_ms: float
    p99_ms: float


THESIS_ROUND_TRIPS: Final = (
    RoundTrips("default-scheduler", "minikube-m02", 1101, 0.71, 1.01, 3.41),
    RoundTrips("kubernetes-scheduler", "minikube-m02", 1034, 0.66, 0.98, 1.56),
)
THESIS_REPETITIONS: Final = 3
"""The thesis deployed each application three times (4.4) and placed all of them correctly with its own scheduler."""
