"""The committed RobotApps of the teleoperation examples as each arm deploys them."""

from typing import Any, Final

from campaigns.reference.robotapps import read_app
from campaigns.teleop.design import Arm, Turn
from robotapp_api.model.names import Label

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
    tiers = ["Edge"] if turn.arm is Arm.AFFINITY else ["Cloud", "Edge"]
    scheduler = "" if turn.arm is Arm.OURS else DEFAULT_SCHEDULER
    app = read_app(f"teleop-ros{turn.condition.ros}", {OPERATOR: tiers}, scheduler=scheduler)
    app["metadata"] = {"name": make_name(turn)}
    for component in app["spec"]["components"]:
        pod = component.setdefault("template", {}).setdefault("spec", {})
        pod["terminationGracePeriodSeconds"] = _GRACE_S
        if component["name"] == OPERATOR and turn.arm is Arm.AFFINITY:
            pod["nodeSelector"] = {Label.ZONE.value: ZONE}
    return app
