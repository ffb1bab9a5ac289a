"""What of a cluster is of the thesis' time: workloads whose pods have its annotations, and the records its scheduler kept."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rigel_bridge.migration.shape import misshapen
from rigel_bridge.migration.variables import (
    ConfigMaps,
    Variables,
    list_config_maps,
    read_variables,
    referenced_config_maps,
)
from rigel_bridge.names import SCHEDULER_PREFIX, THESIS_SCHEDULER

WISHES: Final = ("policies", "topology", "affinity", "shared-data", "dds-domain")
"""Annotations of pods, without the prefix."""
CLAIMS: Final = ("dds-claims", "device-claims")
"""Annotations of nodes, without the prefix: JSON maps from a domain or device to the uid of its pod."""
FLEET: Final = "robot-fleet-assignments"
MASTER: Final = "ros-master"
"""Deployment of the master that all apps of a namespace shared."""
_STAYING: Final = ("StatefulSet", "DaemonSet", "Job")
"""Kinds with pods that no RobotApp makes."""
_UID: Final = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")

Json = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Workload:
    """A Deployment, or a pod that nothing controls. `template` has the pod's metadata and spec."""

    kind: str
    namespace: str
    name: str
    template: Json
    replicas: int
    stored: Json
    variables: Variables = Variables()  # noqa: RUF009 - frozen, so one for all is no trap
    """ROS variables of its first container."""

    @property
    def title(self) -> str:
        return f"{self.kind.lower()} {self.namespace}/{self.name}"

    @property
    def annotations(self) -> dict[str, str]:
        """Its wishes, by their names without the prefix."""
        every = self.template.get("metadata", {}).get("annotations") or {}
        return {key: every[SCHEDULER_PREFIX + key] for key in WISHES if SCHEDULER_PREFIX + key in every}


@dataclass(frozen=True, slots=True)
class Claim:
    """One entry of a node's record, or of the fleet map (`where` is the ConfigMap's namespace then)."""

    where: str
    kind: str
    thing: str
    uid: str


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that matters for a migration."""

    workloads: tuple[Workload, ...]
    staying: tuple[Workload, ...]
    """Workloads that are not to be migrated."""
    owners: Mapping[str, str]
    """Title of the workload by uid of each of its pods."""
    claims: tuple[Claim, ...]
    notes: tuple[str, ...]


def scene(objects: Sequence[Json], *, names: Sequence[str] = ()) -> Scene:
    """Sort objects of any kinds; those that are none of the thesis' are passed over, unless they are named."""
    by_kind: dict[str, list[Json]] = {}
    for each in objects:
        by_kind.setdefault(str(each.get("kind")), []).append(each)
    notes: list[str] = []
    config_maps = list_config_maps(by_kind.get("ConfigMap", ()))
    workloads, staying = list[Workload](), list[Workload]()
    for each in (*by_kind.get("Deployment", ()), *(pod for pod in by_kind.get("Pod", ()) if not _controller(pod))):
        workload = _workload(each, config_maps)
        (workloads if _is_old(workload.template, each, names) else staying).append(workload)
    staying += [_workload(each, config_maps) for kind in _STAYING for each in by_kind.get(kind, ())]
    notes += [
        f"{each['kind'].lower()} {_title(each)} has the thesis' annotations and stays: a RobotApp makes Deployments"
        for kind in _STAYING
        for each in by_kind.get(kind, ())
        if _is_old(each["spec"]["template"], each, names)
    ]
    notes += [
        f"deployment {_title(each)} stays: a RobotApp of ROS 1 gets a master of its own; delete this one when nobody uses it"
        for each in by_kind.get("Deployment", ())
        if each["metadata"]["name"] == MASTER and MASTER not in names
    ]
    claims = [claim for node in by_kind.get("Node", ()) for claim in _node_claims(node, notes)]
    claims += [claim for each in by_kind.get("ConfigMap", ()) for claim in _fleet(each)]
    staying = [each for each in staying if not _is_of_a_robotapp(each.stored)]
    return Scene(tuple(workloads), tuple(staying), _owners(by_kind, workloads), tuple(claims), tuple(notes))


