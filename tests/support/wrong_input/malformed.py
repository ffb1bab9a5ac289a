"""A RobotApp that uses every field, and all the ways to get one field of it wrong."""

import copy
import re
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
_PROBE = {"exec": {"command": ["true"]}}
_BORROWED = {
    kind: {name.partition(".")[2] for name in vendor.wanted() if name.startswith(f"{kind}.")}
    for kind in ("Container", "PodSpec")
}
_WRONG_TYPE = {"string": 7, "integer": "seven", "number": "fast", "boolean": "maybe", "array": "one", "object": "all"}


def full_app() -> dict[str, Any]:
    """Every field of the spec, with values that are valid together (ROS 1 and 2 mixed: admission does not compare them)."""
    whole = app(
        "full",
        suspend=False,
        ros={"version": 2, "distro": "jazzy"},
        robots={
            "nodeSelector": {**AMR_07["nodeSelector"], "matchExpressions": [{"key": "robotics.io/robot", "operator": "In", "values": ["amr-07"]}]},
            "assignment": "Any",
        },
        components=[
            _full_component(),
            component("mapper", ready={"lifecycle": "Active"}, runsOn=["Edge", "Robot"]),
            component("logger", livenessProbe=_PROBE, readinessProbe=_PROBE, startupProbe=_PROBE),
            component("store", ros="None", replicas=0),
            component(
                "camera",
                run={
                    "package": "camera", "executable": "node", "name": "front", "namespace": "/$(ROBOTAPP_ROBOT)",
                    "remaps": {"image": "/front/image"}, "args": ["--fast"],
                },
            ),
            component(
                "navigation", parameters=[{"inline": "/**: {ros__parameters: {v: 1.0}}"}],
                launch={
                    "package": "nav2_bringup", "file": "navigation_launch.py", "arguments": {"use_sim_time": "true"},
                    "parametersArgument": "params_file",
                },
                dependsOn=[{"component": "driver", "status": "Ready"}, {"component": "saver", "status": "Complete"}],
            ),
            component("saver", job={"backoffLimit": 2, "activeDeadlineSeconds": 600}),
            component("backup", job={}, schedule={"cron": "0 2 * * *", "timeZone": "Europe/Athens", "startingDeadlineSeconds": 600}),
        ],
        completion={"success": {"operator": "All", "components": ["saver"]}, "deadline": "1h", "maxRestarts": 2, "ttl": "1h"},
        edges=[
            edge(
                "driver", "mapper", kind="Topic", type="nav_msgs/msg/Odometry", rateHz=20, messageBytes=48, qos=_QOS, requestedQos=_QOS,
                latency={"budget": "30ms", "percentile": 95, "enforce": "Required"}, bandwidth="40M",
            )
        ],
        placement={
            "zones": ["edge-zone-1"], "masterNode": "edge-1", "objective": "Latency", "gang": "All",
            "fallback": {"steps": ["RelaxPreferred", "Wait"], "after": "10s"},
            "reschedule": {"when": "BudgetExceeded", "for": "15s", "cooldown": "2m", "maxPerDay": 3},
        },
        ros2={
            "domain": 7, "allowUnsafeDomain": False, "pool": "default", "isolation": "Domain", "rmw": "rmw_fastrtps_cpp",
            "discovery": {"mode": "Auto", "image": "ros:jazzy", **_full_helper()}, "transport": "Auto", "external": {"expose": "NodePort"},
            "shareWith": [{"namespace": "team-b", "name": "other"}],
        },
        ros1={"master": "External", "uri": "http://master:11311", "image": "ros:noetic", **_full_helper()},
        update={"operator": "OnDemand", "onConfigChange": "Roll"},
        overrides=[{"name": "slow", "nodeSelector": _full_selector(), "components": [_full_override()]}],
        recordings=[_full_recording()],
        connectivity={"grace": "5m"},
        schedulerName="ros-aware-scheduler",
    )  # fmt: skip
    return copy.deepcopy(whole)  # callers bend it, and parts are shared


