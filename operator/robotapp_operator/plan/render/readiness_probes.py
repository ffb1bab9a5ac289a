"""Readiness probes: the component's own, or one from `ready`, which queries ROS.

A query costs seconds (a new participant joins the graph), so topic and lifecycle are queried rarely; a sidecar that stays
in the graph would be better and needs an image of ours.
"""

import shlex
from typing import Any, Final

from robotapp_api.model.app.component import Component, ReadyTopic
from robotapp_api.values.quantities.quantity import parse_milli

ROS_PERIOD_S: Final = 15
ROS_TIMEOUT_S: Final = 10
_QUERY_TIMEOUT_S: Final = 7


def readiness_probe(component: Component, *, ros_version: int) -> dict[str, Any] | None:
    """The probe of the component's container, None when neither is written (running counts as ready)."""
    ready = component.ready
    if ready is None:
        return component.readiness_probe.unpack() if component.readiness_probe is not None else None
    command = _topic(ready.topic, ros_version) if ready.topic else _lifecycle(component.name)
    sourced = f'. "/opt/ros/$ROS_DISTRO/setup.bash" && {command}'
    return {
        "exec": {"command": ["bash", "-c", sourced]},
        "periodSeconds": ROS_PERIOD_S,
        "timeoutSeconds": ROS_TIMEOUT_S,
    }


def _topic(topic: ReadyTopic, ros_version: int) -> str:
    tool = "ros2 topic" if ros_version == 2 else "rostopic"
    name = shlex.quote(topic.name)
    if topic.min_rate is None:
        return f"timeout {_QUERY_TIMEOUT_S} {tool} echo {'--once' if ros_version == 2 else '-n 1'} {name}"
    # `hz` runs until it is stopped and prints the average again and again; the last one counts.
    return (
        f"timeout {_QUERY_TIMEOUT_S} {tool} hz -w 10 {name} | "
        f"awk '/average rate/ {{rate = $3}} END {{exit !(rate >= {parse_milli(topic.min_rate) / 1000:g})}}'"
    )


def _lifecycle(component: str) -> str:
    """The node is named like its component, with underscores: ROS names have no dashes."""
    return f"timeout {_QUERY_TIMEOUT_S} ros2 lifecycle get /{component.replace('-', '_')} | grep -q '^active'"
