"""Pods that bring a grant of their own: each key and value a grant may have, beside whatever could make it look honest."""

from collections.abc import Mapping
from typing import Any, Final

from tests.live.attacks.table import kinds
from tests.live.attacks.table.attack import Attack, Json, Stop
from tests.live.attacks.table.kinds import pod

GRANTED: Final = "granted.robotics.io/"
_VICTIM: Final = "11111111-2222-3333-4444-555555555555"
_DOMAIN: Final = {"dds-domain": "7"}
_DEVICES: Final = {"devices": '{"can-can0": ""}'}
_SHARED: Final = {"shared-devices": '{"can-can0": ""}'}
_UNMADE: Final = r'pods "[^"]+" not found'
"""The answer to a status of a pod that does not exist."""
_STOLEN: Final = f"{Stop.GRANT.message}|cannot (create|update|patch) resource"


def _grant(key: str, text: str, grants: Mapping[str, str], good: Json | None = None, **fields: Any) -> Attack:
    """grants: by the part of the annotation's name behind the slash. owner: kind and API of one that comes with the grant."""
    changes: Json = {f'metadata.annotations."{GRANTED}{name}"': value for name, value in grants.items()}
    if owner := fields.pop("owner", ()):
        changes["metadata.ownerReferences"] = [
            {"apiVersion": owner[1], "kind": owner[0], "name": "teleop", "uid": _VICTIM}
        ]
    return Attack(key, text, fields.pop("who", "tenant"), kinds.POD, good or pod(), changes, Stop.GRANT, **fields)


def _spec(**spec: Any) -> Json:
    honest = pod()
    return honest | {"spec": honest["spec"] | spec}


def _reading(name: str) -> Json:
    path = f"metadata.annotations['{GRANTED}{name}']"
    variable = {"name": "GRANT", "valueFrom": {"fieldRef": {"fieldPath": path}}}
    return _spec(containers=[{"name": "main", "image": "ros:humble", "env": [variable]}])


_VALUES: Final = (
    _grant("grant-domain", "a pod with a granted domain", _DOMAIN),
    _grant("grant-domain-0", "a pod with a grant of everybody's domain", {"dds-domain": "0"}),
    _grant("grant-domain-last", "a pod with a grant of the last domain", {"dds-domain": "232"}),
    _grant("grant-domain-beyond", "a pod with a grant of a domain that there is not", {"dds-domain": "4711"}),
    _grant("grant-domain-zeros", "a pod with a granted domain that is written otherwise", {"dds-domain": "007"}),
    _grant("grant-domain-blank", "a pod with a granted domain between blanks", {"dds-domain": " 7 "}),
    _grant("grant-domain-list", "a pod with two granted domains", {"dds-domain": "7,8"}),
    _grant("grant-domain-auto", "a pod with the word auto for a grant", {"dds-domain": "auto"}),
    _grant("grant-empty", "a pod with an empty grant", {"dds-domain": ""}),
    _grant("grant-devices", "a pod with granted devices", _DEVICES),
    _grant("grant-devices-none", "a pod with a grant of no devices", {"devices": "{}"}),
    _grant("grant-devices-path", "a pod with a granted device and its path", {"devices": '{"can-can0": "/dev/mem"}'}),
    _grant("grant-devices-many", "a pod with a grant of a thousand devices",
           {"devices": "{" + ",".join(f'"usb-{n}": ""' for n in range(1000)) + "}"}),
    _grant("grant-devices-text", "a pod with granted devices that are no JSON", {"devices": "can-can0"}),
    _grant("grant-devices-empty", "a pod with an empty grant of devices", {"devices": ""}),
    _grant("grant-shared", "a pod with a granted share of a device", _SHARED),
    _grant("grant-shared-empty", "a pod with an empty share", {"shared-devices": ""}),
)  # fmt: skip

