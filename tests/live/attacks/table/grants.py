"""Forged grants: a domain or a device, membership in an app, or a sight of one, that nobody gave."""

from typing import Any, Final

from tests.live.attacks.table import kinds
from tests.live.attacks.table.attack import Attack, Json, Kind, Stop
from tests.live.attacks.table.forged_grants import FORGED_GRANTS
from tests.live.attacks.table.kinds import app, apps, domain_claim, pod

_NOTE: Final = "metadata.annotations"
_LABEL: Final = "metadata.labels"
_UID: Final = f'{_LABEL}."robotics.io/app-uid"'
_INSTANCE: Final = f'{_LABEL}."robotics.io/instance"'
_COMPONENT: Final = f'{_LABEL}."robotics.io/component"'
_CLAIM_NOTE: Final = f'{_NOTE}."robotics.io/domain-claim"'
_VICTIM: Final = "11111111-2222-3333-4444-555555555555"


def _pod(key: str, text: str, changes: Json, stop: Stop, good: Json | None = None) -> Attack:
    return Attack(key, text, "tenant", kinds.POD, good or pod(), changes, stop)


def _owner(kind: str, api: str) -> list[Json]:
    return [{"apiVersion": api, "kind": kind, "name": "teleop", "uid": _VICTIM, "controller": True}]


_MEMBER: Final = pod(
    labels={"robotics.io/app-uid": _VICTIM, "robotics.io/instance": "amr-07", "robotics.io/component": "driver"},
    annotations={"robotics.io/domain-claim": "dds.default.c.7"},
)

PODS: Final = (
    *FORGED_GRANTS,
    _pod("member-uid", "a pod with the app-uid of somebody's app", {_UID: _VICTIM}, Stop.MEMBER),
    _pod(
        "member-all",
        "a pod with app-uid, instance and component of somebody's app",
        {_UID: _VICTIM, _INSTANCE: "amr-07", _COMPONENT: "driver"},
        Stop.MEMBER,
    ),
    _pod("member-empty", "a pod with an empty app-uid", {_UID: ""}, Stop.MEMBER),
    _pod("member-long", "a pod with an app-uid that is no uid", {_UID: "a" * 63}, Stop.MEMBER),
    _pod(
        "member-owner-app",
        "a pod with an app-uid and an owner reference to the app",
        {_UID: _VICTIM, "metadata.ownerReferences": _owner("RobotApp", "robotics.io/v1alpha1")},
        Stop.MEMBER,
    ),
    _pod(
        "member-owner-set",
        "a pod with an app-uid and an owner reference to a ReplicaSet",
        {_UID: _VICTIM, "metadata.ownerReferences": _owner("ReplicaSet", "apps/v1")},
        Stop.MEMBER,
    ),
    _pod(
        "member-owner-job",
        "a pod with an app-uid and an owner reference to a Job",
        {_UID: _VICTIM, "metadata.ownerReferences": _owner("Job", "batch/v1")},
        Stop.MEMBER,
    ),
    _pod(
        "member-claim",
        "a pod with an app-uid and the name of a claim",
        {_UID: _VICTIM, _CLAIM_NOTE: "dds.default.c.7"},
        Stop.MEMBER,
    ),
    _pod(
        "member-instance",
        "a pod that bears the instance and then wants the app-uid",
        {_UID: _VICTIM},
        Stop.MEMBER,
        pod(labels={"robotics.io/instance": "amr-07"}),
    ),
    _pod("member-other-app", "a member that goes over to another app", {_UID: "u-2"}, Stop.MEMBER, _MEMBER),
    _pod("member-other-robot", "a member that goes over to another robot", {_INSTANCE: "amr-08"}, Stop.MEMBER, _MEMBER),
    _pod(
        "member-other-component",
        "a member that becomes another component",
        {_COMPONENT: "planner"},
        Stop.MEMBER,
        _MEMBER,
    ),
    _pod(
        "member-other-claim",
        "a member that names another claim",
        {_CLAIM_NOTE: "dds.default.c.8"},
        Stop.MEMBER,
        _MEMBER,
    ),
    _pod("member-no-claim", "a member with an empty claim", {_CLAIM_NOTE: ""}, Stop.MEMBER, _MEMBER),
)


def _spec(key: str, text: str, changes: Json, good: Json | None = None, says: str = "") -> Attack:
    return Attack(key, text, "tenant", kinds.ROBOTAPP, good or app(), changes, Stop.RULE, says=says)


_TEMPLATE: Final = "spec.components[0].template.metadata"
_OPERATORS: Final = "belong to the operator"
_FLEET: Final = apps({"name": "driver", "image": "ros:humble"}, robots={"nodeSelector": {"matchLabels": {"a": "b"}}})

