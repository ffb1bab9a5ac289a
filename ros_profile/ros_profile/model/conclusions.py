"""What is concluded: per executable, per package, per launch file. Every value has evidence and a confidence."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

from ros_profile.model.endpoints import Qos
from ros_profile.model.facts import Fact, Problem


class QosClass(StrEnum):
    """The scheduling classes of components, the most demanding first."""

    REALTIME = "realtime"
    SENSOR_DATA = "sensor_data"
    SYSTEM_DEFAULT = "system_default"
    BEST_EFFORT = "best_effort"

    @property
    def rank(self) -> int:
        """0 for the most demanding class; of what runs together, the lowest rank counts."""
        return list(QosClass).index(self)


class SubClass(StrEnum):
    """Rows of the table in docs/evaluation/eo3-rules.md: what the deadline and the latency budget follow from."""

    HARDWARE_LOOP = "RT-A"
    CONTROL_LOOP = "RT-B"
    MOTION = "RT-C"
    SAFETY = "RT-D"
    OPERATOR_INPUT = "RT-E"
    INERTIAL = "SD-A"
    CAMERA = "SD-B"
    LIDAR = "SD-C"
    DETECTOR = "SD-D"
    PLANNER = "SY-A"
    FLEET = "SY-B"
    BEST_EFFORT = "BE"


class Placement(StrEnum):
    ROBOT = "robot"
    EDGE = "edge"
    CLOUD = "cloud"
    ANY = "any"


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Estimate(Generic[T]):
    """A value, how sure it is (0 to 1, calibrated: of values at .8 four of five are right), and why."""

    value: T
    confidence: float
    evidence: tuple[Fact, ...] = ()
    reason: str = ""
    """One plain sentence for --explain."""


@dataclass(frozen=True, slots=True)
class Hardware:
    """`type`: serial | usb | camera | can | gpio | gpu."""

    type: str
    model: str = ""
    interface: str = ""
    usb_id: str = ""


@dataclass(frozen=True, slots=True)
class Assessment:
    """What the classification gives for one Unit. None: not concluded (abstained)."""

    qos_class: Estimate[QosClass] | None
    sub_class: Estimate[SubClass] | None = None
    deadline_s: Estimate[float] | None = None
    latency_budget_s: Estimate[float] | None = None
    hardware: tuple[Estimate[Hardware], ...] = ()
    """Sure enough to filter nodes by."""
    hardware_confidence: float = 1.0
    """That `hardware` is exactly right."""
    doubted: tuple[Estimate[Hardware], ...] = ()
    """Hardware that is shown for the user to decide and filters nothing: a wrong requirement keeps a pod pending."""
    placement: Estimate[Placement] | None = None
    bandwidth_bps: Estimate[float] | None = None
    lifecycle: bool = False
    hints: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class GraphName:
    """A topic, service or action of a node. Resolved as far as the file alone allows."""

    role: str
    name: str
    type: str
    qos: Qos | None = None
    file: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class ExecutableProfile:
    name: str
    kind: str
    plugin: str
    assessment: Assessment
    graph: tuple[GraphName, ...] = ()


@dataclass(frozen=True, slots=True)
class Edge:
    """`kind`: Topic | Service | Action. `source` and `target` are full node names (publisher → subscriber,
    client → server).
    """

    kind: str
    topic: str
    type: str
    source: str
    target: str
    qos: Qos | None = None
    requested_qos: Qos | None = None
    confidence: float = 1.0


@dataclass(frozen=True, slots=True)
class LaunchedNode:
    """A node that a launch file starts by default, with every include followed and every argument at its default."""

    full_name: str
    package: str
    executable: str
    plugin: str
    container: str
    assessment: Assessment
    graph: tuple[GraphName, ...] = ()
    certain: bool = True
    """False: its condition could not be evaluated."""
    parameter_files: tuple[str, ...] = ()
    """`package/path` within that package."""
    remaps: tuple[tuple[str, str], ...] = ()
    parameters: tuple[tuple[str, str], ...] = ()
    namespace: str = "/"
    file: str = ""
    line: int = 0
    arguments: tuple[str, ...] = ()
    """Of its command line; `$(…)` in what cannot be told."""
    text_parameters: tuple[str, ...] = ()
    """Names of parameters whose value is a text, whatever it looks like."""
    environment: tuple[tuple[str, str], ...] = ()
    prefix: str = ""
    network: str = ""
    """The parameter by which a driver that may take a serial line goes over the network, `channel_type:=tcp`."""


@dataclass(frozen=True, slots=True)
class LaunchProfile:
    package: str
    file: str
    nodes: tuple[LaunchedNode, ...]
    edges: tuple[Edge, ...]
    assessment: Assessment
    problems: tuple[Problem, ...] = ()
    parameter_texts: tuple[tuple[str, str], ...] = ()
    """The parameter files of its nodes that are in the workspace, as `package/path`, with their text."""


@dataclass(frozen=True, slots=True)
class PackageProfile:
    name: str
    path: str
    ros_version: int
    assessment: Assessment
    """Of the package as a whole: the most demanding of what it runs, with the union of its hardware."""
    executables: tuple[ExecutableProfile, ...] = ()
    launches: tuple[LaunchProfile, ...] = ()
    problems: tuple[Problem, ...] = ()


@dataclass(frozen=True, slots=True)
class Profile:
    path: str
    engine: str
    packages: tuple[PackageProfile, ...]
    problems: tuple[Problem, ...] = ()
