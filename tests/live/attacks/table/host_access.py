"""A writer of RobotApps reaches the node: every guarded field of the code's own table, in every kind of container and pod."""

import copy
from collections.abc import Iterator, Mapping
from typing import Any, Final

from tests.live.attacks.table import kinds
from tests.live.attacks.table.attack import Attack, Json, Stop
from tests.live.attacks.table.kinds import app, apps

from robotapp_api.checks.host_access.table import APPARMOR_PREFIX, GUARDED, GuardedField, HostRight, Level

_FURTHER: Final = {"name": "further", "image": "ros:humble"}
_CONTAINERS: Final[Mapping[str, str]] = {
    "component": "spec.components[0]",
    "init container": "spec.components[0].template.spec.initContainers[0]",
    "sidecar": "spec.components[0].template.spec.initContainers[1]",
    "further container": "spec.components[0].template.spec.containers[0]",
    "later component": "spec.components[1]",
    "discovery server": "spec.ros2.discovery",
    "master": "spec.ros1",
}
"""Kind of container → where its fields stand in a RobotApp."""
_PODS: Final[Mapping[str, str]] = {
    "component": "spec.components[0].template.spec",
    "later component": "spec.components[1].template.spec",
    "discovery server": "spec.ros2.discovery.template.spec",
    "master": "spec.ros1.template.spec",
}
_ANNOTATIONS: Final[Mapping[str, str]] = {
    kind: place.removesuffix("spec") + "metadata.annotations" for kind, place in _PODS.items()
}
_SHORT: Final = {
    "component": "own", "init container": "init", "sidecar": "side", "further container": "beside", "later component": "later",
    "discovery server": "server", "master": "master",
}  # fmt: skip
_HELPERS: Final = ("discovery server", "master")
BAD: Final[Mapping[str, Any]] = {
    "hostNetwork": True,
    "hostIPC": True,
    "hostPID": True,
    "volumes[].hostPath": {"path": "/"},
    "ports[].hostPort": 8080,
    "securityContext.sysctls[].name": "kernel.msgmax",
    "securityContext.appArmorProfile.type": "Unconfined",
    "securityContext.seccompProfile.type": "Unconfined",
    "securityContext.seLinuxOptions.type": "spc_t",
    "securityContext.seLinuxOptions.user": "system_u",
    "securityContext.seLinuxOptions.role": "system_r",
    "securityContext.windowsOptions.hostProcess": True,
    "securityContext.privileged": True,
    "securityContext.capabilities.add[]": "SYS_ADMIN",
    "securityContext.procMount": "Unmasked",
    **{
        f"{probe}.{kind}.host": "10.0.0.1"
        for probe in ("livenessProbe", "readinessProbe", "startupProbe", "lifecycle.postStart", "lifecycle.preStop")
        for kind in ("httpGet", "tcpSocket")
    },
    f"annotation {APPARMOR_PREFIX}": "unconfined",
}
"""A forbidden value of every guarded field."""
_REST: Final[Mapping[str, Json]] = {
    "volumes[]": {"name": "v"},
    "ports[]": {"containerPort": 8080, "protocol": "TCP"},
    "sysctls[]": {"value": "1"},
    "httpGet": {"port": 80},
    "tcpSocket": {"port": 80},
}
"""What else an object at such a step needs."""


def containing(path: str, value: Any) -> Json:
    """Returns the object that has `value` at a path of the table, with what the schema wants beside it."""
    step, _, rest = path.partition(".")
    name = step.removesuffix("[]")
    inner = {**_REST.get(step, {}), **containing(rest, value)} if rest else copy.deepcopy(value)
    return {name: [inner] if step.endswith("[]") else inner}


def merged(target: Json, addition: Json) -> Json:
    """Returns both; lists of `addition` replace those of `target`."""
    result = dict(target)
    for key, value in addition.items():
        before = result.get(key)
        result[key] = merged(before, value) if isinstance(before, dict) and isinstance(value, dict) else value
    return result


