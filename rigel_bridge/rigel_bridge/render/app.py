"""One target of a Rigelfile to one RobotApp, checked against the definition the API server has."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rigel_bridge.document.distros import ros_version
from rigel_bridge.document.failures import BridgeError, Place, nearest
from rigel_bridge.document.naming import MAX_APP_NAME, checked_label
from rigel_bridge.document.section import Section
from rigel_bridge.document.template import is_secret
from rigel_bridge.generations.model import Target
from rigel_bridge.generations.targets import namespace_note
from rigel_bridge.names import API_VERSION, BRIDGE_APP_LABEL, PROVENANCE
from rigel_bridge.render import additional, reference_plugin, scheduling
from rigel_bridge.render.components import components, settle_programs
from rigel_bridge.render.draft import Draft, Path, written
from rigel_bridge.render.notes import Note, of_app, of_plain
from rigel_bridge.render.orchestration import OWN, orchestrate
from rigel_bridge.render.ros import ros, settle_addresses
from rigel_bridge.render.schema import problems, robotapp_schema


@dataclass(frozen=True, slots=True)
class Naming:
    """Names that come from outside of the file."""

    name: str
    override: bool = False
    """True for a name of the command line, which wins over the file's."""
    namespace: str | None = None
    provenance: tuple[tuple[str, str], ...] = ()
    today: str = ""
    """As 2026-05-22, for remarks about ends of life; empty for none."""


@dataclass(frozen=True, slots=True)
class Rendered:
    """The object, what stands beside it and what the user should be told."""

    app: dict[str, Any]
    claims: tuple[dict[str, Any], ...]
    """PersistentVolumeClaims that the app mounts."""
    strategy: dict[str, Any]
    """Of the Deployments of plain manifests; empty for Kubernetes' own."""
    notes: tuple[str, ...]
    """True of the RobotApp."""
    plain_notes: tuple[str, ...]
    """True of the plain objects of `workloads`."""
    origin: Callable[[Path], Place] = field(compare=False, repr=False)
    """Place in the file that gave a field of the spec."""


