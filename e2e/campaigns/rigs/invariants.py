"""What must hold at every moment, read from the API server: no domain or device twice, every running pod backed by its claim."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from robotapp_api.model.names import API_VERSION, Annotation, Label
from robotapp_testbed import ControlPlane

Object = Mapping[str, Any]
_ENDED = {"Succeeded", "Failed"}


def claims(cp: ControlPlane) -> list[Object]:
    return list(cp.api.get(f"/apis/{API_VERSION}/robotclaims")["items"])


def pods(cp: ControlPlane, namespace: str) -> list[Object]:
    return list(cp.api.get(f"/api/v1/namespaces/{namespace}/pods")["items"])


def violations(cp: ControlPlane, namespace: str) -> list[str]:
    """Every broken rule, in words. Pods are read after the claims: a pod that runs then was bound to a claim read before
    or after, so a missing claim is looked up once more before it is called missing."""
    found, running = claims(cp), pods(cp, namespace)
    return broken_rules(found, running) and broken_rules(claims(cp), running)


def broken_rules(found: Iterable[Object], running: Iterable[Object]) -> list[str]:
    """The rules that these claims and pods break, in words. Pods that ended or have no node yet use nothing."""
    live = [pod for pod in running if pod["status"].get("phase") not in _ENDED and pod["spec"].get("nodeName")]
    return [*_unbacked(live, _by_thing(found)), *_shared(live)]


def domain_of(pod: Object) -> str:
    """The literal domain a pod's first container joins, or ""."""
    variables = pod["spec"]["containers"][0].get("env", [])
    return next((each.get("value", "") for each in variables if each["name"] == "ROS_DOMAIN_ID"), "")


def holder_of(pod: Object) -> tuple[str, str]:
    """(uid, instance) of what a pod's claims must be held by: its app, or a bare pod itself."""
    metadata = pod["metadata"]
    labels = metadata.get("labels", {})
    return labels.get(Label.APP_UID) or metadata["uid"], labels.get(Label.INSTANCE, "")


def _by_thing(found: Iterable[Object]) -> dict[str, tuple[str, str]]:
    """Claim of a domain (by name, and by number alone) or device ("node/id") → (holder uid, instance).

    The server itself keeps names unique. Numbers repeat where there are several pools: they serve pods that name no claim.
    """
    things = {}
    for claim in found:
        spec, holder = claim["spec"], claim["spec"]["holder"]
        device, domain = spec.get("device"), spec.get("domain")
        names = [f"{device['node']}/{device['id']}"] if device else [claim["metadata"]["name"], str(domain["id"])]
        things.update(dict.fromkeys(names, (holder["uid"], holder.get("instance", ""))))
    return things


def _unbacked(live: Iterable[Object], held: Mapping[str, tuple[str, str]]) -> list[str]:
    broken = []
    for pod in live:
        for thing in things_of(pod):
            if held.get(thing) != holder_of(pod):
                name = pod["metadata"]["name"]
                broken.append(f"{name} of {holder_of(pod)} runs with {thing}, which is claimed by {held.get(thing)}")
    return broken


def _shared(live: Iterable[Object]) -> list[str]:
    """Domains in use by more than one (app, instance), devices by more than one pod, be they of one component.

    A pod that terminates still counts: its driver may be moving the robot.
    """
    users: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for pod in live:
        metadata = pod["metadata"]
        for domain in _domains_of(pod):
            users[domain].add(holder_of(pod))
        for device in _devices_of(pod):
            users[device].add((metadata["name"], metadata["uid"]))
    return [f"{thing} is used by {sorted(who)}" for thing, who in users.items() if len(who) > 1]


def things_of(pod: Object) -> list[str]:
    """Names of the claims a pod needs: its domain and its devices."""
    return [*_domains_of(pod), *_devices_of(pod)]


def _domains_of(pod: Object) -> list[str]:
    """The claim of the literal domain of an app's pod, and of what a bare pod was granted from the default pool.

    A literal in a pod that has neither an app nor a claim is nobody's business: the pod is not ours.
    """
    labels, annotations = (pod["metadata"].get(field, {}) for field in ("labels", "annotations"))
    granted, claim = annotations.get(Annotation.GRANTED_DOMAIN), annotations.get(Annotation.DOMAIN_CLAIM)
    if granted:
        return [f"dds.default.c.{granted}"]
    domain = domain_of(pod)
    return [claim or domain] if domain and (claim or labels.get(Label.APP_UID)) else []


def _devices_of(pod: Object) -> list[str]:
    """Devices granted to the pod alone, as "node/id"; shared ones are never granted."""
    granted = pod["metadata"].get("annotations", {}).get(Annotation.GRANTED_DEVICES, "")
    return [f"{pod['spec']['nodeName']}/{each}" for each in granted.split(",") if each]