_NAMES: Final = (
    _grant("grant-unknown", "a pod with a grant of a later version", {"later": "x"}),
    _grant("grant-upper", "a grant in capital letters", {"DDS-Domain": "7"}),
    _grant("grant-long", "a grant with the longest name", {"d" * 63: "7"}),
    _grant("grant-dotted", "a grant whose name goes on", {"dds-domain.v2": "7"}),
    _grant("grant-both", "a pod with both grants", {"dds-domain": "7", "devices": "x"}),
    _grant("grant-all", "a pod with every grant that there is", _DOMAIN | _DEVICES | _SHARED),
)

_BESIDE: Final = (
    _grant("grant-beside-request", "a grant beside the request for it", _DOMAIN,
           pod(annotations={"scheduler.robotics.io/dds-domain": "auto"})),
    _grant("grant-beside-number", "a granted domain beside the request for this number", _DOMAIN,
           pod(annotations={"scheduler.robotics.io/dds-domain": "7"})),
    _grant("grant-beside-need", "granted devices beside the request for them", _DEVICES,
           pod(annotations={"scheduler.robotics.io/affinity":
                            '{"hardware_requirements": [{"type": "can", "interface": "can0"}]}'})),
    _grant("grant-beside-claim", "a granted domain beside the name of its claim", _DOMAIN,
           pod(annotations={"robotics.io/domain-claim": "dds.default.c.7"})),
    _grant("grant-beside-app", "a grant beside the name of somebody's app", _DOMAIN,
           pod(labels={"robotics.io/app": "teleop", "robotics.io/instance": "amr-07"})),
    _grant("grant-owned", "a grant in a pod that a ReplicaSet owns", _DEVICES, owner=("ReplicaSet", "apps/v1")),
    _grant("grant-claimed", "a grant in a pod that says a RobotApp owns it", _DOMAIN,
           owner=("RobotApp", "robotics.io/v1alpha1")),
    _grant("grant-ours", "a grant in a pod of our scheduler", _DOMAIN, _spec(schedulerName="ros-aware-scheduler")),
    _grant("grant-default", "a grant in a pod of kube-scheduler", _DEVICES, _spec(schedulerName="default-scheduler")),
    _grant("grant-gated", "a grant in a pod that a gate holds", _DOMAIN, _spec(schedulingGates=[{"name": "own.io/wait"}])),
    _grant("grant-bound", "granted devices in a pod that names its node", _DEVICES, _spec(nodeName="absent-node")),
    _grant("grant-read", "a granted domain that the container reads", _DOMAIN, _reading("dds-domain")),
    _grant("grant-read-devices", "granted devices that the container reads", _DEVICES, _reading("devices")),
)  # fmt: skip

_OTHERS: Final = (
    _grant("grant-operator", "a granted domain, by a stolen operator token", _DOMAIN, who="operator", says=_STOLEN),
    _grant("grant-operator-devices", "granted devices, by a stolen operator token", _DEVICES, who="operator", says=_STOLEN),
    _grant("grant-scheduler", "a granted domain without a Binding, by a stolen scheduler token", _DOMAIN,
           who="scheduler", subresource="status", says=f"{_STOLEN}|{_UNMADE}"),
    _grant("grant-scheduler-devices", "granted devices without a Binding, by a stolen scheduler token", _DEVICES,
           who="scheduler", subresource="status", says=f"{_STOLEN}|{_UNMADE}"),
)  # fmt: skip

_PROPOSALS: Final = tuple(
    Attack(
        f"better-node-{who}",
        text,
        who,
        kinds.POD,
        pod(),
        {'metadata.annotations."robotics.io/better-node"': '{"node":"edge-2"}'},
        Stop.PROPOSAL,
        **fields,
    )
    for who, text, fields in (
        ("tenant", "a pod with a better node of its own", {}),
        (
            "operator",
            "a better node, by a stolen operator token",
            {"says": f"{Stop.PROPOSAL.message}|cannot (create|update|patch) resource"},
        ),
    )
)

FORGED_GRANTS: Final = (*_VALUES, *_NAMES, *_BESIDE, *_OTHERS, *_PROPOSALS)
