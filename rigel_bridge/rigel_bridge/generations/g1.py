"""The Rigelfile of Rigel 0.2 (`packages`, `deploy`, `simulate`, `vars`), as far as a deployment needs it.

Build-time fields (apt, rosinstall, ssh keys, …) are left to Rigel: they are inside the image by then. Rigel ignores
keys it does not know; here they become notes, because a misspelt key is a lost setting.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from rigel_bridge.document.failures import Exit, nearest
from rigel_bridge.document.section import Section
from rigel_bridge.document.template import Templates
from rigel_bridge.document.tree import Node

_TOP: Final = ("packages", "deploy", "simulate", "vars", "orchestration")
_IMAGE_ONLY: Final = (
    *(
        "apt",
        "compiler",
        "dir",
        "entrypoint",
        "hostname",
        "platforms",
        "ros_image",
        "rosinstall",
        "run",
        "ssh",
        "username",
    ),
)
_PACKAGE: Final = ("package", "image", "distro", "command", "env", "registry", "dockerfile", *_IMAGE_ONLY)
_LATER: Final = {
    "jobs": "0.3 and newer",
    "application": "0.3 and newer",
    "sequences": "0.3 and newer",
    "applications": "a 0.2 draft",
}


@dataclass(frozen=True, slots=True)
class Package:
    """One entry of `packages`. `distro` and `command` are None where the user brings his own Dockerfile."""

    node: Node
    name: str
    image: str
    distro: str | None
    command: str | None
    env: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Rigelfile:
    """What the bridge works from. `notes` are said to the user, they stop nothing."""

    node: Node
    packages: tuple[Package, ...]
    orchestration: Section | None
    notes: tuple[str, ...] = field(default=())


def load(root: Node, environment: Mapping[str, str]) -> Rigelfile:
    """Check and read the document of generation G1; BridgeError otherwise."""
    top = root.mapping()
    _refuse_other_generations(root, top)
    variables = top["vars"].mapping() if "vars" in top and top["vars"].kind != "null" else {}
    document = Section(root, Templates(variables, environment))
    notes = [_ignored(node, key, _TOP) for key, node in document.unknown(_TOP)]
    packages = tuple(_package(section, notes) for section in document.sections("packages"))
    if not packages:
        raise root.fail("packages needs at least one entry")
    _refuse_twins(packages)
    return Rigelfile(root, packages, _orchestration(document), tuple(notes))


def _refuse_other_generations(root: Node, top: Mapping[str, Node]) -> None:
    packages = top.get("packages")
    if packages is not None and packages.kind == "seq":
        return
    for key, generation in _LATER.items():
        if key in top:
            raise top[key].fail(
                f"this is a Rigelfile of {generation}; only the format of Rigel 0.2 is read so far",
                code=Exit.UNSUPPORTED,
            )
    if packages is None:
        raise root.fail(f"packages is missing; found {', '.join(top) or 'nothing'}", code=Exit.UNSUPPORTED)
    raise packages.fail(f"expected a list of packages, found {packages.described()}", code=Exit.UNSUPPORTED)


def _ignored(node: Node, key: str, known: tuple[str, ...]) -> str:
    return f"{node.place}: {node.path} is ignored, Rigel does not know it{nearest(key, list(known))}"


def _package(section: Section, notes: list[str]) -> Package:
    notes += [_ignored(node, key, _PACKAGE) for key, node in section.unknown(_PACKAGE)]
    own_dockerfile = "dockerfile" in section and "command" not in section
    return Package(
        node=section.node,
        name=section.required_text("package"),
        image=section.required_text("image"),
        distro=section.text("distro") if own_dockerfile else section.required_text("distro"),
        command=section.text("command") if own_dockerfile else section.required_text("command"),
        env=_environment(section),
    )


def _environment(section: Section) -> dict[str, str]:
    found: dict[str, str] = {}
    for entry in section.sections("env"):
        entry.refuse_unknown(("name", "value"))
        value = entry.get("value")
        if value is not None and value.kind in ("map", "seq"):
            raise value.fail(f"expected text, found {value.described()}")
        # As typed: YAML 1.1 would turn an unquoted `on` into true.
        found[entry.required_text("name")] = "" if value is None else entry.templates.render(value, value.raw)
    return found


def _refuse_twins(packages: tuple[Package, ...]) -> None:
    seen: dict[str, Package] = {}
    for package in packages:
        first = seen.setdefault(package.name, package)
        if first is not package:
            raise package.node.fail(f"package {package.name} is already in line {first.node.place.line}")


def _orchestration(document: Section) -> Section | None:
    """`deploy[].kwargs.orchestration`, or `orchestration` at the top as older descriptions show it."""
    found = [document.get("orchestration")]
    for entry in document.sections("deploy"):
        kwargs = entry.section("kwargs")
        found.append(kwargs.get("orchestration") if kwargs else None)
    blocks = [node for node in found if node is not None]
    if len(blocks) > 1:
        raise blocks[1].fail(f"orchestration is already in line {blocks[0].place.line}: keep one")
    return document.at(blocks[0]) if blocks else None
