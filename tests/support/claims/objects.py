"""Factories for claims tests: the fewest fields that mean something."""

from typing import Any

import msgspec

from robotapp_api.model.names import API_VERSION, Annotation, Label
from robotapp_claims.rules.identity import claim_name, device_spec, domain_spec, holder_of_app, holder_of_pod
from robotapp_claims.rules.objects import (
    Claim,
    ClaimSpec,
    ClaimStatus,
    Container,
    Deployment,
    DeploymentSpec,
    EnvVar,
    Holder,
    Job,
    JobCondition,
    JobMeta,
    JobSpec,
    JobStatus,
    Meta,
    OwnerReference,
    Pod,
    PodSpec,
    PodStatus,
    ReplicaSet,
    ReplicaSetStatus,
    Template,
)

Json = dict[str, Any]


def app_holder(uid: str = "app-1", *, instance: str = "", component: str = "", name: str = "teleop") -> Holder:
    return holder_of_app(namespace="team", name=name, uid=uid, instance=instance, component=component)


def pod_holder(uid: str = "pod-1", name: str = "pod") -> Holder:
    return holder_of_pod(namespace="team", name=name, uid=uid)


def claim(spec: ClaimSpec, *, version: str = "1", phase: str = "Reserved", pod: str = "", uid: str = "c1") -> Claim:
    return Claim(
        metadata=Meta(name=claim_name(spec), uid=uid, resource_version=version),
        spec=spec,
        status=ClaimStatus(phase=phase, pod=pod),
    )


def domain_claim(
    number: int,
    holder: Holder | None = None,
    *,
    pool: str = "default",
    phase: str = "Reserved",
    nodes: tuple[str, ...] = (),
    confirmed: bool = False,
) -> Claim:
    """nodes: where its pods may run. confirmed: an admin says that none do."""
    spec = domain_spec(pool=pool, scope="Cluster", scope_value="", domain_id=number, holder=holder or app_holder())
    found = claim(spec, phase=phase)
    annotations = {str(Annotation.PODS_GONE): str(found.status.attempt)} if confirmed else {}
    return msgspec.structs.replace(
        found,
        metadata=msgspec.structs.replace(found.metadata, annotations=annotations),
        status=msgspec.structs.replace(found.status, nodes=nodes),
    )


def device_claim(
    device: str = "can-can0",
    holder: Holder | None = None,
    *,
    node: str = "edge-1",
    phase: str = "Reserved",
    pod: str = "",
) -> Claim:
    spec = device_spec(
        node=node, device_type="can", device_id=device, identity="", holder=holder or app_holder(component="driver")
    )
    return claim(spec, phase=phase, pod=pod)


def labels(uid: str = "app-1", instance: str = "", component: str = "driver", app: str = "teleop") -> dict[str, str]:
    return {
        str(Label.APP): app,
        str(Label.APP_UID): uid,
        str(Label.INSTANCE): instance,
        str(Label.COMPONENT): component,
    }


def owned_by(of: dict[str, str]) -> tuple[OwnerReference, ...]:
    """The owner that labels promise. A chain of one link proves as much as Kubernetes' own of three."""
    uid, name = of.get(Label.APP_UID, ""), of.get(Label.APP, "")
    if not uid:
        return ()
    return (OwnerReference(api_version=API_VERSION, kind="RobotApp", name=name, uid=uid, controller=True),)


def owners_json(of: dict[str, str]) -> list[Json]:
    found: list[Json] = msgspec.to_builtins(owned_by(of))
    return found


def pod_spec(*numbers: int | str, node: str = "") -> PodSpec:
    containers = tuple(Container(env=(EnvVar(name="ROS_DOMAIN_ID", value=str(number)),)) for number in numbers)
    return PodSpec(containers=containers or (Container(),), node_name=node)


def pod(
    *numbers: int | str,
    uid: str = "pod-1",
    name: str = "pod",
    node: str = "",
    phase: str = "Pending",
    of: dict[str, str] | None = None,
    annotations: dict[str, str] | None = None,
) -> Pod:
    return Pod(
        metadata=Meta(
            name=name,
            namespace="team",
            uid=uid,
            labels=labels() if of is None else of,
            annotations=annotations or {},
            owner_references=owned_by(labels() if of is None else of),
        ),
        spec=pod_spec(*numbers, node=node),
        status=PodStatus(phase=phase),
    )


