"""What Rigel itself would refuse, in parts of a file that a deployment does not need."""

from collections.abc import Iterator
from typing import Final

from rigel_bridge.document.distros import distros
from rigel_bridge.document.failures import BridgeError, nearest
from rigel_bridge.document.section import Section
from rigel_bridge.document.template import SECRETS
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.images import FILE_WRITERS, kind
from rigel_bridge.generations.jobs import jobs_of
from rigel_bridge.generations.model import Generation

COMPILERS: Final = ("catkin_make", "colcon")
PLATFORMS: Final = ("linux/amd64", "linux/arm64")
_TEXTS: Final = ("ros_image", "compiler", "dir", "username", "dockerfile")
_LISTS: Final = ("apt", "entrypoint", "hostname", "platforms", "rosinstall", "run")


def lint(document: Section, generation: Generation) -> tuple[list[BridgeError], list[str]]:
    """Errors and notes, in the order of the file."""
    errors = list(_first_generation(document)) if generation is Generation.G1 else []
    noted = list(_unresolved(document, document.node))
    if not errors:
        noted += _build_tool(document, generation)
    if generation is Generation.G1:
        noted += _keys(document)
    return errors, [f"{error}" for error in noted]


def _build_tool(document: Section, generation: Generation) -> Iterator[BridgeError]:
    """Rigel builds with catkin_make where the file names no compiler, also what only colcon can build."""
    for node, distro, compiler in _built(document, generation):
        known = distros().get(distro)
        if known and known.version == 2 and compiler in ("", "catkin_make"):
            stated = "is catkin_make" if compiler else "is not written, and Rigel takes catkin_make"
            yield node.fail(f"compiler {stated}, which builds no ROS 2 ({distro}): write colcon")


def _built(document: Section, generation: Generation) -> Iterator[tuple[Node, str, str]]:
    """(place, distribution, compiler) of everything that Rigel builds; empty for what is not written or cannot be read."""
    if generation is Generation.G1:
        for package in document.sections("packages"):
            if "dockerfile" not in package:
                yield package.node, _text_at(package, "distro"), _text_at(package, "compiler")
        return
    for job in jobs_of(document, generation).values():
        if kind(document, job) in FILE_WRITERS and job.settings.kind == "map" and job.distro:
            compiler = document.at(job.settings).section("compiler")
            yield job.settings, _text_of(document, job.distro), _text_at(compiler, "name") if compiler else ""


def _text_at(section: Section, key: str) -> str:
    found = section.get(key)
    return _text_of(section, found) if found else ""


def _text_of(section: Section, node: Node) -> str:
    try:
        return section.text_of(node)
    except BridgeError:
        return ""


def _unresolved(document: Section, node: Node) -> Iterator[BridgeError]:
    """Marks that Rigel cannot replace end its run, wherever they stand."""
    if isinstance(node.value, dict):
        for child in node.value.values():
            yield from _unresolved(document, child)
    elif isinstance(node.value, list):
        for child in node.value:
            yield from _unresolved(document, child)
    else:
        try:
            document.templates.resolve(node)
        except BridgeError as error:
            if SECRETS not in str(error):  # a password from the environment is as it should be
                yield error


def _first_generation(document: Section) -> Iterator[BridgeError]:
    for key in ("packages", "deploy"):
        yield from _entries(document, key)
    variables = document.node.mapping().get("vars")
    if variables is not None and variables.kind != "map":
        yield variables.fail(f"expected a mapping, found {variables.described()}")
    simulate = document.get("simulate")
    if simulate is None:
        return
    if simulate.kind != "map":
        yield simulate.fail(f"expected a mapping, found {simulate.described()}")
        return
    section = document.at(simulate)
    yield from _unknown(section, ("plugins", "introspection", "timeout"))
    if section.get("plugins") is None:
        yield simulate.fail("plugins is missing")
    yield from _entries(section, "plugins")
    yield from _list(section, "introspection")
    timeout = section.node.mapping().get("timeout")
    if timeout is not None and timeout.kind != "int":
        yield timeout.fail(f"expected a whole number, found {timeout.described()}")


