"""Templates that a newer operator wrote: which edits of the user this older one still carries out, and which it holds back.

After a rollback the templates stay as the newer operator rendered them, because a wrong guess would roll every robot.
What must never wait is written into them: replicas (so also `suspend`), the component's image, and what is the protocol's:
the domain id, the scheduler and our gate. Everything else waits, and the status names it.
"""

import copy
import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

from packaging.version import InvalidVersion, Version

from robotapp_api.model.names import SCHEDULING_GATE, WAITING_STEP, Annotation
from robotapp_claims.rules.identity import domain_literal
from robotapp_claims.rules.objects import ROS_DOMAIN_ID
from robotapp_operator.plan.render.child import DEPLOYMENT, Child
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment, Job, Service, pod_annotations, pod_spec

_OLDEST: Final = Version("0.dev0")


def is_newer(one: str, other: str) -> bool:
    """Returns whether version `one` is newer than `other`. An empty or unreadable version is older than every other."""
    return version_key(one) > version_key(other)


def version_key(version: str) -> Version:
    """Returns the version without its local part (`+g12`), which does not count for what is newer."""
    try:
        return Version(Version(version).public)
    except InvalidVersion:
        return _OLDEST


class Held(NamedTuple):
    """A child whose template is not written. `newer` is the version of the operator that wrote it, "" when ours waits for approval."""

    name: str
    newer: str = ""
    ours: str = ""


@dataclasses.dataclass(frozen=True, slots=True)
class Amendment:
    """The decision about a template that a newer operator wrote."""

    spec: dict[str, Any] | None
    """The spec to write, None where the template stays as it is."""
    waits: bool
    """An edit of the user's is not carried out in it."""


def written_by_newer(app: App, over: Deployment | Job | Service, version: str) -> str:
    """Returns the newer operator's version, "" if there is none or the user has approved that ours takes over."""
    writer = over.metadata.annotations.get(Annotation.RENDERED_BY, "")
    approved = app.annotations.get(Annotation.APPROVE_UPDATE) == version
    return writer if is_newer(writer, version) and not approved else ""


def amend(app: App, child: Child, over: Deployment | Service) -> Amendment:
    """Returns the template with what must never wait (see above). A Service has nothing of that kind.

    What the newer operator wrote for this very generation stands, but for a stop: two operators that each insisted on
    their own would write for ever.
    """
    if child.ref.kind != DEPLOYMENT or not isinstance(over, Deployment):
        return Amendment(None, waits=False)
    spec = copy.deepcopy(over.spec)
    seen = over.metadata.annotations.get(Annotation.APP_GENERATION) == str(app.generation)
    if not seen or child.spec["replicas"] == 0:
        _set_replicas(spec, child)
    if not seen:
        _set_image(spec, child)
    _set_domain(spec, child)
    _set_restarts(spec, child)
    _set_binding_rules(spec, child)
    return Amendment(None if spec == over.spec else spec, waits=_edit_waits(app, child, over))


def _set_replicas(spec: dict[str, Any], child: Child) -> None:
    """Sets the replicas; of infrastructure only none or some: a newer operator may want another number of servers."""
    have, wanted = spec.get("replicas", 1), child.spec["replicas"]
    if have == wanted or (child.component == "" and have and wanted):
        return
    spec["replicas"] = wanted
    if (spec.get("strategy") or {}).get("type") != child.spec["strategy"]["type"]:
        spec["strategy"] = child.spec["strategy"]


def _set_image(spec: dict[str, Any], child: Child) -> None:
    """Sets the image of the component's container, and of the init step that runs in the same image."""
    name = child.component
    main = next((item for item in _containers(spec, "containers") if item.get("name") == name), None)
    wanted = next((item for item in _containers(child.spec, "containers") if item["name"] == name), None)
    if main is None or wanted is None or main.get("image") == wanted["image"]:
        return
    for step in _containers(spec, "initContainers"):
        if step.get("name") == WAITING_STEP and step.get("image") == main.get("image"):
            step["image"] = wanted["image"]
    main["image"] = wanted["image"]


