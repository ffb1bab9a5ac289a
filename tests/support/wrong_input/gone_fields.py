"""Fields, and values of fields, that the API had before it was reshaped: nobody may believe that they still work.

A field below a gone one cannot be written without it, so only the topmost stand here.
"""

import copy
from collections.abc import Mapping
from typing import Any, Final

from tests.support.apiobjects import AMR_07, app, component, edge, telemetry

Object = dict[str, Any]

GONE_FIELDS: Final[Mapping[str, Mapping[str, Any]]] = {
    "RobotApp": {
        "spec.robots.selector": AMR_07["nodeSelector"],
        "spec.robots.instances": "Any",
        "spec.components[].volumes": [{"name": "v", "emptyDir": {}}],
        "spec.components[].imagePullSecrets": [{"name": "pull"}],
        "spec.components[].initContainers": [{"name": "init", "image": "ros:jazzy"}],
        "spec.components[].tolerations": [{"key": "robot", "operator": "Exists"}],
        "spec.components[].nodeSelector": {"disk": "ssd"},
        "spec.components[].priorityClassName": "high",
        "spec.components[].serviceAccountName": "driver",
        "spec.components[].podSecurityContext": {"fsGroup": 1000},
        "spec.components[].runtimeClassName": "rt",
        "spec.components[].terminationGracePeriodSeconds": 5,
        "spec.components[].preStop": {"exec": {"command": ["stop"]}},
        "spec.components[].params": {"configMap": "p", "perRobot": True},
        "spec.components[].devices[].match": "8086:0b3a",
        "spec.components[].devices[].exclusive": True,
        "spec.components[].sharedData.claims": ["map-pvc"],
        "spec.components[].lifecycle.managed": True,
        "spec.components[].ready.minHz": 20,
        "spec.components[].ready.exec": {"command": ["true"]},
        "spec.components[].ready.httpGet": {"path": "/healthz", "port": 8080},
        "spec.components[].ready.tcpSocket": {"port": 8080},
        "spec.placement.allOrNothing": True,
        "spec.dds": {"domain": 7},
        "spec.update.policy": "OnDemand",
        "status.instances": [{"robot": "amr-07", "ready": True}],
        "status.summary.readyComponents": 3,
        "status.summary.desiredComponents": 3,
        "status.summary.omitted": 1,
        "status.moves": [{"component": "driver", "times": ["2026-01-01T00:00:00Z"]}],
        "status.links": [{"name": "ui", "url": "http://ui", "component": "driver"}],
    },
    "NodeTelemetry": {"status.rtt[].lossPercent": 0.5},
}
"""Kind → field, `[]` for the first item of a list → a value it once took."""

GONE_VALUES: Final[Mapping[str, Mapping[str, Any]]] = {
    "RobotApp": {
        "spec.components[].runsOn": "Robot",
        "spec.components[].ready.topic": "/odom",
        "spec.edges[].rateHz": 0.5,
        "spec.placement.fallback.steps": ["RelaxPreferred", "Onboard", "Wait"],
    },
    "NodeTelemetry": {
        "status.load.cpuPercent": 12.5,
        "status.load.memoryPercent": 12.5,
        "status.load.gpuPercent": 12.5,
    },
}
"""Kind → field that is still there → a value of its old type or meaning."""


def object_around(kind: str) -> Object:
    """A valid object with everything in it that a gone field lay in."""
    if kind == "NodeTelemetry":
        return telemetry("gone-fields", rtt=[{"peer": "edge-1"}], load={"cpuPercent": 12})
    driver = component(
        devices=[{"name": "cam", "type": "usb"}],
        sharedData={"peerPods": ["mapper"]},
        lifecycle={"preStop": {"exec": {"command": ["stop"]}}},
        ready={"lifecycle": "Active"},
    )
    whole = app(
        "gone-fields",
        robots={**AMR_07, "assignment": "Each"},
        components=[driver, component("operator")],
        edges=[edge()],
        placement={"gang": "All", "fallback": {"steps": ["Wait"]}},
        update={"operator": "Automatic"},
        recordings=[{"name": "log", "topics": {"names": ["/odom"]}, "split": {}}],
    )
    whole["status"] = {"summary": {"ready": "2/2"}}
    return copy.deepcopy(whole)


def with_field(kind: str, field: str, value: Any) -> Object:
    """The valid object of that kind with one more field, or another value in one it has."""
    whole = object_around(kind)
    *parents, last = field.split(".")
    target: Any = whole
    for step in parents:
        target = target[step.removesuffix("[]")]
        target = target[0] if step.endswith("[]") else target
    target[last] = copy.deepcopy(value)
    return whole
