"""Environment variables by which the operator's discovery and a component's own settings meet.

Some middlewares read a list from their variable, so both values are joined and the component's part comes last, which
wins where both set one thing. For the other variables the component's value replaces the operator's, and a note names what
is lost.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from robotapp_api.checks.middleware import BEFORE_IRON, CONNEXT, CYCLONE, FAST_DDS, ZENOH
from robotapp_api.checks.problem import Note
from robotapp_api.checks.ros import NONE, discovery_of, rmw_of, ros_version_of, uses_ros
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.distros import NO_ROS
from robotapp_api.values.component_references import list_further_containers

SEPARATORS: Final = {
    "CYCLONEDDS_URI": ",",
    "NDDS_DISCOVERY_PEERS": ",",
    "ROS_STATIC_PEERS": ";",
    "ZENOH_CONFIG_OVERRIDE": ";",
}
"""What stands between two values of a variable whose middleware reads a list."""
LOCALHOST_ONLY: Final = "ROS_LOCALHOST_ONLY"
RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
SERVERS: Final = "ROS_DISCOVERY_SERVER"
TRANSPORTS: Final = "FASTDDS_BUILTIN_TRANSPORTS"
_PROFILE_FILES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_WITHOUT_IPV4: Final = ("DEFAULTv6", "UDPv6", "LARGE_DATA")
XRCE_DOMAIN: Final = "XRCE_DOMAIN_ID_OVERRIDE"
_FOR_ALL: Final = ("ROS_DOMAIN_ID", "RMW_IMPLEMENTATION")
_UNICAST: Final = re.compile(r"<\s*(AllowMulticast|ParticipantIndex)\s*>\s*([^<]*?)\s*<")
_UNICAST_VALUES: Final = {"AllowMulticast": "false", "ParticipantIndex": "auto"}
_CYCLONE_DOMAIN: Final = re.compile(r"<\s*Domain\s+[iI]d\s*=\s*[\"']\s*(\d+)\s*[\"']")
_ZENOH_KEYS: Final = ("mode", "connect/endpoints")


def discovery_variables(spec: RobotAppSpec) -> frozenset[str]:
    """Returns the names of the variables with which the operator decides how the app's processes find each other."""
    if ros_version_of(spec) == NO_ROS:
        return frozenset()
    if ros_version_of(spec) == 1:
        return frozenset({"ROS_MASTER_URI", "ROS_IP"})
    mode, rmw = discovery_of(spec), rmw_of(spec)
    names = {LOCALHOST_ONLY if spec.ros.distro in BEFORE_IRON else RANGE}
    if mode == "Server":
        names.add(SERVERS)
    elif mode == "Router":
        names |= {"ZENOH_CONFIG_OVERRIDE", "ZENOH_ROUTER_CHECK_ATTEMPTS"}
    elif mode == "Peers":
        by_rmw = {**dict.fromkeys(CYCLONE, "CYCLONEDDS_URI"), **dict.fromkeys(CONNEXT, "NDDS_DISCOVERY_PEERS")}
        names.add(by_rmw.get(rmw, "ROS_STATIC_PEERS"))
    if spec.ros2 and spec.ros2.transport == "UDP" and rmw in FAST_DDS:
        names.add(TRANSPORTS)
    return frozenset(names)


def join_values(name: str, ours: str, own: str) -> str:
    """Returns one value of a variable of `SEPARATORS` with the operator's part and the component's own.

    A component that refers to the operator's value has chosen the place of that part itself.
    """
    reference, separator = f"$({name})", SEPARATORS[name]
    if reference in own:
        return own.replace(reference, ours)
    return separator.join(part for part in (ours, own.strip().strip(separator).strip()) if part)


def variable_notes(spec: RobotAppSpec) -> Iterator[Note]:
    """Yields what is lost because a container's own variables and those of the operator's discovery meet."""
    operator_names = discovery_variables(spec)
    for index, component in enumerate(spec.components):
        if not uses_ros(component, spec.ros.distro):
            continue
        at = f"spec.components[{index}]"
        yield from _container_notes(spec, component.name, component.env, f"{at}.env")
        yield from _micro_ros_notes(spec, component, at)
        yield from _source_notes(spec, component.env_from, f"{at}.envFrom", operator_names)
        for container, path in list_further_containers(component, at):
            name = str(container.get("name", ""))
            yield from _container_notes(spec, name, container.get("env") or (), f"{path}.env")
            yield from _source_notes(spec, container.get("envFrom") or (), f"{path}.envFrom", operator_names)