def _set_domain(spec: dict[str, Any], child: Child) -> None:
    """Sets the domain id: a template with an id that its instance does not hold would start no pod, or keep pods on
    another's id.
    """
    wanted = {variable["value"] for variable in _domain_variables(child.spec)}
    stale = [variable for variable in _domain_variables(spec) if variable["value"] not in wanted]
    if len(wanted) != 1 or not stale:
        return
    for variable in stale:
        variable["value"] = min(wanted)
    claim = pod_annotations(child.spec).get(Annotation.DOMAIN_CLAIM)
    annotations = spec["template"].setdefault("metadata", {}).setdefault("annotations", {})
    if claim:
        annotations[Annotation.DOMAIN_CLAIM.value] = claim
    else:
        annotations.pop(Annotation.DOMAIN_CLAIM.value, None)


def restarted_spec(child: Child, over: Deployment | Service) -> dict[str, Any] | None:
    """Returns the spec that restarts the pods of a component as they are written, None where a restart is not due."""
    spec = copy.deepcopy(over.spec)
    _set_restarts(spec, child)
    return None if spec == over.spec else spec


def _set_restarts(spec: dict[str, Any], child: Child) -> None:
    """Sets the annotations that restart pods, whoever wrote the template: another start of the ROS 1 master, and
    another attempt.
    """
    for key in (Annotation.MASTER_STARTS, Annotation.ATTEMPT):
        wanted = pod_annotations(child.spec).get(key)
        if wanted and wanted != pod_annotations(spec).get(key) and pod_spec(spec):
            spec["template"].setdefault("metadata", {}).setdefault("annotations", {})[key.value] = wanted


def binding_rules(spec: Mapping[str, Any]) -> tuple[str, bool]:
    """Returns who binds the pods of a Deployment, and whether our gate keeps them until their claim and their nodes
    are checked.
    """
    pod = pod_spec(spec)
    return pod.get("schedulerName") or "", any(gate.get("name") == SCHEDULING_GATE for gate in _gates(pod))


def _set_binding_rules(spec: dict[str, Any], child: Child) -> None:
    """Sets who binds the pods, and our gate: a tenant who edits a Deployment can annotate it with a newer version."""
    if binding_rules(spec) == binding_rules(child.spec) or not pod_spec(spec):
        return
    pod, wanted = spec["template"]["spec"], pod_spec(child.spec)
    pod["schedulerName"] = wanted["schedulerName"]
    gates = [gate for gate in _gates(pod) if gate.get("name") != SCHEDULING_GATE]
    pod["schedulingGates"] = [*gates, *(gate for gate in _gates(wanted) if gate.get("name") == SCHEDULING_GATE)]


def _edit_waits(app: App, child: Child, over: Deployment) -> bool:
    """Returns whether the user has changed something since the template was written that is not carried out in it."""
    marked = over.metadata.annotations.get(Annotation.SPEC_HASH)
    if marked is None:
        return over.metadata.annotations.get(Annotation.APP_GENERATION) != str(app.generation)
    files = (pod_annotations(spec).get(Annotation.PARAMETERS_HASH) for spec in (over.spec, child.spec))
    return marked != app.spec_hashes[child.component] or len(set(files)) > 1


def _containers(spec: Mapping[str, Any], place: str) -> list[dict[str, Any]]:
    return pod_spec(spec).get(place) or []


def _gates(pod: Mapping[str, Any]) -> list[dict[str, Any]]:
    return pod.get("schedulingGates") or []


def _domain_variables(spec: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for place in ("initContainers", "containers"):
        for container in _containers(spec, place):
            for variable in container.get("env") or ():
                if variable.get("name") == ROS_DOMAIN_ID and domain_literal(variable.get("value", "")) is not None:
                    yield variable