def _entries(document: Section, key: str) -> Iterator[BridgeError]:
    found = document.node.mapping().get(key)
    if found is None:
        return
    if found.kind != "seq":
        yield found.fail(f"expected a list, found {found.described()}")
        return
    for node in found.sequence():
        if node.kind != "map":
            yield node.fail(f"expected a mapping, found {node.described()}")
        elif key == "packages":
            yield from _package(document.at(node))
        else:
            yield from _plugin(document.at(node))


def _package(package: Section) -> Iterator[BridgeError]:
    for key in _TEXTS:
        yield from _text(package, key)
    for key in _LISTS:
        yield from _list(package, key)
    yield from _allowed(package, package.get("compiler"), COMPILERS)
    platforms = package.get("platforms")
    for node in platforms.sequence() if platforms and platforms.kind == "seq" else ():
        yield from _allowed(package, node, PLATFORMS)
    if registry := package.get("registry"):
        yield from _fields(package, registry, required=("server", "username", "password"), known=())
    keys = package.node.mapping().get("ssh")
    if keys is not None and keys.kind != "seq":
        yield keys.fail(f"expected a list, found {keys.described()}")
        return
    for node in keys.sequence() if keys else ():
        yield from _fields(package, node, required=("hostname", "value"), known=("file",))


def _keys(document: Section) -> Iterator[BridgeError]:
    """Keys that Rigel takes from the environment, for every command; the bridge never reads them."""
    packages = document.get("packages")
    for package in packages.sequence() if packages and packages.kind == "seq" else ():
        keys = package.value.get("ssh") if isinstance(package.value, dict) else None
        for node in keys.sequence() if keys and keys.kind == "seq" else ():
            parts = node.value if isinstance(node.value, dict) else {}
            variable, file = parts.get("value"), parts.get("file")
            if variable is not None and (file is None or file.value is False):
                yield variable.fail(f"Rigel needs the environment variable {variable.raw} for every command")


def _plugin(plugin: Section) -> Iterator[BridgeError]:
    yield from _unknown(plugin, ("name", "args", "kwargs", "entrypoint"))
    name = plugin.get("name")
    if name is None:
        yield plugin.node.fail("name is missing")
    elif name.kind in ("map", "seq") or name.raw.strip().count("/") != 1:
        yield name.fail("expected AUTHOR/MODULE, for example robotapp/rigel_bridge")
    yield from _list(plugin, "args", texts=False)
    yield from _text(plugin, "entrypoint")
    kwargs = plugin.node.mapping().get("kwargs")
    if kwargs is not None and kwargs.kind != "map":
        yield kwargs.fail(f"expected a mapping, found {kwargs.described()}")


def _fields(
    section: Section, node: Node, *, required: tuple[str, ...], known: tuple[str, ...]
) -> Iterator[BridgeError]:
    if node.kind != "map":
        yield node.fail(f"expected a mapping, found {node.described()}")
        return
    inner = section.at(node)
    yield from _unknown(inner, (*required, *known))
    for key in required:
        if inner.get(key) is None:
            yield node.fail(f"{key} is missing")
        yield from _text(inner, key)


def _unknown(section: Section, known: tuple[str, ...]) -> Iterator[BridgeError]:
    for key, node in section.unknown(known):
        yield node.fail(f"is not known here{nearest(key, list(known))}; known: {', '.join(known)}")


def _text(section: Section, key: str) -> Iterator[BridgeError]:
    found = section.node.mapping().get(key)
    if found is not None and found.kind in ("map", "seq", "null"):
        yield found.fail(f"expected text, found {found.described()}")


def _list(section: Section, key: str, *, texts: bool = True) -> Iterator[BridgeError]:
    found = section.node.mapping().get(key)
    if found is None:
        return
    if found.kind != "seq":
        yield found.fail(f"expected a list, found {found.described()}")
        return
    for node in found.sequence() if texts else ():
        if node.kind in ("map", "seq", "null"):
            yield node.fail(f"expected text, found {node.described()}")


def _allowed(section: Section, node: Node | None, allowed: tuple[str, ...]) -> Iterator[BridgeError]:
    if node is None or node.kind in ("map", "seq"):
        return
    try:
        text = str(section.templates.resolve(node).value)
    except BridgeError:  # reported with the other marks that do not resolve
        return
    if text not in allowed:
        yield node.fail(f"{text[:80]!r} is not allowed{nearest(text, list(allowed))}; allowed: {', '.join(allowed)}")
