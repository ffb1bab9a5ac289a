"""The orchestration block: the scheduler's words, the components' own, RobotApp's own."""

from typing import Final

from rigel_bridge.document.failures import nearest
from rigel_bridge.document.naming import label
from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.names import DEFAULT_SCHEDULER
from rigel_bridge.render import scheduling
from rigel_bridge.render.draft import Draft

OWN: Final = (
    *("name", "namespace", "components", "robotapp", "scheduler", "deploy_ros_master", "ros_master_image"),
    *("application_image", "ros_version", "rmw", "dds_domain", "image_pull_secrets"),
)


def orchestrate(block: Section, draft: Draft, names: dict[str, int], *, scheduler: str) -> None:
    """Fill what the block gives. `scheduler` is a sequence's choice: with kube-scheduler's own name the block's ROS rules are left out."""
    everyone = frozenset(names)
    has_rules = scheduler != DEFAULT_SCHEDULER
    common = block.section("scheduler")
    if common and has_rules:
        scheduling.apply_to_app(common, draft)
        for index in names.values():
            scheduling.apply_to_component(common, draft, index, names=everyone, alone=len(names) == 1)
    if domain := block.get("dds_domain"):
        scheduling.domain(block, domain, draft)
    if rmw := block.get("rmw"):
        draft.put(("ros2", "rmw"), block.text_of(rmw), rmw)
    if secrets := block.get("image_pull_secrets"):
        for index in names.values():
            listed = [{"name": name} for name in block.texts("image_pull_secrets")]
            draft.put(("components", index, "template", "spec", "imagePullSecrets"), listed, secrets)
    if components := block.section("components"):
        for key, node in components.node.mapping().items():
            _component(components.at(node), draft, _index(key, node, names), everyone, has_rules=has_rules)
    if verbatim := block.section("robotapp"):
        if components_node := verbatim.get("components"):
            raise components_node.fail("components are given under orchestration.components.<package>")
        draft.merge((), verbatim.plain(verbatim.node), verbatim.node)


def _index(key: str, node: Node, names: dict[str, int]) -> int:
    name = label(key)
    if name not in names:
        raise node.fail(f"there is no package {key}{nearest(name, list(names))}; packages: {', '.join(names)}")
    return names[name]


def _component(section: Section, draft: Draft, index: int, everyone: frozenset[str], *, has_rules: bool) -> None:
    """RobotApp's own component fields as they stand; `scheduler` in the block's words, which wins over the common one."""
    own = section.section("scheduler")
    if own and has_rules:
        own.refuse_unknown(
            [key for key in scheduling.BLOCKS if key in ("policies", "affinity", "shared_data", "shared-data")]
        )
        separate = Draft(draft.place, {"components": [{} for _ in draft.spec["components"]]})
        scheduling.apply_to_component(own, separate, index, names=everyone, alone=True)
        draft.overlay(separate)
    for key, node in section.node.mapping().items():
        if key == "name":
            raise node.fail("the component is named by its package, or by the key it stands under")
        if key != "scheduler":
            draft.merge(("components", index, key), section.plain(node), node)
