"""The five scenarios of the reference applications: their nodes, where their components may go, and the thesis' figures. Pure."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
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


class Fault(StrEnum):
    """What happens to an application while it works, by the name that `--fault` takes."""

    LINK_CUT = "link-cut"
    ROBOT_OFFLINE = "robot-offline"
    POD_KILLED = "pod-killed"
    ROBOT_KILLED = "robot-killed"
    MASTER_KILLED = "master-killed"
    """Of ROS 1."""
    SENSOR_UNPLUGGED = "sensor-unplugged"


OUTAGES_S: Final = {Fault.LINK_CUT: 10.0, Fault.ROBOT_OFFLINE: 60.0, Fault.SENSOR_UNPLUGGED: 11.0}
"""How long a fault lasts. A killed pod is replaced at once; a sensor that is back within 10 s restarts nothing."""


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
    these applications show is work on another node. `nodes` are the real ones, no more than the app needs. `faults` are those of
    which the README promises something, first the application's own. `killed` is the component whose pod is killed.
    `volume_node` has the volume of the app's claim.
    """

    name: str
    title: str
    plugins: Mapping[int, tuple[str, ...]]
    thesis_profile: Inferred
    faults: tuple[Fault, ...]
    nodes: tuple[SimulatedNode, ...]
    runs_on: Mapping[str, tuple[str, ...]]
    killed: str = ""
    volume_node: str = ""
    has_driver: bool = False

    def app(self, ros: int) -> str:
        """Returns the name of the application, which is that of its folder."""
        return f"{self.name}-ros{ros}"

    def describe_fault(self, fault: Fault, outage_s: float) -> str:
        """Returns the fault as it is written in tables, such as `link cut 10 s`."""
        pod_owners = {Fault.POD_KILLED: self.killed, Fault.ROBOT_KILLED: "robot", Fault.MASTER_KILLED: "master"}
        return (
            f"{pod_owners[fault]}'s pod killed" if fault in pod_owners else f"{fault.replace('-', ' ')} {outage_s:g} s"
        )

    def list_faults(self, ros: int) -> list[Fault]:
        """Returns the faults of one generation: ROS 2 has no master."""
        return [fault for fault in self.faults if ros == 1 or fault is not Fault.MASTER_KILLED]

    def list_hosts(self, names: Collection[str]) -> list[str]:
        """Returns which nodes of a cluster may get pods of the application: robots of other applications may not."""
        return sorted({*(node.name for node in self.nodes), EDGE, CLOUD} & {*names})


def merge_nodes(scenarios: Sequence[Scenario], others: Sequence[SimulatedNode] = ()) -> list[SimulatedNode]:
    """Returns the nodes of several scenarios in one cluster; one that several have has the devices of all."""
    nodes = {node.name: node for scenario in scenarios for node in scenario.nodes if node.devices}
    for node in [*(node for scenario in scenarios for node in scenario.nodes), *others]:
        nodes.setdefault(node.name, node)
    return list(nodes.values())


def list_delays(names: Collection[str]) -> dict[tuple[str, str], float]:
    """Returns the delays, one way and in ms, between all pairs of real nodes that are not both robots."""
    robots = sorted({*names} - {EDGE, CLOUD})
    delays = {(name, EDGE): ROBOT_TO_EDGE_MS for name in robots if EDGE in names}
    delays |= {(name, CLOUD): ROBOT_TO_CLOUD_MS for name in robots if CLOUD in names}
    return delays | ({(EDGE, CLOUD): EDGE_TO_CLOUD_MS} if {EDGE, CLOUD} <= {*names} else {})


def _plugins(*names: str) -> dict[int, tuple[str, ...]]:
    return dict.fromkeys(GENERATIONS, names)


_EDGE_NODE: Final = edge(EDGE, zone=EDGE_ZONE)
_CLOUD_NODE: Final = cloud(CLOUD, zone=CLOUD_ZONE)
OFF_BOARD_NODES: Final = (_EDGE_NODE, _CLOUD_NODE)
"""In a cluster that compares schedulers both may be chosen, whatever the application."""
_OFF_BOARD: Final = ("Edge", "Cloud")
_ALL: Final = (
    Scenario(
        "teleop",
        "Teleoperation",
        _plugins("LatencyFilter", "LatencyScore", "DeadlineScore"),
        Inferred("realtime", "realtime", "none", "none"),
        (Fault.LINK_CUT, Fault.ROBOT_OFFLINE, Fault.POD_KILLED, Fault.MASTER_KILLED),
        (robot(ROBOT), _EDGE_NODE, _CLOUD_NODE),
        {"operator": _OFF_BOARD},
        killed="operator",
    ),
    Scenario(
        "navigation",
        "Cloud Autonomous",
        _plugins("LatencyFilter", "LatencyScore", "TopologyScore"),
        Inferred("best_effort", "sensor_data", "none", "none"),
        (Fault.ROBOT_OFFLINE, Fault.LINK_CUT, Fault.POD_KILLED, Fault.MASTER_KILLED),
        (robot(ROBOT), _CLOUD_NODE),
        {},
        killed="planner",
    ),
    Scenario(
        "usb-sensor",
        "Industrial USB Sensor",
        _plugins("HardwareAffinityFilter", "LatencyFilter"),
        Inferred("sensor_data", "sensor_data", "usb", "usb"),
        (Fault.SENSOR_UNPLUGGED,),
        (robot(ROBOT, devices=[SENSOR]), _EDGE_NODE),
        {"listener": _OFF_BOARD},
        has_driver=True,
    ),
    Scenario(
        "fleet",
        "Multi-Robot Fleet",
        {1: ("TopologyScore",), 2: ("TopologyScore", "SharedDataFilter", "LatencyFilter")},
        Inferred("best_effort", "realtime", "none", "none"),
        (Fault.POD_KILLED, Fault.ROBOT_OFFLINE, Fault.ROBOT_KILLED),
        (*(robot(name) for name in FLEET), _EDGE_NODE),
        {},
        killed="coordinator",
        volume_node=EDGE,
    ),
    Scenario(
        "detection",
        "Object Detection",
        _plugins("HardwareAffinityFilter", "LatencyFilter", "LatencyScore"),
        Inferred("sensor_data", "sensor_data", "gpu", "gpu"),
        (Fault.POD_KILLED, Fault.ROBOT_OFFLINE, Fault.MASTER_KILLED),
        (robot(ROBOT), _EDGE_NODE),
        {"detector": _OFF_BOARD},
        killed="detector",
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


THESIS_ROUND_TRIPS: Final = {
    KUBE_SCHEDULER.name: RoundTrips("default-scheduler", "minikube-m02", 1101, 0.71, 1.01, 3.41),
    OURS.name: RoundTrips("kubernetes-scheduler", "minikube-m02", 1034, 0.66, 0.98, 1.56),
}
"""By the scheduler of ours that stands in its place. The thesis has figures of no other application."""
THESIS_REPETITIONS: Final = 3
"""The thesis deployed each application three times (4.4) and placed all of them correctly with its own scheduler."""
