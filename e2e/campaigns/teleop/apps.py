"""The committed RobotApps of the teleoperation examples as each arm deploys them."""

from typing import Any, Final

import yaml

from campaigns.teleop.design import Arm, Turn
from robotapp_api.model.names import Label
from robotapp_testbed import images
from robotapp_testbed.images.reference import FOLDER

IMAGES: Final = ("teleop-ros1", "teleop-ros2")
OPERATOR: Final = "operator"
RESULTS: Final = "results"
"""Volume of the operator's pod in which its program writes FILE."""
FILE: Final = "round_trips.csv"
ZONE: Final = "hall-1"
"""Zone of the robot."""
DEFAULT_SCHEDULER: Final = "default-scheduler"
_GRACE_S: Final = 2


def make_name(turn: Turn) -> str:
    return f"teleop-{turn.number}"


def make_app(turn: Turn) -> dict[str, Any]:
    """Returns the RobotApp of a turn: arms differ in scheduler and affinity alone."""
    example = f"teleop-ros{turn.condition.ros}"
    app: dict[str, Any] = yaml.safe_load((FOLDER / example / "robotapp.yaml").read_text())
    app["metadata"] = {"name": make_name(turn)}
    spec, image = app["spec"], {"image": images.reference(example), "imagePullPolicy": "IfNotPresent"}
    spec.update({"ros1": image} if turn.condition.ros == 1 else {"ros2": {"discovery": image}})
    for component in spec["components"]:
        component.update(image)
        component.setdefault("template", {}).setdefault("spec", {})["terminationGracePeriodSeconds"] = _GRACE_S
        if component["name"] == OPERATOR:
            component["runsOn"] = ["Cloud", "Edge"]
            if turn.arm is Arm.AFFINITY:
                component["runsOn"] = ["Edge"]
                component["template"]["spec"]["nodeSelector"] = {Label.ZONE.value: ZONE}
    if turn.arm is not Arm.OURS:
        spec["schedulerName"] = DEFAULT_SCHEDULER
    return app