def render(target: Target, naming: Naming) -> Rendered:
    """BridgeError for anything the API server would refuse by structure.

    The namespace of the file is not carried over: the user who applies the app chooses it.
    """
    draft = Draft(target.node.place)
    block = target.orchestration
    notes = _known_keys(block) if block else []
    names = components(target.packages, draft, notes)
    notes += ros(target.packages, block, draft, today=naming.today)
    extras = reference_plugin.Extras()
    if block is not None:
        extras = reference_plugin.apply(block, draft, len(names))
        notes += extras.notes + additional.apply(block, draft, version=ros_version(draft.spec), count=len(names))
        orchestrate(block, draft, names, scheduler=target.scheduler)
        settle_programs(target.packages, draft)
    notes += settle_addresses(block, draft, version=ros_version(draft.spec))
    if target.scheduler:
        draft.spec["schedulerName"] = target.scheduler
    notes += _logins(target, block)
    _refuse_secrets(draft)
    _check(draft, target)
    notes += _left_as_they_stand(draft)
    metadata = _metadata(target, naming, block)
    annotations = {**dict(naming.provenance), **extras.annotations}
    if annotations:
        metadata["annotations"] = {f"{PROVENANCE}{key}": value for key, value in sorted(annotations.items())}
    app = {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": metadata, "spec": _ordered(draft.spec)}
    return Rendered(app, _claims(extras, metadata), extras.strategy, of_app(notes), of_plain(notes), draft.origin)


def _known_keys(block: Section) -> list[Note]:
    block.refuse_unknown((*OWN, *reference_plugin.KEYS))
    return [Note(text) for text in namespace_note(block)]


def _metadata(target: Target, naming: Naming, block: Section | None) -> dict[str, Any]:
    given = block.first("name", "deployment_name") if block and not naming.override else None
    text = block.text_of(given) if block and given else naming.name
    if target.name and not naming.override:
        text = target.name
    if target.suffix:
        text = f"{text}-{target.suffix}"
    metadata: dict[str, Any] = {"name": checked_label(text, given or target.node, longest=MAX_APP_NAME)}
    if naming.namespace:
        metadata["namespace"] = naming.namespace
    return metadata


def _claims(extras: reference_plugin.Extras, metadata: dict[str, Any]) -> tuple[dict[str, Any], ...]:
    found = []
    for claim in extras.claims:
        own = {"name": claim["metadata"]["name"]}
        if "namespace" in metadata:
            own["namespace"] = metadata["namespace"]
        found.append({**claim, "metadata": {**own, "labels": {BRIDGE_APP_LABEL: metadata["name"]}}})
    return tuple(found)


def _logins(target: Target, block: Section | None) -> list[Note]:
    if block and "image_pull_secrets" in block:
        return []
    servers = {package.login: package for package in target.packages if package.login}
    return [
        Note(
            f"{package.node.place}: {server} needs a login, which is not carried over: make a Secret of type "
            "kubernetes.io/dockerconfigjson and write image_pull_secrets: [ITS_NAME] into the orchestration block"
        )
        for server, package in servers.items()
    ]


def _refuse_secrets(draft: Draft) -> None:
    """A password that the block writes out would stand readable in the RobotApp, its Deployments and its history."""
    for index, component in enumerate(draft.spec["components"]):
        env = component.get("env")
        for number, entry in enumerate(env if isinstance(env, list) else ()):
            name = entry.get("name") if isinstance(entry, dict) and entry.get("value") else None
            if isinstance(name, str) and is_secret(name):
                at = ("components", index, "env", number)
                raise BridgeError(
                    draft.origin(at),
                    f"{written(at)} {name[:80]} looks like a secret: keep it in a Secret, and name that with valueFrom or envFrom",
                )


def _left_as_they_stand(draft: Draft) -> list[Note]:
    """Marks that no rule of the generation resolves reach the pod as text, as they do with Rigel: rarely what the user meant."""
    found: list[Note] = []

    def look(value: Any, path: tuple[str | int, ...]) -> None:
        if isinstance(value, dict):
            for key, child in value.items():
                look(child, (*path, key))
        elif isinstance(value, list):
            for index, child in enumerate(value):
                look(child, (*path, index))
        elif isinstance(value, str) and "{{" in value and "}}" in value:
            found.append(
                Note(f"{draft.origin(path)}: {written(path)} keeps its {{{{ }}}}: Rigel resolves no such mark")
            )

    look(draft.spec, ())
    return found


def _no_image(target: Target) -> str:
    """Returns why there is no image, and what to write."""
    builders = next((package.builders for package in target.packages if package.builders), ())
    if not builders:
        return (
            "names no image: write application_image into the orchestration block, add one build job, or give --image"
        )
    *first, last = builders
    return (
        f"names no image, and jobs {', '.join(first)} and {last} build one each: write the right one as application_image "
        "into the orchestration block, or give --image"
    )


def _check(draft: Draft, target: Target) -> None:
    """Everything the API server would refuse by structure, and the slips that are typical here."""
    for index, component in enumerate(draft.spec["components"]):
        if not component.get("image"):
            raise BridgeError(
                draft.origin(("components", index)),
                _no_image(target),
            )
    schema = robotapp_schema()["properties"]["spec"]
    found = next(problems(draft.spec, schema), None)
    if found:
        path, message = found
        source = draft.origins.get(path)
        raise BridgeError(draft.origin(path), f"{written(path)} {message}", path=source.path if source else "")
    _check_version(draft)
    _check_names(draft)
    ros2 = draft.spec.get("ros2", {})
    domain = ros2.get("domain")
    if domain is not None and not scheduling.is_default_domain(domain) and not ros2.get("allowUnsafeDomain"):
        raise BridgeError(
            draft.origin(("ros2", "domain")),
            f"domain {domain} is outside 1-101 and 215-232 (0 is every laptop's default, 102-214 meet Linux' ephemeral ports); "
            "to use it nevertheless write robotapp: {ros2: {allowUnsafeDomain: true}}",
        )


def _check_names(draft: Draft) -> None:
    """The API server refuses names that are no component; here the line is known."""
    names = [component["name"] for component in draft.spec["components"]]
    stated: list[tuple[Path, Any, tuple[str, ...]]] = [
        (("edges", index, end), edge.get(end), ("@robot",))
        for index, edge in enumerate(draft.spec.get("edges", ()))
        for end in ("from", "to")
    ]
    stated += [
        (("components", index, key, number), name, ())
        for index, component in enumerate(draft.spec["components"])
        for key in ("colocateWith", "separateFrom")
        for number, name in enumerate(component.get(key, ()))
    ]
    for path, name, more in stated:
        if name is not None and name not in names and name not in more:
            allowed = ", ".join([*names, *more])
            raise BridgeError(
                draft.origin(path),
                f"{written(path)} {name!r} is no component{nearest(name, names)}; components: {allowed}",
            )


def _check_version(draft: Draft) -> None:
    """The settings of the other ROS version would be refused by the operator, after the API server stored them."""
    version = ros_version(draft.spec)
    field = f"ros{3 - version}"
    if field in draft.spec:
        raise BridgeError(
            draft.origin((field,)),
            f"spec.{field} has the settings of ROS {3 - version}, and {draft.spec['ros']['distro']} is ROS {version}: remove them",
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
