"""`additional_k8s_params`: a fragment of the Deployment that Rigel's orchestration plugin writes, as component fields."""

from typing import Any, Final

from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.render.draft import Draft
from rigel_bridge.render.notes import Note
from rigel_bridge.render.ros import LIFTED, lift
from rigel_bridge.render.schema import robotapp_schema

_CONTAINER: Final = "ros-app"


def apply(block: Section, draft: Draft, *, version: int, count: int) -> list[Note]:
    """Lay the fragment over the one component; gives notes. What a RobotApp has no place for is an error where it stands."""
    extra = block.section("additional_k8s_params")
    if extra is None:
        return []
    extra.refuse_unknown(("application", "ros_master"))
    notes: list[Note] = []
    if master := extra.section("ros_master"):
        _master(master, draft, notes, version=version)
    application = extra.section("application")
    if application is None:
        return notes
    if count > 1:
        raise application.node.fail("is one Deployment, and there are several components: write components.<name>")
    application.refuse_unknown(("apiVersion", "kind", "metadata", "spec"))
    if node := application.get("metadata"):
        left = f"{node.place}: {node.path} is not carried over"
        notes.append(
            Note(
                f"{left}: the operator names and labels what it makes",
                plain=f"{left}: names and labels follow from those of the app and its components",
            )
        )
    if spec := application.section("spec"):
        _deployment(spec, draft, notes, version=version)
    return notes


def _deployment(spec: Section, draft: Draft, notes: list[Note], *, version: int) -> None:
    spec.refuse_unknown(("replicas", "template", "selector", "strategy"))
    notes += [
        Note(
            f"{node.place}: {node.path} is not carried over: the operator decides it",
            plain=f"{node.place}: {node.path} is not carried over: {instead}",
        )
        for key, instead in (
            ("selector", "it follows from the names of the app and its components"),
            ("strategy", "write rolling_update, which plain objects keep"),
        )
        if (node := spec.get(key))
    ]
    if replicas := spec.get("replicas"):
        draft.put(("components", 0, "replicas"), spec.number("replicas"), replicas)
    template = spec.section("template")
    if template is None:
        return
    template.refuse_unknown(("metadata", "spec"))
    if metadata := template.section("metadata"):
        metadata.refuse_unknown(("labels", "annotations"))
        draft.merge(("components", 0, "template", "metadata"), metadata.plain(metadata.node), metadata.node)
    if pod := template.section("spec"):
        _pod(pod, draft, notes, version=version)


def _pod(pod: Section, draft: Draft, notes: list[Note], *, version: int) -> None:
    for key, node in pod.node.mapping().items():
        if key == "containers":
            continue
        if key == "schedulerName":
            draft.put(("schedulerName",), pod.text_of(node), node)
            continue
        path = ("components", 0, "template", "spec", key)
        draft.merge(path, _by_name(draft, path, pod.plain(node)), node)
    for container in pod.sections("containers"):
        _container(container, draft, notes, version=version)


def _container(container: Section, draft: Draft, notes: list[Note], *, version: int) -> None:
    name = container.text("name")
    if name not in (None, _CONTAINER):
        raise container.node.fail(
            f"container {str(name)[:80]!r} is a second one, which has no place here: make it a package, or add it to the rendered app under "
            "template.spec.containers"
        )
    known = robotapp_schema()["properties"]["spec"]["properties"]["components"]["items"]["properties"]
    container.refuse_unknown([key for key in known if key != "template"])
    for key, node in container.node.mapping().items():
        if key == "name":
            continue
        value = container.plain(node)
        if key == "env" and isinstance(value, list):
            value = _environment(value, node, draft, notes, version=version)
            if not value:
                continue
        path = ("components", 0, key)
        draft.merge(path, _by_name(draft, path, value), node)


def _environment(value: list[Any], node: Node, draft: Draft, notes: list[Note], *, version: int) -> list[Any]:
    """The variables without those that the app has a field for."""
    kept = []
    for entry in value:
        name = entry.get("name") if isinstance(entry, dict) else None
        if name not in LIFTED:
            kept.append(entry)
        elif name == "ROS_DOMAIN_ID" and str(entry.get("value")) == "0":
            # Plain objects that get no domain have a note of their own.
            notes.append(
                Note(
                    f"{node.place}: ROS_DOMAIN_ID 0 is every laptop's default: the app gets a domain of its own",
                    plain="",
                )
            )
        elif version == 2 and "value" in entry:
            lift(name, str(entry["value"]), node, draft)
        else:
            notes.append(Note(f"{node.place}: env {name} has no meaning for ROS 1 and is left out"))
    return kept


def _by_name(draft: Draft, path: tuple[str | int, ...], value: Any) -> Any:
    """Lists of named entries are merged by name, later ones win; everything else replaces."""
    present = draft.value(path)
    if not _named(present) or not _named(value):
        return value
    merged = {entry["name"]: entry for entry in present}
    for entry in value:
        merged[entry["name"]] = {**merged.get(entry["name"], {}), **entry}
    return list(merged.values())


def _named(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(entry, dict) and isinstance(entry.get("name"), str) for entry in value
    )


def _master(master: Section, draft: Draft, notes: list[Note], *, version: int) -> None:
    """Of the master's Deployment the image; everything else is the operator's."""
    plain = master.plain(master.node)
    try:
        image = plain["spec"]["template"]["spec"]["containers"][0]["image"]
    except (KeyError, IndexError, TypeError):
        image = None
    if version == 1 and isinstance(image, str):
        draft.put(("ros1", "image"), image, master.node)
    left = f"{master.node.place}: {master.node.path} is not carried over, but for its image"
    notes.append(
        Note(f"{left}: the operator runs the master", plain=f"{left}: the master's objects are the same for every app")
    )
