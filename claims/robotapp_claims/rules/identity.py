"""Names of claims, holders and grants. The name of a claim follows from the claimed thing, so only one can be created."""

import hashlib
import re
from collections.abc import Collection, Iterable
from enum import StrEnum
from functools import lru_cache
from typing import Any, Final, Protocol

from robotapp_api.model.names import API_VERSION, Annotation, Label
from robotapp_api.values.naming import DNS_LABEL
from robotapp_claims.rules.objects import ClaimSpec, DeviceThing, DomainThing, Holder

UNKNOWN_DEVICE_TYPE: Final = "unknown"
"""Type that is written when only node and id of a device are known: a grant has no more."""
_DOMAIN_LITERAL: Final = re.compile(r"0|[1-9][0-9]{0,2}")


def hash10(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def domain_literal(text: str) -> int | None:
    """The id in plain decimal, None for any other notation (`010`, `0x8`, ` 8`), which ROS may accept."""
    return int(text) if _DOMAIN_LITERAL.fullmatch(text) else None


def scope_part(scope: str, scope_value: str) -> str:
    """`c` for the cluster, else `z` or `n` and the hash of the zone's or node's name."""
    return "c" if scope == "Cluster" else f"{scope[0].lower()}{hash10(scope_value)}"


def claim_name_domain(pool: str, scope: str, scope_value: str, domain_id: int) -> str:
    return f"dds.{pool}.{scope_part(scope, scope_value)}.{domain_id}"


def claim_name_device(node: str, device_id: str) -> str:
    return f"dev.n{hash10(node)}.{device_label(device_id)}"


@lru_cache(maxsize=4096)
def device_label(device_id: str) -> str:
    """`device_id` as a DNS label: itself when it is one, else a readable start and a hash of the whole."""
    if DNS_LABEL.fullmatch(device_id):
        return device_id
    start = re.sub(r"[^a-z0-9]+", "-", device_id.lower()).strip("-")[:40].strip("-")
    return f"{start or 'device'}-{hash10(device_id)}"


def claim_name(spec: ClaimSpec) -> str:
    if spec.domain is not None:
        return claim_name_domain(spec.domain.pool, spec.domain.scope, spec.domain.scope_value, spec.domain.id)
    if spec.device is None:
        raise ValueError("a claim is for a domain or a device")
    return claim_name_device(spec.device.node, spec.device.id)


def id_order(ids: Iterable[int], uid: str, instance: str) -> tuple[int, ...]:
    """`ids` in the order in which this instance tries them.

    Two operators serving one instance must try the same id first, and different instances different ones: the first
    keeps an instance from taking two domains, the second keeps 200 apps from queueing for id 1.
    """
    return tuple(sorted(set(ids), key=lambda number: hashlib.sha256(f"{uid}/{instance}/{number}".encode()).digest()))


def holder_of_app(*, namespace: str, name: str, uid: str, instance: str = "", component: str = "") -> Holder:
    return Holder(
        api_version=API_VERSION,
        kind="RobotApp",
        namespace=namespace,
        name=name,
        uid=uid,
        instance=instance,
        component=component,
    )


def holder_of_pod(*, namespace: str, name: str, uid: str) -> Holder:
    return Holder(api_version="v1", kind="Pod", namespace=namespace, name=name, uid=uid)


class Owner(Protocol):
    """The fields that distinguish holders, in any of their types."""

    @property
    def uid(self) -> str: ...
    @property
    def namespace(self) -> str: ...
    @property
    def instance(self) -> str: ...
    @property
    def component(self) -> str: ...


def same_holder(one: Owner, other: Owner) -> bool:
    """The same owner, instance and component. A uid is given to one object of one kind, for ever."""
    return (one.uid, one.namespace, one.instance, one.component) == (
        other.uid,
        other.namespace,
        other.instance,
        other.component,
    )


def same_thing(one: ClaimSpec, other: ClaimSpec) -> bool:
    """The same domain or device. Type and identity of a device describe it; node and id name it."""
    if one.device is not None and other.device is not None:
        return (one.device.node, one.device.id) == (other.device.node, other.device.id)
    return one.device is None and other.device is None and one.domain == other.domain


class Found(StrEnum):
    """Whose claim exists when a create got 409."""

    MINE = "Mine"
    TAKEN = "Taken"
    COLLISION = "Collision"
    """Another thing with the same hash in its name: refused, which is safe."""


def same_tuple(wanted: ClaimSpec, existing: ClaimSpec) -> Found:
    if not same_thing(wanted, existing):
        return Found.COLLISION
    return Found.MINE if same_holder(wanted.holder, existing.holder) else Found.TAKEN


def domain_spec(*, pool: str, scope: str, scope_value: str, domain_id: int, holder: Holder) -> ClaimSpec:
    return ClaimSpec(holder=holder, domain=DomainThing(pool=pool, scope=scope, scope_value=scope_value, id=domain_id))


def device_spec(*, node: str, device_type: str, device_id: str, identity: str, holder: Holder) -> ClaimSpec:
    thing = DeviceThing(node=node, type=device_type, id=device_label(device_id), identity=identity)
    return ClaimSpec(holder=holder, device=thing)


def thing_text(spec: ClaimSpec) -> str:
    """The claimed thing for people: `domain 7 of default`, `can-can0 on edge-1`."""
    if spec.domain is not None:
        where = f" in {spec.domain.scope_value}" if spec.domain.scope_value else ""
        return f"domain {spec.domain.id} of {spec.domain.pool}{where}"
    assert spec.device is not None  # noqa: S101 - claim_name() refuses anything else before this is shown
    return f"{spec.device.id} on {spec.device.node}"


def claim_object(spec: ClaimSpec) -> dict[str, Any]:
    """The RobotClaim to create. Printed texts are annotations: they stay outside the tuple compared on 409."""
    holder = spec.holder
    labels = {Label.CLAIM: "dds" if spec.domain else "device", Label.HOLDER_UID: holder.uid}
    if spec.domain:
        labels[Label.POOL] = spec.domain.pool
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotClaim",
        "metadata": {
            "name": claim_name(spec),
            "labels": {str(key): value for key, value in labels.items()},
            "annotations": {
                str(Annotation.THING): thing_text(spec),
                str(Annotation.HOLDER): f"{holder.namespace}/{holder.name}",
            },
        },
        "spec": _spec_object(spec),
    }