def deployment(
    *numbers: int | str,
    name: str = "teleop-driver",
    of: dict[str, str] | None = None,
    version: str = "1",
    claim: str = "",
    replicas: int = 1,
) -> Deployment:
    annotations = {str(Annotation.DOMAIN_CLAIM): claim} if claim else {}
    return Deployment(
        metadata=Meta(
            name=name,
            namespace="team",
            uid=f"uid-{name}",
            resource_version=version,
            labels=labels() if of is None else of,
            owner_references=owned_by(labels() if of is None else of),
        ),
        spec=DeploymentSpec(
            template=Template(metadata=Meta(annotations=annotations), spec=pod_spec(*numbers)), replicas=replicas
        ),
    )


def replica_set(*numbers: int, wanted: int = 1, present: int = 1, of: dict[str, str] | None = None) -> ReplicaSet:
    of = labels() if of is None else of
    return ReplicaSet(
        metadata=Meta(name="rs", namespace="team", uid="rs-1", labels=of, owner_references=owned_by(of)),
        spec=DeploymentSpec(template=Template(spec=pod_spec(*numbers)), replicas=wanted),
        status=ReplicaSetStatus(replicas=present),
    )


def job(
    *numbers: int | str,
    component: str = "save",
    of: dict[str, str] | None = None,
    verdict: str = "",
    created: str = "2026-01-01T00:00:00Z",
    generation: int = 1,
) -> Job:
    """A Job of a component; verdict: Complete or Failed for one that has ended, a minute after it was created."""
    of = (labels() if of is None else of) | {str(Label.COMPONENT): component}
    ended = JobCondition(type=verdict, status="True", last_transition_time=created.replace(":00Z", ":59Z"))
    return Job(
        metadata=JobMeta(
            name=f"teleop-{component}",
            namespace="team",
            uid=f"uid-{component}",
            resource_version="1",
            labels=of,
            annotations={str(Annotation.APP_GENERATION): str(generation)},
            owner_references=owned_by(of),
            creation_timestamp=created,
        ),
        spec=JobSpec(template=Template(spec=pod_spec(*numbers))),
        status=JobStatus(conditions=(ended,) if verdict else ()),
    )


# JSON for the store


def pool_json(ids: str = "1-3", *, name: str = "default", quarantine_s: int = 1, **spec: Any) -> Json:
    return {
        "metadata": {"name": name},
        "spec": {"scope": "Cluster", "network": name, "ids": ids, "quarantineSeconds": quarantine_s, "reserved": [0]}
        | spec,
    }


def node_json(name: str, *, ready: bool = True, **labels: str) -> Json:
    conditions = [{"type": "Ready", "status": "True" if ready else "Unknown"}]
    return {"metadata": {"name": name, "labels": labels}, "status": {"conditions": conditions}}


def app_json(name: str = "teleop", **spec: Any) -> Json:
    return {
        "metadata": {"name": name, "namespace": "team"},
        "spec": {"components": [{"name": "driver", "image": "x"}]} | spec,
    }


def env_json(number: int | None) -> list[Json]:
    return [] if number is None else [{"name": "ROS_DOMAIN_ID", "value": str(number)}]


def deployment_json(
    number: int | None,
    *,
    uid: str,
    name: str = "teleop-driver",
    instance: str = "",
    replicas: int = 1,
    claim: str = "",
    app: str = "teleop",
) -> Json:
    template: Json = {"spec": {"containers": [{"name": "main", "env": env_json(number)}]}}
    if claim:
        template["metadata"] = {"annotations": {str(Annotation.DOMAIN_CLAIM): claim}}
    return {
        "metadata": {
            "name": name,
            "namespace": "team",
            "labels": labels(uid, instance, app=app),
            "ownerReferences": owners_json(labels(uid, app=app)),
        },
        "spec": {"replicas": replicas, "template": template},
    }


def pod_json(
    number: int | None = None,
    *,
    name: str,
    uid: str = "",
    instance: str = "",
    component: str = "driver",
    node: str = "",
    phase: str = "Pending",
    annotations: dict[str, str] | None = None,
    app: str = "teleop",
) -> Json:
    """A pod of the app with this uid, or a bare one when uid is empty."""
    spec: Json = {"containers": [{"name": "main", "env": env_json(number)}]}
    if node:
        spec["nodeName"] = node
    return {
        "metadata": {
            "name": name,
            "namespace": "team",
            "labels": labels(uid, instance, component, app) if uid else {},
            "annotations": annotations or {},
            "ownerReferences": owners_json(labels(uid, app=app)),
        },
        "spec": spec,
        "status": {"phase": phase},
    }
