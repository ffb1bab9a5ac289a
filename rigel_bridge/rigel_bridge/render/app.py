"""Rigelfile to RobotApp: one component per package, placement from the orchestration block."""

import shlex
from dataclasses import dataclass
from typing import Any, Final

from rigel_bridge.document.failures import BridgeError, nearest
from rigel_bridge.document.naming import MAX_APP_NAME, MAX_COMPONENT_NAME, checked_label
from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.g1 import Package, Rigelfile
from rigel_bridge.render import scheduling
from rigel_bridge.render.draft import Draft, written
from rigel_bridge.render.schema import problems, robotapp_schema

API_VERSION: Final = "robotics.io/v1alpha1"
PROVENANCE: Final = "rigel.robotics.io/"
ROS1: Final = frozenset({"indigo", "jade", "kinetic", "lunar", "melodic", "noetic"})
_OWN: Final = (
    "name",
    "namespace",
    "components",
    "robotapp",
    "scheduler",
    "deploy_ros_master",
    "ros_master_image",
    "application_image",
)
_OF_REFERENCE_PLUGIN: Final = (
    *("deployment_name", "readiness", "observability", "observability_only", "rolling_update", "distributed"),
    *("persistent_storage", "results", "additional_k8s_params"),
)
_LIFTED: Final = {"RMW_IMPLEMENTATION": "rmw", "ROS_DOMAIN_ID": "domain"}
"""Variables of ROS 2 that belong to the RobotApp's `ros2`: all components share them and the operator writes them."""


@dataclass(frozen=True, slots=True)
class Rendered:
    """The object and what should be said about it."""

    app: dict[str, Any]
    notes: tuple[str, ...]


