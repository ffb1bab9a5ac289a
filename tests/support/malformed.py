"""A RobotApp that uses every field, and all the ways to get one field of it wrong."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from tests.support.apiobjects import AMR_07, app, component, edge

from robotapp_api.schema import vendor

Schema = dict[str, Any]
Path = tuple[str | int, ...]

_QOS = {
    "reliability": "reliable",
    "durability": "volatile",
    "history": "keep_last",
    "depth": 1,
    "deadline": "50ms",
    "liveliness": "automatic",
    "lease": "1s",
}
_WRONG_TYPE = {"string": 7, "integer": "seven", "number": "fast", "boolean": "maybe", "array": "one", "object": "all"}


def full_app() -> dict[str, Any]:
    """Every field of the spec, with values that are valid together (ROS 1 and 2 mixed: admission does not compare them)."""
    whole = app(
        "full",
        suspend=False,
        ros={"version": 2, "distro": "jazzy"},
        robots={
            "selector": {**AMR_07["selector"], "matchExpressions": [{"key": "robotics.io/robot", "operator": "In", "values": ["amr-07"]}]},
            "instances": "Any",
        },
        components=[_full_component(), component("mapper"), component("logger")],
        edges=[
            edge(
                "driver", "mapper", type="nav_msgs/msg/Odometry", rateHz=20, messageBytes=48, qos=_QOS, requestedQos=_QOS,
                latency={"budget": "30ms", "percentile": 95, "enforce": "Required"}, bandwidth="40M",
            )
        ],
        placement={
            "zones": ["edge-zone-1"], "masterNode": "edge-1", "objective": "Latency", "allOrNothing": True,
            "fallback": {"steps": ["RelaxPreferred", "Onboard", "Wait"], "after": "10s"},
            "reschedule": {"when": "BudgetExceeded", "for": "15s", "cooldown": "2m", "maxPerDay": 3},
        },
        dds={
            "domain": 7, "allowUnsafeDomain": False, "pool": "default", "isolation": "Domain", "rmw": "rmw_fastrtps_cpp",
            "discovery": {"mode": "Auto", "image": "ros:jazzy"}, "transport": "Auto", "network": "Pod",
            "shareWith": [{"namespace": "team-b", "name": "other"}],
        },
        ros1={"master": "External", "uri": "http://master:11311", "image": "ros:noetic"},
        update={"policy": "OnDemand"},
        connectivity={"grace": "5m"},
        schedulerName="ros-aware-scheduler",
    )  # fmt: skip
    return copy.deepcopy(whole)  # callers bend it, and parts are shared


def _full_component() -> dict[str, Any]:
    return component(
        command=["ros2"], args=["run"], env=[{"name": "A", "value": "b"}], envFrom=[{"configMapRef": {"name": "c"}}],
        ports=[{"containerPort": 7400, "protocol": "UDP"}], volumes=[{"name": "v", "emptyDir": {}}],
        volumeMounts=[{"name": "v", "mountPath": "/v"}], resources={"requests": {"cpu": "500m"}}, imagePullPolicy="Always",
        imagePullSecrets=[{"name": "pull"}], initContainers=[{"name": "init", "image": "ros:jazzy"}],
        tolerations=[{"key": "robot", "operator": "Exists"}], nodeSelector={"disk": "ssd"}, priorityClassName="high",
        serviceAccountName="driver", securityContext={"runAsNonRoot": True}, podSecurityContext={"fsGroup": 1000},
        runtimeClassName="rt", terminationGracePeriodSeconds=5, preStop={"exec": {"command": ["stop"]}},
        params={"configMap": "p", "perRobot": True}, runsOn="Robot", qosClass="realtime",
        policies={
            "latencyBudget": "30ms", "deadline": "50ms", "reliability": "reliable", "durability": "volatile",
            "liveliness": "automatic", "queueSize": 1, "tcpNodelay": True,
        },
        devices=[
            {"name": "cam", "type": "usb", "model": "d435", "interface": "usb3", "match": "8086:0b3a", "exclusive": True, "onLoss": "Keep"}
        ],
        requires=[{"type": "gpu", "model": "nvidia"}],
        sharedData={"with": ["mapper"], "peerPods": ["foreign"], "claims": ["map-pvc"]},
        lifecycle={"managed": True},
        ready={"topic": "/odom", "minHz": 20},
        colocateWith=["mapper"], separateFrom=["logger"], replicas=1, onDisconnect="Failover",
    )  # fmt: skip


@dataclass(frozen=True)
class Malformed:
    """An app with one wrong value, and the path of its field as the API server writes it."""

    field: str
    obj: dict[str, Any]


def malformed_apps(schema: Schema) -> list[Malformed]:
    """Well over a hundred apps, each wrong in exactly one value. `schema` is the RobotApp's."""
    spec = schema["properties"]["spec"]
    return [Malformed(_shown(path), _with(path, value)) for path, value in _wrong(spec, full_app()["spec"], ("spec",))]


def unused_fields(schema: Schema) -> list[str]:
    """Fields that `full_app` leaves out, except inside those borrowed from core."""
    borrowed = {name.partition(".")[2] for name in vendor.wanted()} | {"podSecurityContext"}
    unused = _unused(schema["properties"]["spec"], full_app()["spec"], ("spec",))
    return [_shown(path) for path in unused if not borrowed & set(path[:-1])]


def _wrong(schema: Schema, value: Any, path: Path) -> Iterator[tuple[Path, Any]]:
    for key, member in schema.get("properties", {}).items():
        if key not in value:
            continue
        here = (*path, key)
        yield here, "a lot" if "x-kubernetes-int-or-string" in member else _WRONG_TYPE[member["type"]]
        if "enum" in member:
            yield here, 42 if member["type"] == "integer" else "Nonsense"
        elif "maxLength" in member and "type" in member:
            yield here, "ä" * (member["maxLength"] + 1)
        elif "maximum" in member:
            yield here, member["maximum"] + 1
        elif "maxItems" in member:
            yield here, [copy.deepcopy(value[key][0])] * (member["maxItems"] + 1)
        yield from _wrong(member, value[key], here) if isinstance(value[key], dict) else ()
        if isinstance(value[key], list) and isinstance(value[key][0], dict):
            yield from _wrong(member["items"], value[key][0], (*here, 0))


def _unused(schema: Schema, value: Any, path: Path) -> Iterator[Path]:
    for key, member in schema.get("properties", {}).items():
        if key not in value:
            yield (*path, key)
        elif isinstance(value[key], dict):
            yield from _unused(member, value[key], (*path, key))
        elif isinstance(value[key], list) and isinstance(value[key][0], dict):
            yield from _unused(member["items"], value[key][0], (*path, key, 0))


def _with(path: Path, value: Any) -> dict[str, Any]:
    obj = full_app()
    target: Any = obj
    for step in path[:-1]:
        target = target[step]
    target[path[-1]] = value
    return obj


def _shown(path: Path) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)[1:]
