"""Workloads of the thesis' time to RobotApps."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from rigel_bridge.document.distros import distros, ros_version
from rigel_bridge.document.failures import BridgeError, Place
from rigel_bridge.document.naming import MAX_APP_NAME, MAX_COMPONENT_NAME, label
from rigel_bridge.document.section import Section
from rigel_bridge.document.template import Templates
from rigel_bridge.document.tree import Node, parse
from rigel_bridge.migration.found import Workload
from rigel_bridge.migration.podspec import fields
from rigel_bridge.names import API_VERSION, DEFAULT_SCHEDULER, MAX_DOMAIN, PROVENANCE
from rigel_bridge.render import scheduling
from rigel_bridge.render.draft import Draft, written
from rigel_bridge.render.ros import ADDRESSES, OWN_MASTER
from rigel_bridge.render.schema import problems, robotapp_schema

_BLOCKS: Final = {"shared-data": "shared_data", "dds-domain": "dds_domain"}


@dataclass(frozen=True, slots=True)
class Migrated:
    """One RobotApp to be, what it comes from, and what differs."""

    app: dict[str, Any]
    workloads: tuple[Workload, ...]
    notes: tuple[str, ...]
    lost: tuple[str, ...]
    """Fields a RobotApp has no place for: the user must look at them."""


@dataclass(slots=True)
class _Work:
    draft: Draft
    notes: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)


def migrated(group: Sequence[Workload], *, distro: str = "", name: str = "") -> Migrated:
    """One app of a group of workloads; BridgeError that names the workload and what is wrong with it."""
    work = _Work(Draft(Place(group[0].title)))
    names = _component_names(group)
    _ros(group, work, distro)
    work.draft.spec["components"] = [{"name": each} for each in names]
    for index, workload in enumerate(group):
        _component(workload, work, index, names=dict(zip((one.name for one in group), names, strict=True)))
    _check(work.draft)
    chosen = label(name or group[0].name)[:MAX_APP_NAME].strip("-")
    metadata = {
        "name": chosen,
        "namespace": group[0].namespace,
        "annotations": {f"{PROVENANCE}migrated-from": ", ".join(each.title for each in group)[:1000]},
    }
    app = {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": metadata, "spec": work.draft.spec}
    return Migrated(app, tuple(group), tuple(work.notes), tuple(work.lost))


def grouped(workloads: Sequence[Workload]) -> list[list[Workload]]:
    """Workloads that name one another as peers, in one namespace, are one app; every other is one of its own."""
    groups: list[list[Workload]] = []
    for workload in workloads:
        linked = [group for group in groups if any(_linked(workload, other) for other in group)]
        merged = [workload, *(other for group in linked for other in group)]
        groups = [group for group in groups if group not in linked] + [merged]
    order = {each.title: index for index, each in enumerate(workloads)}
    return sorted(
        (sorted(group, key=lambda each: order[each.title]) for group in groups), key=lambda group: order[group[0].title]
    )


def _linked(one: Workload, other: Workload) -> bool:
    if one.namespace != other.namespace:
        return False
    return any(_names(peer, other) for peer in _peers(one)) or any(_names(peer, one) for peer in _peers(other))


def _names(peer: str, workload: Workload) -> bool:
    """A peer is named by its Deployment, or by a pod of it: teleop-ui-7c9f-x2x4z."""
    return peer == workload.name or bool(re.fullmatch(re.escape(workload.name) + r"-[a-z0-9]{6,10}-[a-z0-9]{5}", peer))


def _peers(workload: Workload) -> list[str]:
    try:
        peers = json.loads(workload.annotations.get("shared-data", "{}")).get("peer_pods", [])
        return [str(peer) for peer in peers]
    except (ValueError, AttributeError, TypeError):
        return []


def _component_names(group: Sequence[Workload]) -> list[str]:
    names: list[str] = []
    for workload in group:
        name = label(workload.name)[:MAX_COMPONENT_NAME].strip("-")
        if name in names:
            raise _wrong(workload, f"becomes component {name}, which another workload of the app already is")
        names.append(name)
    return names


def _ros(group: Sequence[Workload], work: _Work, distro: str) -> None:
    stated = distro or next((guess for each in group if (guess := _distro(each))), "")
    if not stated:
        raise _wrong(
            group[0], "names no ROS distribution, neither by ROS_DISTRO nor by its image; give it with --distro"
        )
    if not distro:
        work.notes.append(f"ros.distro {stated} is taken from the image or ROS_DISTRO; --distro says otherwise")
    work.draft.spec["ros"] = {"distro": stated}


def _distro(workload: Workload) -> str:
    container = workload.template["spec"]["containers"][0]
    texts = [str(each.get("value", "")) for each in container.get("env", ()) if each["name"] == "ROS_DISTRO"]
    words = re.split(r"[^a-z]+", " ".join([*texts, str(container.get("image", ""))]).lower())
    return next((word for word in words if word in distros()), "")


def _component(workload: Workload, work: _Work, index: int, *, names: Mapping[str, str]) -> None:
    containers = workload.template["spec"]["containers"]
    if len(containers) > 1:
        more = ", ".join(str(each["name"]) for each in containers[1:])
        raise _wrong(
            workload,
            f"has more containers than one ({more}), of which migration carries over one: split the Deployment first, or write the "
            "RobotApp by hand with the others under template.spec.containers",
        )
    found = fields(workload.template)
    target = work.draft.spec["components"][index]
    target.update(found.component)
    if workload.replicas != 1:
        target["replicas"] = workload.replicas
    work.lost += [f"{workload.title}: {each}" for each in found.lost]
    _wishes(workload, work, index, names)
    kept = [entry for entry in found.env if not _lifted(entry, workload, work)]
    if kept:
        target["env"] = kept


def _wishes(workload: Workload, work: _Work, index: int, names: Mapping[str, str]) -> None:
    """The annotations in the words of a scheduler block, which they share."""
    place = Place(workload.title)
    mapping = {}
    for key, text in workload.annotations.items():
        at = f"{workload.title}: annotation {key}"
        node = Node(text, Place(at), "", "str", raw=text) if key == "dds-domain" else parse(text.encode(), at)
        if key == "shared-data":
            node = _with_components(node, names)
        mapping[_BLOCKS.get(key, key)] = node
    scheduler = workload.template["spec"].get("schedulerName")
    if scheduler and scheduler != DEFAULT_SCHEDULER:
        mapping["name"] = Node(scheduler, place, "schedulerName", "str", raw=scheduler)
    block = Section(Node(mapping, place, "", "map"), Templates())
    scheduling.apply_to_app(block, work.draft)
    scheduling.apply_to_component(block, work.draft, index, names=frozenset(names.values()), alone=True)
    domain = work.draft.spec.get("ros2", {}).get("domain")
    if domain is not None and not scheduling.is_default_domain(domain):
        work.draft.spec["ros2"]["allowUnsafeDomain"] = True
        work.notes.append(f"{workload.title}: domain {domain} is kept, though it is no id that the pool gives out")


def _with_components(node: Node, names: Mapping[str, str]) -> Node:
    """Peers that become components of the same app, under their new names."""
    peers = node.value.get("peer_pods") if isinstance(node.value, dict) else None
    if peers is None or not isinstance(peers.value, list) or not isinstance(node.value, dict):
        return node
    items = [Node(_renamed(str(each.value), names), each.place, each.path, each.kind, each.raw) for each in peers.value]
    return Node({**node.value, "peer_pods": Node(items, peers.place, peers.path, "seq")}, node.place, node.path, "map")


def _renamed(peer: str, names: Mapping[str, str]) -> str:
    for old, new in names.items():
        if peer == old or peer.startswith(f"{old}-"):
            return new
    return peer


def _lifted(entry: Mapping[str, Any], workload: Workload, work: _Work) -> bool:
    """Whether a variable is the operator's now: then it goes into the app's own field, or away, with a note."""
    name, value = entry["name"], str(entry.get("value", ""))
    ros2 = ros_version(work.draft.spec) == 2
    if name in ADDRESSES:
        if name == "ROS_MASTER_URI" and not ros2 and value and not OWN_MASTER.fullmatch(value):
            work.draft.spec["ros1"] = {"master": "External", "uri": value}
        work.notes.append(f"{workload.title}: env {name} goes: the operator sets it")
        return True
    if name == "RMW_IMPLEMENTATION" and value and ros2:
        work.draft.spec.setdefault("ros2", {})["rmw"] = value
        return True
    if name != "ROS_DOMAIN_ID":
        return False
    stated = value.isascii() and value.isdigit() and 0 < int(value[:4]) <= MAX_DOMAIN
    if stated and ros2 and "domain" not in work.draft.spec.get("ros2", {}):
        ros2_fields = work.draft.spec.setdefault("ros2", {})
        ros2_fields["domain"] = int(value)
        if not scheduling.is_default_domain(int(value)):
            ros2_fields["allowUnsafeDomain"] = True
        work.notes.append(
            f"{workload.title}: ROS_DOMAIN_ID {value} becomes the app's domain; leave it out to get a free one"
        )
    else:
        work.notes.append(f"{workload.title}: ROS_DOMAIN_ID {value} goes: the app has a domain of its own")
    return True


def _check(draft: Draft) -> None:
    found = next(problems(draft.spec, robotapp_schema()["properties"]["spec"]), None)
    if found:
        raise BridgeError(draft.origin(found[0]), f"{written(found[0])} {found[1]}")


def _wrong(workload: Workload, message: str) -> BridgeError:
    return BridgeError(Place(workload.title), message)
