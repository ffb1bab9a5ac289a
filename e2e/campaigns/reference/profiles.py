"""Runs our profile generator on the reference applications, for the thesis' table 4.3."""

from campaigns.reference.catalogue import Inferred
from campaigns.reference.robotapps import read_app
from robotapp_testbed.images.reference import FOLDER
from ros_profile.generate import generate_profile

NONE = "none"
UNSTATED = "system_default"
"""The class of a component that names none."""


def infer(app: str) -> Inferred:
    """Returns class and hardware of the application's package, beside what its Rigelfile asks for: its RobotApp has that.

    Hardware that the generator doubts has a question mark.
    """
    (package,) = generate_profile(FOLDER / app / "src").packages
    assessment = package.assessment
    components = read_app(app, use_images=False)["spec"]["components"]
    classes = {component.get("qosClass", UNSTATED) for component in components}
    devices = {device["type"] for component in components for device in component.get("devices", [])}
    hardware = {estimate.value.type for estimate in assessment.hardware}
    hardware |= {f"{estimate.value.type}?" for estimate in assessment.doubted}
    return Inferred(
        qos_class=str(assessment.qos_class.value) if assessment.qos_class else NONE,
        expected_class=", ".join(sorted(classes)),
        hardware=", ".join(sorted(hardware)) or NONE,
        expected_hardware=", ".join(sorted(devices)) or NONE,
    )
