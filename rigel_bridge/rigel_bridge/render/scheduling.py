"""The `scheduler` block of a Rigelfile to RobotApp fields.

Its field names are those of the thesis that introduced the block; every one of them has a place in the RobotApp, so
nothing is lost. `shared-data` and `dds-domain` are also accepted with a hyphen, as the pod annotations are written.
"""

import re
from collections.abc import Iterator
from typing import Final

from rigel_bridge.document.naming import label
from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.names import MAX_DOMAIN, QOS_CLASSES, SAFE_DOMAINS
from rigel_bridge.render.draft import Draft
from ros_profile.output.hardware import CLAIMED_TYPES, devices_and_requires

BLOCKS: Final = ("name", "policies", "topology", "affinity", "shared_data", "shared-data", "dds_domain", "dds-domain")
_TEXT_POLICIES: Final = {
    "latency_budget": "latencyBudget",
    "deadline": "deadline",
    "reliability": "reliability",
    "durability": "durability",
    "liveliness": "liveliness",
}
DOMAIN: Final = re.compile("[0-9]{1,3}")
"""ASCII digits only, and few: int() reads digits of every script, and of long numbers it raises."""


def apply_to_app(block: Section, draft: Draft) -> None:
    """What concerns the application as a whole: scheduler name, zones, master node, domain."""
    block.refuse_unknown(BLOCKS)
    if name := block.get("name"):
        draft.put(("schedulerName",), block.text_of(name), name)
    if topology := block.section("topology"):
        topology.refuse_unknown(("master_node", "preferred_zones"))
        if (master := topology.get("master_node")) and master.value != "":
            draft.put(("placement", "masterNode"), topology.text_of(master), master)
        if (zones := topology.get("preferred_zones")) and zones.sequence():
            draft.put(("placement", "zones"), topology.texts("preferred_zones"), zones)
    if stated := block.first("dds_domain", "dds-domain"):
        domain(block, stated, draft)


def apply_to_component(block: Section, draft: Draft, index: int, *, names: frozenset[str], alone: bool) -> None:
    """What concerns component `index`; `names` are all components, `alone`: it is the only one."""
    at = ("components", index)
    if policies := block.section("policies"):
        _policies(policies, draft, index)
    if affinity := block.section("affinity"):
        affinity.refuse_unknown(("hardware_requirements",))
        _hardware(affinity, draft, index, alone=alone)
    if shared_node := block.first("shared_data", "shared-data"):
        shared = block.at(shared_node)
        shared.refuse_unknown(("peer_pods", "pvc"))
        for field, values in _shared(shared, names):
            draft.put((*at, "sharedData", field), values, shared_node)


def _policies(policies: Section, draft: Draft, index: int) -> None:
    policies.refuse_unknown(("qos_class", *_TEXT_POLICIES, "queue_size", "tcp_nodelay"))
    at = ("components", index)
    if (qos := policies.choice("qos_class", QOS_CLASSES)) and (node := policies.get("qos_class")):
        draft.put((*at, "qosClass"), qos, node)
    for key, field in _TEXT_POLICIES.items():
        if node := policies.get(key):
            draft.put((*at, "policies", field), policies.text_of(node), node)
    if node := policies.get("queue_size"):
        draft.put((*at, "policies", "queueSize"), policies.number("queue_size"), node)
    if node := policies.get("tcp_nodelay"):
        draft.put((*at, "policies", "tcpNodelay"), policies.flag("tcp_nodelay"), node)


def _hardware(affinity: Section, draft: Draft, index: int, *, alone: bool) -> None:
    requirements = affinity.get("hardware_requirements")
    if requirements is None:
        return
    found: list[dict[str, str]] = []
    for entry in affinity.sections("hardware_requirements"):
        entry.refuse_unknown(("type", "model", "interface"))
        kind = entry.required_text("type")
        stated = {key: value for key in ("type", "model", "interface") if (value := entry.text(key))}
        if kind in CLAIMED_TYPES:
            _refuse_sharing(entry.node, kind, alone=alone)
        found.append(stated)
    for field, values in devices_and_requires(found).items():
        draft.put(("components", index, field), values, requirements)


def _refuse_sharing(node: Node, kind: str, *, alone: bool) -> None:
    if not alone:
        raise node.fail(
            f"a {kind} device belongs to one component, and there are several components: "
            "move it to orchestration.components.<package>.scheduler.affinity"
        )


def _shared(shared: Section, names: frozenset[str]) -> Iterator[tuple[str, list[str]]]:
    peers = shared.texts("peer_pods")
    components = [label(peer) for peer in peers if label(peer) in names]
    foreign = [peer for peer in peers if label(peer) not in names]
    for field, values in (("with", components), ("peerPods", foreign), ("claimNames", shared.texts("pvc"))):
        if values:
            yield field, values


def domain(block: Section, node: Node, draft: Draft) -> None:
    """`auto`, or the number of a DDS domain."""
    if node.value == "auto":
        return
    text = node.raw if node.kind == "int" else block.text_of(node)
    if not DOMAIN.fullmatch(text) or int(text) > MAX_DOMAIN:
        raise node.fail(f"{text[:80]!r} is not a DDS domain; allowed: auto, or a number from 0 to {MAX_DOMAIN}")
    draft.put(("ros2", "domain"), int(text), node)


def is_default_domain(domain: int) -> bool:
    """Whether the id needs no `allowUnsafeDomain`."""
    return any(low <= domain <= high for low, high in SAFE_DOMAINS)