def render(
    rigelfile: Rigelfile,
    *,
    name: str,
    override: bool = False,
    namespace: str | None = None,
    provenance: dict[str, str] | None = None,
) -> Rendered:
    """`name` is used when the file gives none or with `override`; provenance becomes annotations. The file has no say in
    the namespace: whoever applies the app chooses it.

    BridgeError for anything the API server would refuse by structure.
    """
    notes = list(rigelfile.notes)
    draft = Draft(rigelfile.node.place)
    draft.spec["components"] = [{} for _ in rigelfile.packages]
    block = rigelfile.orchestration
    if block is not None:
        block.refuse_unknown((*_OWN, *_OF_REFERENCE_PLUGIN))
        notes += [
            f"{node.place}: {node.path} is not carried over"
            for key, node in block.node.mapping().items()
            if key in _OF_REFERENCE_PLUGIN and key != "deployment_name"
        ]
        if chosen := block.get("namespace"):
            notes.append(
                f"{chosen.place}: {chosen.path} is not carried over: the command line names the namespace (-n), not the file"
            )
    names = _components(rigelfile.packages, block, draft)
    _ros(rigelfile, block, draft, notes)
    if block is not None:
        _orchestrate(block, draft, names)
    _check(draft)
    metadata = _metadata(rigelfile, block, name=name, override=override, namespace=namespace)
    if provenance:
        metadata["annotations"] = {f"{PROVENANCE}{key}": value for key, value in sorted(provenance.items())}
    return Rendered(
        {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": metadata, "spec": _ordered(draft.spec)},
        tuple(notes),
    )


def _metadata(
    rigelfile: Rigelfile, block: Section | None, *, name: str, override: bool, namespace: str | None
) -> dict[str, Any]:
    given = block.first("name", "deployment_name") if block and not override else None
    text = block.text_of(given) if block and given else name
    metadata: dict[str, Any] = {"name": checked_label(text, given or rigelfile.node, longest=MAX_APP_NAME)}
    if namespace:
        metadata["namespace"] = namespace
    return metadata


def _components(packages: tuple[Package, ...], block: Section | None, draft: Draft) -> dict[str, int]:
    """Fill the components; gives index by component name."""
    names: dict[str, int] = {}
    single_image = block.get("application_image") if block else None
    if single_image and len(packages) > 1:
        raise single_image.fail("is one image, but there are several packages: each has its own image field")
    for index, package in enumerate(packages):
        name = checked_label(package.name, package.node, longest=MAX_COMPONENT_NAME)
        if name in names:
            raise package.node.fail(
                f"package {package.name} becomes component {name}, which another package already is"
            )
        names[name] = index
        at = ("components", index)
        draft.put((*at, "name"), name, package.node)
        image = block.text_of(single_image) if block and single_image else package.image
        draft.put((*at, "image"), image, package.node)
        if package.command:
            draft.put((*at, "args"), _words(package), package.node)
        own = [{"name": key, "value": value} for key, value in package.env.items() if key not in _LIFTED]
        if own:
            draft.put((*at, "env"), own, package.node)
    return names


def _words(package: Package) -> list[str]:
    """The command as arguments of the image's entrypoint, which sources the workspace and then runs them."""
    try:
        return shlex.split(package.command or "")
    except ValueError as error:
        raise package.node.fail(f"command: {error}") from error


def _ros(rigelfile: Rigelfile, block: Section | None, draft: Draft, notes: list[str]) -> None:
    for package in rigelfile.packages:
        if package.distro:
            draft.put(("ros", "distro"), package.distro, package.node)
    distro = draft.spec.get("ros", {}).get("distro") or _stated_distro(block)
    for package in rigelfile.packages:
        if distro not in ROS1:
            _lift_environment(package, draft)
            continue
        notes += [
            f"{package.node.place}: env {variable} has no meaning for ROS 1 ({distro}) and is left out"
            for variable in _LIFTED
            if variable in package.env
        ]
    if block is None:
        return
    master, image = block.flag("deploy_ros_master"), block.get("ros_master_image")
    if distro in ROS1:
        if image:
            draft.put(("ros1", "image"), block.text_of(image), image)
        if master is False and (node := block.get("deploy_ros_master")):
            draft.put(("ros1", "master"), "External", node)
    elif master and (node := block.get("deploy_ros_master")):
        notes.append(f"{node.place}: deploy_ros_master has no meaning for ROS 2 ({distro}), which has no master")


def _stated_distro(block: Section | None) -> str | None:
    """The distro that the block's RobotApp words give, for packages that bring their own Dockerfile and name none."""
    verbatim = block.section("robotapp") if block else None
    ros = verbatim.section("ros") if verbatim else None
    return ros.text("distro") if ros else None


def _lift_environment(package: Package, draft: Draft) -> None:
    for variable, field in _LIFTED.items():
        value = package.env.get(variable)
        if value is None:
            continue
        if field == "domain" and not scheduling.DOMAIN.fullmatch(value):
            raise package.node.fail(
                f"env {variable} must be a number from 0 to {scheduling.MAX_DOMAIN}, found {value[:80]!r}"
            )
        draft.put(("ros2", field), int(value) if field == "domain" else value, package.node)


def _orchestrate(block: Section, draft: Draft, names: dict[str, int]) -> None:
    everyone = frozenset(names)
    if common := block.section("scheduler"):
        scheduling.apply_to_app(common, draft)
        for index in names.values():
            scheduling.apply_to_component(common, draft, index, names=everyone, alone=len(names) == 1)
    if components := block.section("components"):
        for key, node in components.node.mapping().items():
            _component(components.at(node), draft, _index(key, node, names), everyone)
    if verbatim := block.section("robotapp"):
        if components_node := verbatim.get("components"):
            raise components_node.fail("components are given under orchestration.components.<package>")
        draft.merge((), verbatim.plain(verbatim.node), verbatim.node)


def _index(key: str, node: Node, names: dict[str, int]) -> int:
    name = key.replace("_", "-").lower()
    if name not in names:
        raise node.fail(f"there is no package {key}{nearest(name, list(names))}; packages: {', '.join(names)}")
    return names[name]


def _component(section: Section, draft: Draft, index: int, everyone: frozenset[str]) -> None:
    """RobotApp's own component fields as they stand; `scheduler` in the block's words, which wins over the common one."""
    own = section.section("scheduler")
    if own:
        own.refuse_unknown(
            [key for key in scheduling.BLOCKS if key in ("policies", "affinity", "shared_data", "shared-data")]
        )
        separate = Draft(draft.place, {"components": [{} for _ in draft.spec["components"]]})
        scheduling.apply_to_component(own, separate, index, names=everyone, alone=True)
        draft.overlay(separate)
    for key, node in section.node.mapping().items():
        if key == "name":
            raise node.fail("the component is named by its package")
        if key != "scheduler":
            draft.merge(("components", index, key), section.plain(node), node)


def _check(draft: Draft) -> None:
    """Everything the API server would refuse by structure, and the slips that are typical here."""
    if "distro" not in draft.spec.get("ros", {}):
        raise BridgeError(
            draft.place,
            "no package names its ROS distro: write robotapp: {ros: {distro: …}} in the orchestration block",
        )
    schema = robotapp_schema()["properties"]["spec"]
    found = next(problems(draft.spec, schema), None)
    if found:
        path, message = found
        raise BridgeError(draft.origin(path), f"{written(path)} {message}")
    _check_version(draft)
    ros2 = draft.spec.get("ros2", {})
    domain = ros2.get("domain")
    if domain is not None and not scheduling.is_default_domain(domain) and not ros2.get("allowUnsafeDomain"):
        raise BridgeError(
            draft.origin(("ros2", "domain")),
            f"domain {domain} is outside 1-101 and 215-232 (0 is every laptop's default, 102-214 meet Linux' ephemeral ports); "
            "to use it nevertheless write robotapp: {ros2: {allowUnsafeDomain: true}}",
        )


def _check_version(draft: Draft) -> None:
    """The settings of the other ROS version would be refused by the operator, after the API server stored them."""
    ros = draft.spec["ros"]
    version = ros.get("version") or (1 if ros["distro"] in ROS1 else 2)
    field = f"ros{3 - version}"
    if field in draft.spec:
        raise BridgeError(
            draft.origin((field,)),
            f"spec.{field} has the settings of ROS {3 - version}, and {ros['distro']} is ROS {version}: remove them",
        )


def _ordered(spec: dict[str, Any]) -> dict[str, Any]:
    """Fields in the order the API page lists them, so that equal input gives equal text."""
    order = list(robotapp_schema()["properties"]["spec"]["properties"])
    ordered = {key: spec[key] for key in order if key in spec}
    fields = list(robotapp_schema()["properties"]["spec"]["properties"]["components"]["items"]["properties"])
    ordered["components"] = [
        {key: component[key] for key in fields if key in component} for component in spec["components"]
    ]
    return ordered
