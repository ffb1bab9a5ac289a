"""Warns of what changes for ROS in a pod that has the network or the shared memory of its node."""

from collections.abc import Iterator
from typing import Final

from robotapp_api.checks.middleware import CYCLONE, FAST_DDS
from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.checks.ros import discovery_of, rmw_of, ros_version_of
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec

CYCLONE_PROCESSES: Final = 33
"""ROS processes with Cyclone DDS on one address: indices 0 to 32, which every peer asks for."""
DDS_PROCESSES: Final = 120
"""ROS processes that the ports of one domain have room for on one address; of domain 101 54, of domain 232 63."""


def shares_memory(component: Component) -> bool:
    """Decides whether processes that look like those of the same host can write into the pod's shared memory."""
    pod = component.template.spec
    return bool(pod.host_ipc or not pod.host_network)


def is_reachable_by_loopback(first: Component, second: Component) -> bool:
    """Decides whether two components on one node have the same loopback: that of the node."""
    return bool(first.template.spec.host_network and second.template.spec.host_network)


def host_network_notes(spec: RobotAppSpec) -> Iterator[Note]:
    """Says what of ROS reaches further, or less far, in the network of a node."""
    hosted = [index for index, component in enumerate(spec.components) if component.template.spec.host_network]
    if not hosted:
        return
    at = f"spec.components[{hosted[0]}].template.spec.hostNetwork"
    if ros_version_of(spec) == 1:
        return
    mode, rmw = discovery_of(spec), rmw_of(spec)
    if mode == "Multicast":
        yield Note(
            at,
            "with discovery.mode Multicast it meets every program on the network of its node that uses the same ROS_DOMAIN_ID, of other "
            "robots and laptops too, and pods without hostNetwork do not hear it; list the domains of that network in reserved of the "
            "DomainPool, or write mode: Auto",
        )
    elif mode == "Localhost":
        yield Note(
            at, "with discovery.mode Localhost it meets every program on its node that uses the same ROS_DOMAIN_ID"
        )
    processes = CYCLONE_PROCESSES if rmw in CYCLONE else DDS_PROCESSES
    if len(hosted) > 1 or (spec.ros2 and spec.ros2.isolation == "Discovery"):
        yield Note(
            at,
            f"ROS processes of one domain in the network of one node share its ports: {processes} of them have room; "
            "count the nodes of all components there",
        )
    alone = next((index for index in hosted if not shares_memory(spec.components[index])), None)
    if rmw in FAST_DDS and alone is not None and not (spec.ros2 and spec.ros2.transport == "UDP"):
        yield Note(
            f"spec.components[{alone}].template.spec.hostNetwork",
            "Fast DDS sends by UDP alone (FASTDDS_BUILTIN_TRANSPORTS), because pods in the network of one node count as one host and share no "
            "/dev/shm; for shared memory write hostIPC: true as well, in all components there",
        )


def host_name_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Finds host names that are the operator's: with Peers each pod is found under its component's name."""
    for index, component in enumerate(spec.components if discovery_of(spec) == "Peers" else ()):
        if component.template.spec.hostname:
            yield invalid(
                f"spec.components[{index}].template.spec.hostname",
                "with discovery by peers the host name is the component's, under which the others find it; remove it, or write "
                "another spec.ros2.discovery.mode",
            )


def host_pod_problems(component: Component, at: str) -> Iterator[Problem]:
    """Finds pod fields that contradict access to the node. `at`: such as `spec.components[0]`."""
    pod = component.template.spec
    if pod.host_ipc and component.shared_memory is not None:
        yield invalid(
            f"{at}.sharedMemory",
            "the pod has the shared memory of its node (hostIPC), whose size is the node's; remove sharedMemory, or hostIPC",
        )
    if pod.host_pid and pod.share_process_namespace:
        yield invalid(
            f"{at}.template.spec.shareProcessNamespace",
            "the pod has the process namespace of its node (hostPID), which its containers share anyway; remove one of the two",
        )


def host_pod_notes(component: Component, at: str) -> Iterator[Note]:
    """Says which pod fields have no effect in the network of a node."""
    pod = component.template.spec
    if pod.host_network and pod.hostname:
        yield Note(f"{at}.template.spec.hostname", "has no effect with hostNetwork: the host name is that of the node")
    if pod.host_network and component.replicas > 1 and component.ports:
        yield Note(
            f"{at}.replicas",
            "with hostNetwork every port of the container is one of the node, so a node takes one replica",
        )