def _full_recording() -> dict[str, Any]:
    return {
        "name": "drive",
        "topics": {"names": ["/scan"], "regex": "/camera/.*", "exclude": "/rosout"},
        "split": {"size": "256Mi", "duration": "10m"},
        "retain": {"size": "5Gi"},
        "volume": {"claimName": "bags"},
        "tiers": ["Robot"],
        "image": "robotapp/recorder:jazzy",
        "imagePullPolicy": "Always",
        "resources": {"requests": {"cpu": "50m"}, "limits": {"cpu": "1"}},
    }


def _full_selector() -> dict[str, Any]:
    return {
        "matchLabels": {"robotics.io/robot": "amr-07"},
        "matchExpressions": [{"key": "robotics.io/robot", "operator": "In", "values": ["amr-07"]}],
    }


def _full_override() -> dict[str, Any]:
    whole = _full_component()
    return {name: whole[name] for name in ("name", "image", "env", "resources", "parameters")}


def _full_helper() -> dict[str, Any]:
    left_out = {
        "volumes", "initContainers", "containers", "terminationGracePeriodSeconds", "hostNetwork", "hostIPC", "hostPID",
        "shareProcessNamespace", "hostAliases", "hostname", "dnsConfig",
    }  # fmt: skip
    return {
        "imagePullPolicy": "Always",
        "resources": {"requests": {"cpu": "50m"}},
        "securityContext": {"runAsNonRoot": True},
        "template": {
            "metadata": {"labels": {"team": "a"}, "annotations": {"example.com/a": "b"}},
            "spec": {name: value for name, value in _full_pod().items() if name not in left_out},
        },
    }


def _full_component() -> dict[str, Any]:
    return component(
        command=["ros2"], args=["run"], workingDir="/ws", env=[{"name": "A", "value": "b"}], envFrom=[{"configMapRef": {"name": "c"}}],
        ports=[{"containerPort": 7400, "protocol": "UDP"}],
        volumeMounts=[{"name": "v", "mountPath": "/v"}], resources={"requests": {"cpu": "500m"}}, imagePullPolicy="Always",
        securityContext={"runAsNonRoot": True}, lifecycle={"preStop": {"exec": {"command": ["stop"]}}},
        parameters=[
            {"inline": "/**: {ros__parameters: {v: 1.0}}"},
            {"configMapKeyRef": {"name": "p", "key": "$(ROBOTAPP_ROBOT).yaml", "optional": True}},
            {"secretKeyRef": {"name": "s", "key": "p.yaml"}},
        ],
        template={"metadata": {"labels": {"team": "a"}, "annotations": {"example.com/a": "b"}}, "spec": _full_pod()},
        runsOn=["Robot"], qosClass="realtime",
        policies={
            "latencyBudget": "30ms", "deadline": "50ms", "reliability": "reliable", "durability": "volatile",
            "liveliness": "automatic", "queueSize": 1, "tcpNodelay": True,
        },
        devices=[
            {"name": "cam", "type": "usb", "model": "d435", "interface": "usb3", "usbID": "8086:0b3a", "count": 1,
                "mountAs": "/dev/cam", "sharing": "Exclusive", "onLoss": "Keep"}
        ],
        requires=[{"type": "gpu", "model": "nvidia", "interface": "pcie"}],
        stdin=True, tty=True, sharedMemory={"size": "512Mi"},
        sharedData={"with": ["mapper"], "peerPods": ["foreign"], "claimNames": ["map-pvc"]},
        service={
            "metadata": {"labels": {"team": "a"}, "annotations": {"example.com/a": "b"}},
            "spec": {
                "type": "LoadBalancer", "externalTrafficPolicy": "Local", "loadBalancerClass": "example.com/internal",
                "loadBalancerSourceRanges": ["10.0.0.0/8"],
                "ports": [{"name": "ui", "port": 80, "protocol": "TCP", "targetPort": 8080, "nodePort": 30080, "appProtocol": "http"}],
            },
            "links": [{"name": "ui", "port": "ui", "scheme": "http", "path": "/"}],
        },
        ready={"topic": {"name": "/odom", "minRate": 20}},
        colocateWith=["mapper"], separateFrom=["logger"], replicas=1, replicaIdentity="None", onDisconnect="Failover",
    )  # fmt: skip


