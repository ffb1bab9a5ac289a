"""Workloads of the thesis' time to RobotApps."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from rigel_bridge.document.distros import ros_version
from rigel_bridge.document.failures import BridgeError, Place
from rigel_bridge.document.naming import MAX_APP_NAME, MAX_COMPONENT_NAME, label
from rigel_bridge.document.section import Section
from rigel_bridge.document.template import Templates
from rigel_bridge.document.tree import Node, parse
from rigel_bridge.migration.found import Workload
from rigel_bridge.migration.podspec import fields
from rigel_bridge.migration.ros_graphs import DEFAULT_RMW, distro_of, uses_own_master
from rigel_bridge.migration.variables import Variable
from rigel_bridge.names import API_VERSION, DEFAULT_SCHEDULER, MAX_DOMAIN, PROVENANCE
from rigel_bridge.render import scheduling
from rigel_bridge.render.draft import Draft, written
from rigel_bridge.render.ros import ADDRESSES
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
    apart: tuple[str, ...] = ()
    """Workloads that its nodes met before and may not meet any more."""

    @property
    def name(self) -> str:
        """The name of the app."""
        return str(self.app["metadata"]["name"])

    @property
    def namespace(self) -> str:
        """The namespace of the app; empty where the objects name none."""
        return str(self.app["metadata"]["namespace"])


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


def names_as_peer(workload: Workload, second: Workload) -> bool:
    """Returns whether one of the two names the other as its peer, in one namespace."""
    pairs = ((workload, second), (second, workload)) if workload.namespace == second.namespace else ()
    return any(_names(peer, named) for naming, named in pairs for peer in _peers(naming))


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
    stated = distro or next((guess for each in group if (guess := distro_of(each))), "")
    if not stated:
        raise _wrong(
            group[0], "names no ROS distribution, neither by ROS_DISTRO nor by its image; give it with --distro"
        )
    if not distro:
        work.notes.append(f"ros.distro {stated} is taken from the image or ROS_DISTRO; --distro says otherwise")
    work.draft.spec["ros"] = {"distro": stated}
    version = ros_version(work.draft.spec)
    wanted = _shared_settings(group[0], distro, version=version)
    for each in group[1:]:
        for what, value in _shared_settings(each, distro, version=version).items():
            if value and value != wanted[what]:
                raise _wrong(each, f"has {what} {value}, and {group[0].title} has {wanted[what]}: an app has one")


def _shared_settings(workload: Workload, distro: str, *, version: int) -> dict[str, str]:
    """Returns what all components of an app share, as one workload has it."""
    scheduler = {"scheduler": str(workload.template["spec"].get("schedulerName", DEFAULT_SCHEDULER))}
    if not distro:
        scheduler["distribution"] = distro_of(workload)
    if version == 1:
        return {**scheduler, "master": _foreign_master(workload) or "one of its own"}
    return {**scheduler, "middleware": workload.variables.text("RMW_IMPLEMENTATION") or DEFAULT_RMW}


def _foreign_master(workload: Workload) -> str:
    """Returns the address of a master that the operator would not run; empty for none."""
    uri = workload.variables.text("ROS_MASTER_URI")
    return "" if not uri or uses_own_master(workload) else uri


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
    _lift_variables(workload, work)
    kept = [entry for entry in found.env if not _belongs_to_app(entry, version=ros_version(work.draft.spec))]
    kept += list(_brokers(workload, work))
    if kept:
        target["env"] = kept


def _brokers(workload: Workload, work: _Work) -> Iterator[dict[str, str]]:
    """Yields the servers and routers of `envFrom` as variables of the component: the operator's own would replace them."""
    for name in ("ROS_DISCOVERY_SERVER", "ZENOH_CONFIG_OVERRIDE"):
        variable = workload.variables.by_name.get(name)
        if variable and variable.is_inherited and variable.text and ros_version(work.draft.spec) == 2:
            work.notes.append(f"{workload.title}: {name} of {variable.source} becomes env, where it counts")
            yield {"name": name, "value": variable.text}


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


def _belongs_to_app(entry: Mapping[str, Any], *, version: int) -> bool:
    """Returns whether the operator writes a variable, so that a component has none of its own."""
    if entry["name"] == "RMW_IMPLEMENTATION":
        return version == 2 and entry.get("value") != ""
    return entry["name"] in (*ADDRESSES, "ROS_DOMAIN_ID")


def _lift_variables(workload: Workload, work: _Work) -> None:
    """Puts what the workload's variables say into the fields of the app, and notes what goes."""
    variables, ros2 = workload.variables.by_name, ros_version(work.draft.spec) == 2
    stated = {str(entry["name"]) for entry in workload.template["spec"]["containers"][0].get("env", ())}
    for name in (each for each in ADDRESSES if each in stated or each in variables):
        work.notes.append(f"{workload.title}: env {name} goes: the operator sets it")
    if not ros2 and (uri := _foreign_master(workload)):
        work.draft.spec["ros1"] = {"master": "External", "uri": uri}
    middleware = variables.get("RMW_IMPLEMENTATION")
    if ros2 and middleware and middleware.text:
        work.draft.spec.setdefault("ros2", {})["rmw"] = middleware.text
    if domain := variables.get("ROS_DOMAIN_ID"):
        _lift_domain(workload, work, domain)
    work.notes += [
        f"{workload.title}: {name} stands in {variable.source}, which a migration does not read: write it into "
        f"spec.{'ros1.uri' if name == 'ROS_MASTER_URI' else 'ros2.rmw'}, or the app has the default"
        for name in ("RMW_IMPLEMENTATION", "ROS_MASTER_URI")
        if (variable := variables.get(name)) and variable.text is None
    ]
    work.notes += [
        f"{workload.title}: {source} is not read: if it states ROS_DOMAIN_ID, RMW_IMPLEMENTATION or ROS_MASTER_URI, write that "
        "into spec.ros2 or spec.ros1, which win"
        for source in workload.variables.unread
    ]


def _lift_domain(workload: Workload, work: _Work, variable: Variable) -> None:
    text, ros2 = (variable.text or "").strip(), ros_version(work.draft.spec) == 2
    at = f"{text} of {variable.source}" if variable.source and text else variable.source or text
    stated = scheduling.DOMAIN.fullmatch(text) is not None and 0 < int(text) <= MAX_DOMAIN
    if not stated or not ros2 or "domain" in work.draft.spec.get("ros2", {}):
        same = stated and work.draft.spec.get("ros2", {}).get("domain") == int(text)
        work.notes += [] if same else [f"{workload.title}: ROS_DOMAIN_ID {at} goes: the app has a domain of its own"]
        return
    fields_of_app = work.draft.spec.setdefault("ros2", {})
    fields_of_app["domain"] = int(text)
    if not scheduling.is_default_domain(int(text)):
        fields_of_app["allowUnsafeDomain"] = True
    work.notes.append(f"{workload.title}: ROS_DOMAIN_ID {at} becomes the app's domain; leave it out to get a free one")


def _check(draft: Draft) -> None:
    found = next(problems(draft.spec, robotapp_schema()["properties"]["spec"]), None)
    if found:
        raise BridgeError(draft.origin(found[0]), f"{written(found[0])} {found[1]}")


def _wrong(workload: Workload, message: str) -> BridgeError:
    return BridgeError(Place(workload.title), message)