def honest_app() -> Json:
    """A RobotApp with every kind of container and pod."""
    helper = {"securityContext": {"runAsNonRoot": True}, "template": {"spec": {"nodeSelector": {"zone": "a"}}}}
    template = {
        "metadata": {"annotations": {"example.com/a": "b"}},
        "spec": {
            "initContainers": [_FURTHER | {"name": "first"}, _FURTHER | {"name": "side", "restartPolicy": "Always"}],
            "containers": [_FURTHER],
        },
    }
    return apps(
        {"name": "driver", "image": "ros:humble", "template": template},
        {"name": "other", "image": "ros:humble"},
        ros1=copy.deepcopy(helper),
        ros2={"discovery": copy.deepcopy(helper)},
    )


def places_of(field: GuardedField) -> Mapping[str, str]:
    """Kinds of containers or pods that have the field, with the place of its holder in a RobotApp."""
    if field.level is Level.ANNOTATIONS:
        return _ANNOTATIONS
    places = _PODS if field.level is Level.POD else _CONTAINERS
    of_helpers = field.path.startswith("securityContext.")
    return {kind: place for kind, place in places.items() if of_helpers or kind not in _HELPERS}


def holder_of(field: GuardedField, value: Any) -> Json:
    """Returns what is written at the place of the field's holder."""
    if field.level is Level.ANNOTATIONS:
        return {f"{APPARMOR_PREFIX}driver": value}
    return containing(field.path, value)


def written(field: GuardedField, place: str, value: Any) -> Json:
    """Returns the honest app with one guarded field at one place."""
    result = honest_app()
    target: Any = result
    *steps, last = place.replace("[", ".").replace("]", "").split(".")
    for step in steps:
        target = target[int(step)] if step.isdecimal() else target.setdefault(step, {})
    key: Any = int(last) if last.isdecimal() else last
    before = target[key] if isinstance(target, list) else target.get(key, {})
    target[key] = merged(before, holder_of(field, value))
    return result


def _attacks() -> Iterator[Attack]:
    honest = honest_app()
    for field in GUARDED:
        for kind, place in places_of(field).items():
            yield Attack(
                key=key_of(field, kind),
                text=f"{field.name} of a {kind}" + ("'s pod" if field.level is Level.POD else ""),
                who="editor",
                kind=kinds.ROBOTAPP,
                good=honest,
                changes={"spec": written(field, place, BAD[field.path])["spec"]},
                stop=Stop.HOST,
                says=rf"needs the verb use on robotapps/{field.right.value} in namespace",
            )


def key_of(field: GuardedField, kind: str) -> str:
    """A name for an app with the field in this kind of container: names of RobotApps are short."""
    return f"host{GUARDED.index(field)}-{_SHORT[kind]}"


HOST: Final = tuple(_attacks())
RIGHTS: Final = tuple(right.value for right in HostRight)


def matrix() -> str:
    """The table of docs/security.md: field by kind of container, with the right that it takes."""
    kinds_shown = list(_CONTAINERS)
    rows = [
        f"| {' | '.join(['field', 'verb `use` on', *kinds_shown, 'free values'])} |",
        f"|{'---|' * (len(kinds_shown) + 3)}",
    ]
    for field in GUARDED:
        marks = ["✓" if kind in places_of(field) else "" for kind in kinds_shown]
        values = ("runtime/default", "localhost/*") if field.level is Level.ANNOTATIONS else field.free
        shown = (str(value).lower() if isinstance(value, bool) else str(value) for value in values if value != "")
        free = ", ".join(f"`{value}`" for value in shown)
        level = "" if field.level is Level.ANNOTATIONS else f"{field.level.value}: "
        rows.append(f"| {level}`{field.name}` | `{field.right.resource}` | {' | '.join(marks)} | {free} |")
    return "\n".join(rows) + "\n"


def app_with_everything_free() -> Json:
    """An app whose values are free for every writer wherever a guarded field has such values."""
    result = app()
    component = result["spec"]["components"][0]
    for field in GUARDED:
        if field.path.endswith("tcpSocket.host"):
            continue  # a probe has one handler
        if field.level is Level.CONTAINER and field.free:
            result["spec"]["components"][0] = component = merged(component, containing(field.path, field.free[0]))
        elif field.level is Level.POD and field.free:
            pod = containing(field.path, field.free[0])
            result["spec"]["components"][0] = component = merged(component, {"template": {"spec": pod}})
    return result