def _full_pod() -> dict[str, Any]:
    return {
        "volumes": [{"name": "v", "emptyDir": {}}],
        "imagePullSecrets": [{"name": "pull"}],
        "initContainers": [{"name": "init", "image": "ros:jazzy"}],
        "containers": [{"name": "beside", "image": "ros:jazzy"}],
        "hostNetwork": True,
        "hostIPC": True,
        "hostPID": True,
        "shareProcessNamespace": True,
        "hostAliases": [{"ip": "10.0.0.1", "hostnames": ["lidar"]}],
        "hostname": "driver",
        "dnsConfig": {"nameservers": ["10.0.0.2"]},
        "tolerations": [{"key": "robot", "operator": "Exists"}],
        "nodeSelector": {"disk": "ssd"},
        "priorityClassName": "high",
        "serviceAccountName": "driver",
        "securityContext": {"fsGroup": 1000},
        "runtimeClassName": "rt",
        "terminationGracePeriodSeconds": 5,
    }


@dataclass(frozen=True)
class Malformed:
    """An app with one wrong value, and the path of its field as the API server writes it."""

    field: str
    obj: dict[str, Any]


def malformed_apps(schema: Schema) -> list[Malformed]:
    """Well over a hundred apps, each wrong in exactly one value, each field once. `schema` is the RobotApp's."""
    found: dict[tuple[str, str], Malformed] = {}
    for whole in (full_app(), full_sweep()):
        for path, value in _wrong(schema["properties"]["spec"], whole["spec"], ("spec",)):
            found.setdefault((_field(path), repr(value)), Malformed(_shown(path), _with(whole, path, value)))
    return list(found.values())


def full_sweep() -> dict[str, Any]:
    """The fields that an app with robots cannot have."""
    return app(
        "sweep",
        components=[component("sim", job={})],
        matrix={"parameters": [{"name": "speed", "values": ["0.5", "1.5"]}], "parallelism": 2},
    )


def unused_fields(schema: Schema) -> list[str]:
    """Fields that `full_app` and `full_sweep` leave out, except inside those borrowed from core; `[]` stands for every item of a list."""
    unused = _unused(schema["properties"]["spec"], [full_app()["spec"], full_sweep()["spec"]], ("spec",))
    return [_field(path) for path in unused if not is_borrowed(_field(path[:-1]))]


def is_borrowed(field: str) -> bool:
    """Whether a field, such as spec.components[].env, is core's or lies in one that is."""
    for place in (
        "spec.components[].",
        "spec.overrides[].components[].",
        "spec.recordings[].",
        "spec.ros2.discovery.",
        "spec.ros1.",
    ):
        if field.startswith(place):
            container, template, *rest = (*field.removeprefix(place).split("."), "", "")
            in_pod = [container, template] == ["template", "spec"] and _name(rest[0]) in _BORROWED["PodSpec"]
            return _name(container) in _BORROWED["Container"] or in_pod
    return False


def _name(step: str) -> str:
    return step.partition("[")[0]


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
        for index, item in enumerate(value[key] if isinstance(value[key], list) else ()):
            if isinstance(item, dict):
                yield from _wrong(member["items"], item, (*here, index))


def _unused(schema: Schema, values: list[Any], path: Path) -> Iterator[Path]:
    """`values` are all that stands at `path`: one object, or every item of a list."""
    for key, member in schema.get("properties", {}).items():
        written = [value[key] for value in values if key in value]
        items = [item for each in written if isinstance(each, list) for item in each if isinstance(item, dict)]
        objects = [each for each in written if isinstance(each, dict)]
        if not written:
            yield (*path, key)
        elif items:
            yield from _unused(member["items"], items, (*path, key, 0))
        elif objects:
            yield from _unused(member, objects, (*path, key))


def _with(whole: dict[str, Any], path: Path, value: Any) -> dict[str, Any]:
    obj = copy.deepcopy(whole)
    target: Any = obj
    for step in path[:-1]:
        target = target[step]
    target[path[-1]] = value
    return obj


def _field(path: Path) -> str:
    """The path of a field, whatever item of a list it was met in."""
    return re.sub(r"\[[0-9]+\]", "[]", _shown(path))


def _shown(path: Path) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)[1:]