def _micro_ros_notes(spec: RobotAppSpec, component: Component, at: str) -> Iterator[Note]:
    """Yields that a micro-ROS agent leaves the domain to its boards, which are in domain 0 unless they are built otherwise."""
    names = {variable.get("name") for variable in component.env}
    if ros_version_of(spec) == 2 and "micro-ros-agent" in component.image and XRCE_DOMAIN not in names:
        yield Note(
            f"{at}.env",
            f"a micro-ROS agent takes the domain from its boards, not from ROS_DOMAIN_ID; write {{name: {XRCE_DOMAIN}, "
            'value: "$(ROS_DOMAIN_ID)"}, or build the boards for the domain in spec.ros2.domain',
        )


def _source_notes(spec: RobotAppSpec, sources: Iterable[Any], field: str, names: frozenset[str]) -> Iterator[Note]:
    """Yields that keys of ConfigMaps and Secrets lose against variables of the same name, as in every container."""
    if any(sources):
        for_all = () if ros_version_of(spec) == 1 else _FOR_ALL
        lists = sorted(names & SEPARATORS.keys())
        more = f"; the operator's {lists[0]} and one in env are joined" if lists else ""
        yield Note(
            field,
            f"of the keys {', '.join([*for_all, *sorted(names)])} the operator's value counts, not that of envFrom; "
            f"write env with valueFrom for one that must count{more}",
        )


def _container_notes(
    spec: RobotAppSpec, container: str, env: Iterable[Mapping[str, Any]], field: str
) -> Iterator[Note]:
    for variable in env:
        name, value = str(variable.get("name", "")), str(variable.get("value") or "")
        loss = _loss(spec, name, value, literal="valueFrom" not in variable) or _unjoined_text(spec, name, variable)
        if loss:
            yield Note(field, f"{name} of {container}: {loss}")


def _loss(spec: RobotAppSpec, name: str, value: str, *, literal: bool) -> str:
    """Returns what this variable of a container takes from the operator's discovery, "" for nothing."""
    if ros_version_of(spec) == 1:
        return (
            "nodes advertise this name instead of the pod's address in ROS_IP, so every other pod must resolve it; "
            "remove it unless that is so"
            if name == "ROS_HOSTNAME"
            else "nodes advertise this address instead of the pod's own; remove it unless every other pod reaches it"
            if name == "ROS_IP"
            else ""
        )
    mode, rmw = discovery_of(spec), rmw_of(spec)
    if mode in ("Localhost", NONE):
        return ""
    if name in (LOCALHOST_ONLY, RANGE):
        return _range_text(spec, name, value, literal=literal)
    if rmw in FAST_DDS:
        return _fast_dds_text(spec, name, value, mode=mode)
    if rmw in CYCLONE and name == "CYCLONEDDS_URI" and mode == "Peers":
        return _cyclone_text(spec, value)
    return _zenoh_text(name, value) if rmw in ZENOH else ""


def _range_text(spec: RobotAppSpec, name: str, value: str, *, literal: bool) -> str:
    """Returns what another discovery range takes: every component is a pod with a loopback of its own."""
    before_iron = spec.ros.distro in BEFORE_IRON
    if name == RANGE and before_iron:
        return f"ROS 2 {spec.ros.distro} does not know it; remove it"
    if literal and value in (("", "0") if name == LOCALHOST_ONLY else ("", "SUBNET")):
        return ""
    cure = "remove it, or write spec.ros2.discovery.mode: Localhost where no component talks to another one"
    if not literal:
        return f"a value that means this pod alone keeps it from hearing other components; {cure}"
    text = f'"{value}" keeps it inside its pod: it hears no other component and none hears it; {cure}'
    narrow = value in ("OFF", "LOCALHOST") or name == LOCALHOST_ONLY
    if discovery_of(spec) == "Server" and not before_iron and value != "OFF":
        # Seen with Jazzy: clients of a server match and exchange data whatever these two say, but for OFF.
        return "it replaces the operator's value and has no effect on clients of a discovery server; remove it"
    if "ROS_STATIC_PEERS" in discovery_variables(spec) and (name == LOCALHOST_ONLY or value == "SYSTEM_DEFAULT"):
        return "with it the operator's ROS_STATIC_PEERS are ignored, so no other component is found; remove it"
    if "ROS_STATIC_PEERS" in discovery_variables(spec) and value == "LOCALHOST":
        return ""
    return "" if value == "SYSTEM_DEFAULT" else text if narrow else f'"{value}" counts as LOCALHOST; {text}'