SPECS: Final = (
    _spec(
        "env-domain",
        "an app that sets ROS_DOMAIN_ID itself",
        {"spec.components[0].env": [{"name": "ROS_DOMAIN_ID", "value": "7"}]},
        says="ROS_DOMAIN_ID is set by the operator",
    ),
    _spec("domain-0", "everybody's domain, 0", {"spec.ros2": {"domain": 0}}, says="domain 0 is unsafe"),
    _spec("domain-150", "a domain in the ephemeral ports", {"spec.ros2": {"domain": 150}}, says="domain 150 is unsafe"),
    _spec("domain-233", "a domain beyond the last", {"spec.ros2": {"domain": 233}}, says="less than or equal to 232"),
    _spec(
        "domain-of-all",
        "one domain for every robot",
        {"spec.ros2": {"domain": 7}},
        _FLEET,
        says="would let all of them obey",
    ),
    _spec(
        "template-uid",
        "an app-uid by the template",
        {f'{_TEMPLATE}.labels."robotics.io/app-uid"': _VICTIM},
        says=_OPERATORS,
    ),
    _spec(
        "template-instance",
        "an instance by the template",
        {f'{_TEMPLATE}.labels."robotics.io/instance"': "amr-08"},
        says=_OPERATORS,
    ),
    _spec(
        "template-grant",
        "a grant by the template",
        {f'{_TEMPLATE}.annotations."granted.robotics.io/devices"': "x"},
        says=_OPERATORS,
    ),
    _spec(
        "template-claim",
        "a claim by the template",
        {f'{_TEMPLATE}.annotations."robotics.io/domain-claim"': "x"},
        says=_OPERATORS,
    ),
    _spec(
        "template-request",
        "a request by the template",
        {f'{_TEMPLATE}.annotations."scheduler.robotics.io/dds-domain"': "7"},
        says=_OPERATORS,
    ),
)


def _denied(
    key: str, text: str, kind: Kind, changes: Json, *, who: str = "tenant", name: str = "x", sub: str = ""
) -> Attack:
    return Attack(key, text, who, kind, {}, changes, Stop.RBAC, name=name, subresource=sub)


def _claim(key: str, text: str, number: int, **fields: Any) -> Attack:
    holder = {key: value for key, value in fields.items() if key != "who"}
    return _denied(
        key,
        text,
        kinds.CLAIM,
        domain_claim(number, **holder),
        who=fields.get("who", "tenant"),
        name=f"dds.default.c.{number}",
    )


_SIGHT: Final = {"spec": {"app": "teleop", "appUID": "u-1"}}

OBJECTS: Final = (
    _claim("claim-free", "a claim on a free domain", 9),
    _claim("claim-reserved", "a claim on a reserved domain", 0),
    _claim("claim-unsafe", "a claim on an unsafe domain", 150),
    _claim("claim-victims", "a claim in the name of somebody's app", 7, namespace="victim", uid=_VICTIM),
    _claim("claim-pod", "a claim in the name of a pod", 8, apiVersion="v1", kind="Pod", name="p"),
    _claim("claim-deputy", "a claim, by somebody with every right on our kinds in his namespace", 9, who="deputy"),
    _denied(
        "claim-device",
        "a claim on a device",
        kinds.CLAIM,
        {"spec": {"device": {"node": "robot-1"}}},
        name="dev.n0123456789.can0",
    ),
    _denied(
        "claim-draining",
        "somebody's claim declared free",
        kinds.CLAIM,
        {"status": {"phase": "Draining"}},
        name="dds.default.c.7",
    ),
    _denied("pool-ids", "more ids in the pool", kinds.POOL, {"spec.ids": "0-232"}, name="default"),
    _denied("pool-reserved", "reserved ids set free", kinds.POOL, {"spec.reserved": []}, name="default"),
    _denied("pool-own", "a pool of one's own over the same ids", kinds.POOL, {"spec.ids": "1-101"}, name="mine"),
    _denied(
        "pool-deputy",
        "a pool over the same ids, by somebody with every right on our kinds in his namespace",
        kinds.POOL,
        {"spec.ids": "1-101"},
        who="deputy",
        name="mine",
    ),
    _denied(
        "pool-network",
        "the pool moved to the network of another one",
        kinds.POOL,
        {"spec.network": "x"},
        name="default",
    ),
    _denied(
        "pool-status",
        "a pool shown as neither full nor overlapping",
        kinds.POOL,
        {"status": {"conditions": []}},
        name="default",
        sub="status",
    ),
    _denied(
        "device-invented", "a device that no node has", kinds.TELEMETRY, {"status": {"devices": []}}, name="robot-1"
    ),
    _denied(
        "device-label",
        "a device by a node's label",
        kinds.NODE,
        {f'{_LABEL}."hardware.robotics.io/can-can0"': "true"},
        name="robot-1",
    ),
    _denied("instance-tenant", "an invented RobotAppInstance", kinds.INSTANCE, _SIGHT),
    Attack(
        "instance-deputy",
        "the same, by somebody with every right on our kinds in his namespace",
        "deputy",
        kinds.INSTANCE,
        {"spec": {"app": "mine", "appUID": "u-2"}},
        _SIGHT,
        Stop.INSTANCE,
    ),
)

GRANTS: Final = (*PODS, *SPECS, *OBJECTS)
