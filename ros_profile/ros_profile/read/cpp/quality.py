"""QoS arguments of publishers and subscriptions in C++."""

import re

from ros_profile.knowledge.qos_presets import preset, with_depth
from ros_profile.model.endpoints import Qos
from ros_profile.read.cpp.times import duration

_PRESETS = (
    (re.compile(r"SensorDataQoS|qos_profile_sensor_data|SENSOR_DATA"), "sensor_data"),
    (re.compile(r"SystemDefaultsQoS|qos_profile_system_default|SYSTEM_DEFAULT"), "system_default"),
    (re.compile(r"ServicesQoS|qos_profile_services"), "services_default"),
    (re.compile(r"ParametersQoS|qos_profile_parameters"), "parameters"),
    (re.compile(r"BestAvailableQoS|qos_profile_best_available"), "best_available"),
    (re.compile(r"\bqos_profile_default\b"), "default"),
)
_DEPTH = re.compile(r"^(?:rclcpp::)?(?:QoS\s*[({]\s*)?(?:rclcpp::)?(?:KeepLast\s*[({]\s*)?(\d{1,6})\s*[)}]*")
_KEEP_LAST = re.compile(r"(?:KeepLast|keep_last)\s*[({]\s*(\d{1,6})")
_DEADLINE = re.compile(r"\.deadline\s*\(((?:[^()]|\([^()]*\)){1,120})\)")
_LIVELINESS = re.compile(r"(?:liveliness\w*\W{0,40}?|LIVELINESS_)(automatic|manual_by_topic)", re.IGNORECASE)


def qos_of(argument: str, code: str) -> Qos | None:
    """What a QoS argument states; that of a variable is looked up in the file. None when it cannot be told."""
    text = argument
    if re.fullmatch(r"\w+", argument) and not argument.isdigit():
        text = _definition(argument, code)
        if not text:
            return None
    for pattern, name in _PRESETS:
        if pattern.search(text):
            return _adjusted(preset(name), text)
    match = _DEPTH.match(text)
    if match or "QoS" in text:
        depth = int(match.group(1)) if match else -1
        return _adjusted(with_depth(depth), text)
    return None


def _definition(name: str, code: str) -> str:
    found = re.search(rf"\b{re.escape(name)}\s*(?:=|\(|\{{)([^;]{{1,300}});", code)
    if found is None:
        return ""
    changes = re.findall(rf"\b{re.escape(name)}(\.\w{{1,30}}\([^;]{{0,100}}\));", code)
    return found.group(1) + "".join(changes)


def _adjusted(qos: Qos, text: str) -> Qos:
    lower = text.lower()
    deadline = _DEADLINE.search(text)
    depth = _KEEP_LAST.search(text)
    liveliness = _LIVELINESS.search(text)
    return Qos(
        profile=qos.profile,
        reliability="best_effort" if "best_effort" in lower.replace("besteffort", "best_effort")
        else "reliable" if re.search(r"\breliable\b|reliability_reliable|policy::reliable", lower) else qos.reliability,
        durability="transient_local" if "transient_local" in lower or "transientlocal" in lower else qos.durability,
        history="keep_all" if "keep_all" in lower or "keepall" in lower else qos.history,
        liveliness=liveliness.group(1).lower() if liveliness else qos.liveliness,
        depth=int(depth.group(1)) if depth else qos.depth,
        deadline_s=duration(deadline.group(1), {}).seconds if deadline else qos.deadline_s,
    )  # fmt: skip