def _fast_dds_text(spec: RobotAppSpec, name: str, value: str, *, mode: str) -> str:
    """Returns what is lost with Fast DDS, as seen with the one of Jazzy."""
    if name == SERVERS and mode == "Server":
        return (
            "it replaces the operator's two servers, so the container meets only those that use the same servers; "
            "write it in all components that talk, or remove it"
        )
    if name == TRANSPORTS:
        if spec.ros2 and spec.ros2.transport == "UDP" and value != "UDPv4":
            return f'"{value}" replaces spec.ros2.transport: UDP; remove one of the two'
        if value in ("NONE", "SHM"):
            return f"{value} reaches no other pod, because pods share no memory but with hostIPC: true in all of them; remove it"
        if value.startswith(_WITHOUT_IPV4) and mode == "Server":
            return (
                f"{value} does not reach the operator's discovery servers, which speak UDP over the pods' IP family; write UDPv4, or on a "
                "cluster of IPv6 leave it out"
            )
    if name in _PROFILE_FILES and mode == "Server":
        return (
            "a discoveryProtocol CLIENT or SERVER in its default participant profile replaces the operator's two servers, and "
            "transports without UDP do not reach them, so other components are not found; leave discovery out of the file, and UDP in it"
        )
    if name == "FASTDDS_ENVIRONMENT_FILE":
        return "of what the file sets too, the operator's variables count; write those in env"
    return ""


def _cyclone_text(spec: RobotAppSpec, text: str) -> str:
    """Returns what of the joined configuration is not as the operator wrote it: unicast both ways, in any domain."""
    for element, value in _UNICAST.findall(text):
        if value != _UNICAST_VALUES[element]:
            return (
                f"{element} {value} replaces the operator's {_UNICAST_VALUES[element]}, without which peers are not found "
                "where the network carries no multicast; remove the element"
            )
    if domain := _CYCLONE_DOMAIN.search(text):
        number = spec.ros2.domain if spec.ros2 else None
        if number != int(domain[1]):
            return f'it is for domain {domain[1]} alone, and the operator chooses the app\'s domain; write <Domain Id="any">'
    return ""


def _zenoh_text(name: str, value: str) -> str:
    if name == "ZENOH_SESSION_CONFIG_URI":
        return (
            f"of the file's {' and '.join(_ZENOH_KEYS)} the operator's values in ZENOH_CONFIG_OVERRIDE count; "
            "write them there to replace those"
        )
    if name == "ZENOH_CONFIG_OVERRIDE":
        keys = {part.partition("=")[0].strip() for part in value.split(";")}
        if lost_keys := [key for key in _ZENOH_KEYS if key in keys]:
            return (
                f"{' and '.join(lost_keys)} replaces the operator's, so the container may not reach the app's router; "
                "remove it unless it does"
            )
    return ""


def is_joined(variable: Mapping[str, Any]) -> bool:
    """Decides whether a container's own value is joined with the operator's: not one that may be absent, because its
    reference would stand in the joined value as it is.
    """
    source = variable.get("valueFrom") or {}
    optional = any(isinstance(part, Mapping) and part.get("optional") for part in source.values())
    return str(variable.get("name", "")) in SEPARATORS and not optional


def _unjoined_text(spec: RobotAppSpec, name: str, variable: Mapping[str, Any]) -> str:
    if name not in SEPARATORS or name not in discovery_variables(spec) or is_joined(variable):
        return ""
    return "an optional value is not joined with the operator's but replaces it; leave optional out"