def _is_old(template: Json, holder: Json, names: Sequence[str]) -> bool:
    """Whether pods of this template are of the thesis' time, or named by the user, and not made by a RobotApp."""
    annotations = template.get("metadata", {}).get("annotations") or {}
    wished = any(SCHEDULER_PREFIX + key in annotations for key in WISHES)
    sent = template["spec"].get("schedulerName") == THESIS_SCHEDULER
    name = holder["metadata"]["name"]
    return (((wished or sent) and name != MASTER) or name in names) and not _is_of_a_robotapp(holder)


def _is_of_a_robotapp(holder: Json) -> bool:
    return any(owner.get("kind") == "RobotApp" for owner in holder["metadata"].get("ownerReferences", ()))


def _workload(obj: Json, config_maps: ConfigMaps) -> Workload:
    """Reads an object with a pod template, or a pod."""
    metadata, spec = obj["metadata"], obj["spec"]
    template = _pod_template(obj) if obj["kind"] == "Pod" else spec["template"]
    namespace = metadata.get("namespace", "")
    return Workload(
        obj["kind"],
        namespace,
        metadata["name"],
        template,
        int(spec.get("replicas", 1)),
        obj,
        read_variables(template["spec"]["containers"][0], namespace, config_maps),
    )


def config_maps_of(stored: Json) -> Iterator[str]:
    """Yields the names of the ConfigMaps that may state ROS variables of a workload, whatever somebody's kubectl wrote."""
    if misshapen(stored) is not None or stored["kind"] not in ("Deployment", "Pod", *_STAYING):
        return
    template = _pod_template(stored) if stored["kind"] == "Pod" else stored["spec"]["template"]
    names = referenced_config_maps(template["spec"]["containers"][0])
    yield from (name for name in names if name != FLEET)


def _pod_template(pod: Json) -> Json:
    metadata = pod["metadata"]
    return {
        "metadata": {key: metadata[key] for key in ("labels", "annotations") if metadata.get(key)},
        "spec": {key: value for key, value in pod["spec"].items() if key != "nodeName"},
    }


def _controller(obj: Json) -> str:
    """The uid of the controlling owner; empty for none."""
    owners = obj["metadata"].get("ownerReferences", ())
    return next((str(owner["uid"]) for owner in owners if owner.get("controller")), "")


def _owners(by_kind: Mapping[str, Sequence[Json]], workloads: Sequence[Workload]) -> dict[str, str]:
    titles = {str(each.stored["metadata"].get("uid", "")): each.title for each in workloads}
    for replica_set in by_kind.get("ReplicaSet", ()):
        if title := titles.get(_controller(replica_set)):
            titles[str(replica_set["metadata"].get("uid", ""))] = title
    found = {}
    for pod in by_kind.get("Pod", ()):
        uid = str(pod["metadata"].get("uid", ""))
        if title := titles.get(_controller(pod)) or titles.get(uid):
            found[uid] = title
    return found


def _node_claims(node: Json, notes: list[str]) -> list[Claim]:
    annotations = node["metadata"].get("annotations") or {}
    found = []
    for kind in CLAIMS:
        text = annotations.get(SCHEDULER_PREFIX + kind)
        if text is None:
            continue
        try:
            entries = json.loads(text)
            found += [Claim(node["metadata"]["name"], kind, str(thing), str(uid)) for thing, uid in entries.items()]
        except (ValueError, AttributeError):
            notes.append(
                f"node {node['metadata']['name']}: annotation {SCHEDULER_PREFIX}{kind} is not a JSON map, and is left alone"
            )
    return found


def _fleet(config_map: Json) -> list[Claim]:
    """Entries by pod uid; the operator's own fleet view has others."""
    metadata = config_map["metadata"]
    if metadata["name"] != FLEET:
        return []
    keys = [key for key in config_map.get("data") or {} if _UID.fullmatch(key)]
    return [Claim(metadata.get("namespace", ""), "fleet", key, key) for key in keys]


def _title(obj: Json) -> str:
    return f"{obj['metadata'].get('namespace', '')}/{obj['metadata']['name']}"
