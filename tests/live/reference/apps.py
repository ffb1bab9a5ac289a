"""Applications of examples/reference as RobotApps on real nodes."""

from collections.abc import Mapping
from typing import Any

import yaml

from campaigns.nodes import teleop_app
from robotapp_testbed import images
from robotapp_testbed.images.reference import FOLDER
from robotapp_testbed.real import RealNodes


def read_app(name: str, runs_on: Mapping[str, str]) -> dict[str, Any]:
    """Returns the committed RobotApp with the image of the testbed in place of its own, some components on one kind of node.

    The discovery server or master comes from the same image: it has what it takes.
    """
    app: dict[str, Any] = yaml.safe_load((FOLDER / name / "robotapp.yaml").read_text())
    image = {"image": images.reference(name), "imagePullPolicy": "IfNotPresent"}
    for component in app["spec"]["components"]:
        component.update(image)
        if component["name"] in runs_on:
            component["runsOn"] = [runs_on[component["name"]]]
    app["spec"].update({"ros1": image} if name.endswith("ros1") else {"ros2": {"discovery": image}})
    return app


def read_log(cp: RealNodes, namespace: str, app: str, component: str) -> str:
    """Returns what a component's newest pod has printed, "" without one."""
    pod = teleop_app.pods(cp, namespace, app).get(component)
    return cp.kubectl("logs", "-n", namespace, pod["metadata"]["name"], "-c", component, check=False) if pod else ""
