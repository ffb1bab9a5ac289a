"""Packages to components: name, image, command, environment."""

from typing import Any

from rigel_bridge.document.naming import MAX_COMPONENT_NAME, checked_label
from rigel_bridge.document.template import is_secret
from rigel_bridge.generations.dockerfile import escape_for_kubernetes, read_command
from rigel_bridge.generations.model import Package
from rigel_bridge.render.draft import Draft
from rigel_bridge.render.notes import Note
from rigel_bridge.render.ros import LIFTED


def components(packages: tuple[Package, ...], draft: Draft, notes: list[Note]) -> dict[str, int]:
    """Fill the components and the notes; gives index by component name."""
    names: dict[str, int] = {}
    draft.spec["components"] = [{} for _ in packages]
    for index, package in enumerate(packages):
        name = checked_label(package.name, package.node, longest=MAX_COMPONENT_NAME)
        if name in names:
            raise package.node.fail(
                f"package {package.name} becomes component {name}, which another package already is"
            )
        names[name] = index
        draft.put(("components", index, "name"), name, package.node)
        if package.image:
            draft.put(("components", index, "image"), package.image, package.node)
        notes += _program(package, index, draft)
    return names


def _program(package: Package, index: int, draft: Draft) -> list[Note]:
    """Command and variables; gives notes. What looks like a secret stays in the image, where Rigel put it."""
    if package.command:
        draft.put(("components", index, "args"), words(package), package.node)
    values = package.env.values
    secret = [name for name, value in values.items() if value and is_secret(name)]
    own: list[dict[str, Any]] = [
        {"name": key, "value": escape_for_kubernetes(value)}
        for key, value in values.items()
        if key not in LIFTED and key not in secret
    ]
    if own:
        draft.put(("components", index, "env"), own, package.node)
    kept = [
        Note(
            f"{package.node.place}: env {name} refers to {reference}, which the base image states: its value stays in the image "
            "and is not carried over"
        )
        for name, reference in package.env.from_base.items()
    ]
    return kept + [
        Note(
            f"{package.node.place}: env {name} looks like a secret and is not carried over: keep it in a Secret, and name that "
            "with envFrom of the component"
        )
        for name in secret
    ]


def settle_programs(packages: tuple[Package, ...], draft: Draft) -> None:
    """Where the block names a `command` of its own, the package's is no argument to it."""
    for index, package in enumerate(packages):
        at = ("components", index, "args")
        if draft.value(("components", index, "command")) and draft.origins.get(at) is package.node:
            del draft.spec["components"][index]["args"]


def words(package: Package) -> list[str]:
    """The command as arguments of the image's entrypoint, which sources the workspace and then runs them."""
    try:
        return [escape_for_kubernetes(word) for word in read_command(package.command or "")]
    except ValueError as error:
        raise package.node.fail(f"command: {error}") from error
