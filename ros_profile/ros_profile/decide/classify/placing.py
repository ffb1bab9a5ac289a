"""Where a unit belongs and how much it sends."""

import re

from ros_profile.decide.classify.features import Features
from ros_profile.model.conclusions import Estimate, Placement, QosClass, SubClass
from ros_profile.model.facts import Fact
from ros_profile.model.package import Unit

_LOCAL_DEVICES = ("hardware:serial", "hardware:usb", "hardware:camera", "hardware:can", "hardware:gpio")
_FLEET = re.compile(r"(?:^|_)(?:fleet|rmf|cloud|llm|gpt)(?:_|$)")
_MBIT = 1e6
_RATES_BPS = {
    "sensor_msgs/msg/Image": 221 * _MBIT,
    "stereo_msgs/msg/DisparityImage": 295 * _MBIT,
    "sensor_msgs/msg/PointCloud2": 53 * _MBIT,
    "sensor_msgs/msg/PointCloud": 53 * _MBIT,
    "sensor_msgs/msg/CompressedImage": 11 * _MBIT,
    "nav_msgs/msg/OccupancyGrid": 1.3 * _MBIT,
    "sensor_msgs/msg/LaserScan": 0.8 * _MBIT,
    "sensor_msgs/msg/Imu": 0.6 * _MBIT,
}
"""640x480 RGB at 30 Hz, 16 beams at 300,000 points a second, a planar scan at 10 Hz, an IMU at 200 Hz (computed)."""


def placement(found: Features, unit: Unit, value: QosClass, row: SubClass) -> Estimate[Placement]:
    devices = [fact for name in _LOCAL_DEVICES for fact in found.found.get(name, ())]
    if devices:
        return Estimate(Placement.ROBOT, 0.9, tuple(devices[:3]), "opens a device of the robot")
    if value is QosClass.REALTIME:
        if row is SubClass.OPERATOR_INPUT:
            return Estimate(Placement.ANY, 0.7, (), "runs where the operator is")
        return Estimate(Placement.ROBOT, 0.85, (), "its loop does not bear a network in between")
    if value is QosClass.SENSOR_DATA:
        return _of_sensor(found)
    if value is QosClass.SYSTEM_DEFAULT and _FLEET.search(unit.package.name):
        return Estimate(Placement.CLOUD, 0.6, (), "serves several robots")
    if "uses:host_monitor" in found:
        return Estimate(
            Placement.ROBOT, 0.6, tuple(found.found["uses:host_monitor"][:1]), "looks at the computer it runs on"
        )
    return Estimate(Placement.ANY, 0.8, (), "nothing ties it to the robot")


def _of_sensor(found: Features) -> Estimate[Placement]:
    if "shape:sensor_source" in found and "is:component" not in found:
        return Estimate(Placement.ROBOT, 0.7, tuple(found.found["shape:sensor_source"][:1]), "a source of sensor data")
    localises = found.any("plugin:layer", "hosts:layer", "sub:pose") or ("sub:sensor" in found and "pub:tf" in found)
    if localises and "word:estimation" in found:
        return Estimate(
            Placement.ROBOT, 0.6, tuple(found.found["word:estimation"][:1]), "the control loop waits for it"
        )
    return Estimate(Placement.ANY, 0.75, (), "nothing ties it to the robot")


def bandwidth(found: Features) -> Estimate[float] | None:
    """Bits per second of what it publishes, by type; None when nothing large is known."""
    facts: dict[tuple[str, str], Fact] = {}
    for name in ("pub:sensor", "pub:interpreted"):
        for fact in found.found.get(name, ()):
            if fact.subject in _RATES_BPS:
                facts.setdefault((fact.subject, fact.value), fact)
    if not facts:
        return None
    total = sum(_RATES_BPS[kind] for kind, _ in facts)
    return Estimate(total, 0.4, tuple(facts.values())[:5], "sum over published types at usual sizes and rates")
