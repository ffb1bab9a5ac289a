"""The thesis' heuristic (3.6.2), for comparison: four sets of dependencies and message types in Python sources.

`geometry_msgs` counts only together with a `Twist` in a Python source, the reading under which the published outcomes of
the thesis' five applications come out.
"""

from collections.abc import Sequence

from ros_profile.model.conclusions import Assessment, Estimate, Hardware, QosClass
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Unit

REALTIME = frozenset({"actionlib", "moveit_core", "ros2_control"})
SENSOR = frozenset({"sensor_msgs", "cv_bridge", "pcl_ros"})
GPU = frozenset({"darknet_ros", "tensorrt_ros", "depth_image_proc"})
USB = frozenset({"usb_cam", "serial"})
TIMES_S = {QosClass.REALTIME: (0.05, 0.03), QosClass.SENSOR_DATA: (0.15, 0.15), QosClass.BEST_EFFORT: (0.5, 0.5)}
"""Deadline and latency budget per class, as far as the thesis names them."""


def classify(unit: Unit) -> Assessment:
    depends = {fact.subject: fact for fact in unit.facts if fact.kind is Kind.DEPENDENCY}
    twist = _mentioned(unit, ("Twist",))
    image = _mentioned(unit, ("Image", "CompressedImage"))
    realtime = [depends[name] for name in sorted(depends.keys() & REALTIME)] + ([twist] if twist else [])
    sensor = [depends[name] for name in sorted(depends.keys() & SENSOR)] + ([image] if image else [])
    if realtime:
        qos, evidence = QosClass.REALTIME, realtime
    elif sensor:
        qos, evidence = QosClass.SENSOR_DATA, sensor
    else:
        qos, evidence = QosClass.BEST_EFFORT, []
    deadline, budget = TIMES_S[qos]
    hardware = _hardware("gpu", [depends[n] for n in sorted(depends.keys() & GPU)] + ([image] if image else []))
    hardware += _hardware("usb", [depends[n] for n in sorted(depends.keys() & USB)])
    return Assessment(
        Estimate(qos, 1.0, tuple(evidence), "the thesis' heuristic"),
        deadline_s=Estimate(deadline, 1.0),
        latency_budget_s=Estimate(budget, 1.0),
        hardware=hardware,
    )


def _mentioned(unit: Unit, names: tuple[str, ...]) -> Fact | None:
    """The first import of a message of one of these names in a Python source."""
    for fact in unit.facts:
        if fact.kind is Kind.INCLUDE and fact.file.endswith(".py") and fact.subject.rpartition(".")[2] in names:
            return fact
    return None


def _hardware(kind: str, evidence: list[Fact]) -> tuple[Estimate[Hardware], ...]:
    return (Estimate(Hardware(kind), 1.0, tuple(evidence), "the thesis' heuristic"),) if evidence else ()


def aggregate(assessments: Sequence[Assessment]) -> Assessment:
    """The thesis judges one package at a time: of several, the most demanding."""
    judged = [a for a in assessments if a.qos_class is not None]
    if not judged:
        return Assessment(None)
    return min(judged, key=lambda a: a.qos_class.value.rank if a.qos_class else len(QosClass))
