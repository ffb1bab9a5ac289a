"""What is tried to get at devices past their driver: false ResourceSlices, and claims, classes and taints of others."""

from typing import Any, Final

from tests.live.attacks.table import kinds
from tests.live.attacks.table.attack import Attack, Json, Kind, Stop
from tests.live.attacks.table.stolen_agents import NODE, OTHER

from robotapp_claims.rules.device_attributes import DRIVER

ATTACKED: Final = "attacked-devices"
"""Label of cluster-wide objects that an attack may have left."""
_SERIAL: Final = {"name": "serial-0403-6001-a50285bi", "attributes": {"type": {"string": "serial"}}}
_TERM: Final = {"nodeSelectorTerms": [{"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}]}
_REQUEST: Final = "spec.devices.requests[0].exactly"


def _slice(
    key: str, text: str, changes: Json, *, who: str = "kubelet", node: str = NODE, stop: Stop = Stop.SLICE
) -> Attack:
    pool = {"name": node, "generation": 1, "resourceSliceCount": 1}
    good = {
        "metadata": {"labels": {ATTACKED: "true"}},
        "spec": {"driver": DRIVER, "nodeName": node, "pool": pool, "devices": [_SERIAL]},
    }
    return Attack(key, text, who, kinds.RESOURCE_SLICE, good, changes, stop)


def claim_body(**metadata: Any) -> Json:
    exactly = {"deviceClassName": DRIVER, "allocationMode": "ExactCount", "count": 1}
    return {"metadata": metadata, "spec": {"devices": {"requests": [{"name": "arm", "exactly": exactly}]}}}


def _rbac(key: str, text: str, kind: Kind, good: Json, changes: Json, *, who: str = "tenant", name: str = "") -> Attack:
    return Attack(key, text, who, kind, good, changes, Stop.RBAC, name=name)


_ELSEWHERE: Final = {"spec.nodeName": None, "spec.pool.name": "everybody"}
_CLASS: Final = {"metadata": {"labels": {ATTACKED: "true"}}, "spec": {"selectors": [{"cel": {"expression": "true"}}]}}
_RULE: Final = {
    "metadata": {"labels": {ATTACKED: "true"}},
    "spec": {"deviceSelector": {"driver": DRIVER}, "taint": {"key": "a/b", "effect": "NoExecute"}},
}
SLICES: Final = (
    _slice("slice-pool", "hide another node's devices by a slice of its pool", {"spec.pool": {
        "name": OTHER, "generation": 9, "resourceSliceCount": 1}}),
    _slice("slice-pool-invented", "a pool that is no node", {"spec.pool.name": "everybody"}),
    _slice("slice-other-node", "devices of another node", {"spec.nodeName": OTHER, "spec.pool.name": OTHER}),
    _slice("slice-all-nodes", "a device that all nodes reach", {**_ELSEWHERE, "spec.allNodes": True}),
    _slice("slice-all-nodes-own-pool", "the same in the own node's pool", {"spec.nodeName": None, "spec.allNodes": True}),
    _slice("slice-selector", "a device that nodes with a label reach", {**_ELSEWHERE, "spec.nodeSelector": _TERM}),
    _slice("slice-per-device", "devices that name their nodes one by one", {
        **_ELSEWHERE, "spec.perDeviceNodeSelection": True, "spec.devices[0].nodeName": OTHER}),
    _slice("slice-vendor", "devices of a node, under our driver's name", {"spec.pool.generation": 9}, who="vendor"),
    _slice("slice-vendor-pool", "a pool of our driver for all nodes", {**_ELSEWHERE, "spec.allNodes": True}, who="vendor"),
    *(
        _slice(f"slice-{who}", f"promise a device as {who}", {"spec.devices[0].name": "can-can0"}, who=who, stop=Stop.RBAC)
        for who in ("tenant", "clerk", "deputy", "operator", "scheduler", "labeller")
    ),
)  # fmt: skip
CLAIMS: Final = (
    _rbac("class-ours", "have our DeviceClass match devices of others", kinds.DEVICE_CLASS, _CLASS,
          {"spec.selectors": []}, name=DRIVER),
    _rbac("class-extended", "give devices away for a plain limit of a container", kinds.DEVICE_CLASS, _CLASS,
          {"spec.extendedResourceName": "example.com/arm"}),
    _rbac("class-scheduler", "the same with the scheduler's token", kinds.DEVICE_CLASS, _CLASS,
          {"spec.selectors": []}, who="scheduler", name=DRIVER),
    _rbac("taint-rule", "drive pods from devices by a taint", kinds.TAINT_RULE, _RULE, {"spec.taint.value": "x"}),
    _rbac("taint-rule-scheduler", "such a taint with the scheduler's token", kinds.TAINT_RULE, _RULE, {"spec.taint.value": "x"},
          who="scheduler"),
    Attack("claim-admin", "use devices that others have, by admin access", "tenant", kinds.RESOURCE_CLAIM, claim_body(),
           {f"{_REQUEST}.adminAccess": True}, Stop.ADMIN_ACCESS),
    Attack("claim-template-admin", "the same by a template for each pod", "tenant", kinds.CLAIM_TEMPLATE,
           {"spec": {"spec": claim_body()["spec"]}}, {f"spec.{_REQUEST}.adminAccess": True}, Stop.ADMIN_ACCESS),
    _rbac("claim-admin-namespace", "a namespace that allows admin access", kinds.NAMESPACE, {},
          {'metadata.labels."resource.kubernetes.io/admin-access"': "true"}, name="default"),
    _rbac("claim-clerk", "claim a device without a RobotApp", kinds.RESOURCE_CLAIM, claim_body(), {f"{_REQUEST}.count": 2},
          who="clerk"),
)  # fmt: skip
DEVICES: Final = (*SLICES, *CLAIMS)
