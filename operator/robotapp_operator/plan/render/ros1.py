"""ROS 1: a master per instance, and addresses other pods can reach."""

from typing import Any, Final

from robotapp_operator.plan.spec.desired import Desired

MASTER_PORT: Final = 11311


def master_uri(desired: Desired) -> str:
    """Address of the instance's master: our roscore's Service, or what the user wrote."""
    if desired.app.spec.ros1 and not desired.app.managed_master:
        return desired.app.spec.ros1.uri
    return f"http://{desired.master_name}:{MASTER_PORT}"


def ros1_environment(desired: Desired) -> list[dict[str, Any]]:
    """TCPROS peers connect to the address a node advertises, so that must be the pod's own IP, never its host name."""
    return [{"name": "ROS_MASTER_URI", "value": master_uri(desired)}, own_address()]


def own_address() -> dict[str, Any]:
    """The variable with which a ROS 1 process advertises its pod's IP."""
    return {"name": "ROS_IP", "valueFrom": {"fieldRef": {"fieldPath": "status.podIP"}}}
