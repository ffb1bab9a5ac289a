"""Small valid objects of our five kinds, to be bent by tests."""

from typing import Any

Object = dict[str, Any]

API_VERSION = "robotics.io/v1alpha1"
ROS = {"distro": "humble"}
"""What an app must write of ROS at least; tests that do not care take this."""

AMR_07 = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}}


def component(name: str = "driver", **fields: Any) -> Object:
    return {"name": name, "image": "team/driver:humble", **fields}


def edge(from_: str = "operator", to: str = "driver", **fields: Any) -> Object:
    return {"topic": "/cmd_vel", "from": from_, "to": to, **fields}


def app(name: str = "teleop", **spec: Any) -> Object:
    """A RobotApp with the components operator and driver, unless told otherwise."""
    components = spec.pop("components", [component("operator"), component("driver")])
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": name, "namespace": "default"},
        "spec": {"ros": ROS, "components": components, **spec},
    }


def domain(**fields: Any) -> Object:
    return {"pool": "default", "scope": "Cluster", "id": 7, **fields}


def device(**fields: Any) -> Object:
    return {"node": "amr-07", "type": "can", "id": "can-can0", **fields}


def holder(**fields: Any) -> Object:
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "namespace": "default",
        "name": "teleop",
        "uid": "u-1",
        **fields,
    }


def claim(name: str = "dds.default.c.7", **spec: Any) -> Object:
    """A RobotClaim of domain 7, or of what `spec` says."""
    things = spec if {"domain", "device"} & spec.keys() else {"domain": domain(), **spec}
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotClaim",
        "metadata": {"name": name},
        "spec": {"holder": holder(), **things},
    }


def pool(name: str = "default", **spec: Any) -> Object:
    return {"apiVersion": API_VERSION, "kind": "DomainPool", "metadata": {"name": name}, "spec": spec}


def telemetry(name: str = "amr-07", **status: Any) -> Object:
    return {
        "apiVersion": API_VERSION,
        "kind": "NodeTelemetry",
        "metadata": {"name": name},
        "spec": {},
        "status": status,
    }


def instance(name: str = "teleop-amr-07", **spec: Any) -> Object:
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotAppInstance",
        "metadata": {"name": name, "namespace": "default"},
        "spec": {"app": "teleop", "appUID": "u-1", "instance": "amr-07", "robot": "amr-07", **spec},
    }