def _spec_object(spec: ClaimSpec) -> dict[str, Any]:
    thing: dict[str, Any]
    if spec.domain:
        domain = spec.domain
        thing = {
            "domain": {
                "pool": domain.pool,
                "scope": domain.scope,
                "scopeValue": domain.scope_value,
                "id": domain.id,
            }
        }
    else:
        device = spec.device
        assert device is not None  # noqa: S101 - claim_name() has refused a spec without thing
        thing = {
            "device": {"node": device.node, "type": device.type, "id": device.id, "identity": device.identity},
        }
    holder = spec.holder
    return thing | {
        "holder": {
            "apiVersion": holder.api_version,
            "kind": holder.kind,
            "namespace": holder.namespace,
            "name": holder.name,
            "uid": holder.uid,
            "instance": holder.instance,
            "component": holder.component,
        }
    }


def holder_text(holder: Holder, *, for_namespace: str) -> str:
    """The holder, as an Event or condition in `for_namespace` shows it."""
    shown = shown_name(holder.namespace, holder.name, for_namespace=for_namespace)
    if holder.namespace != for_namespace:
        return shown
    kind = "pod " if not holder.is_app else ""
    return f"{kind}{shown}" + (f" ({holder.instance})" if holder.instance else "")


def shown_name(namespace: str, name: str, *, for_namespace: str) -> str:
    """`namespace/name` for readers of that namespace: tenants do not see each other's names."""
    return f"{namespace}/{name}" if namespace == for_namespace else "another namespace"


def grants(*, domain: int | None = None, devices: Collection[str] = (), shared: Collection[str] = ()) -> dict[str, str]:
    """Annotations for the Binding with the pod's grants. devices: those it holds exclusively."""
    given: dict[str, str] = {}
    if domain is not None:
        given[str(Annotation.GRANTED_DOMAIN)] = str(domain)
    if devices:
        given[str(Annotation.GRANTED_DEVICES)] = ",".join(sorted(device_label(device) for device in devices))
    if shared:
        given[str(Annotation.GRANTED_SHARED)] = ",".join(sorted(device_label(device) for device in shared))
    return given


def granted_domain(annotations: dict[str, str]) -> int | None:
    return domain_literal(annotations.get(Annotation.GRANTED_DOMAIN, ""))


def granted_devices(annotations: dict[str, str]) -> frozenset[str]:
    return _names(annotations.get(Annotation.GRANTED_DEVICES, ""))


def shared_devices(annotations: dict[str, str]) -> frozenset[str]:
    """Devices that a pod uses together with others; no claim stands for them."""
    return _names(annotations.get(Annotation.GRANTED_SHARED, ""))


def _names(text: str) -> frozenset[str]:
    return frozenset(part for part in text.split(",") if part)
