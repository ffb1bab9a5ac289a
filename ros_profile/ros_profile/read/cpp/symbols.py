"""Library names, device paths, plug-in registrations and node names in C++."""

import re

from ros_profile.knowledge.libraries import CAN_INTERFACE, CPP_SYMBOLS, CUDA_TEXT, DEVICE_PATH, SYSFS_GPIO, URL
from ros_profile.model.facts import Fact, Kind
from ros_profile.read.cpp.text import literal_of
from ros_profile.read.cpp.tree import Call, Tree
from ros_profile.read.cpp.types import plain, resolved

_SYMBOLS = re.compile(rf"^(?:{'|'.join(CPP_SYMBOLS)})", re.MULTILINE)
_NAMES = re.compile(r"[A-Za-z_]\w*(?:::\w+){0,8}")
_DEVICE = re.compile(rf"(?<![\w]){DEVICE_PATH}")
_CAN = re.compile(CAN_INTERFACE)
_TEXT = re.compile(f"{SYSFS_GPIO}|{CUDA_TEXT}|{URL}")
_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*([<"])([^>"\n]{1,200})[>"]', re.MULTILINE)
_MACROS = re.compile(
    r"\b(?P<name>PLUGINLIB_(?:EXPORT|DECLARE)_CLASS|RCLCPP_COMPONENTS_REGISTER_NODE|CLASS_LOADER_REGISTER_CLASS)(?=\s*\()"
)
_NODES = re.compile(
    r"\b(?P<name>(?:rclcpp::|rclcpp_lifecycle::|nav2_util::|nav2::|ros2_common::)?(?:Lifecycle)?Node|Node::make_shared|ros::init|rclcpp::Node>)(?=\s*[({])"
)
_LOADER = re.compile(r"\b(?:pluginlib::)?ClassLoader\s*<\s*([\w:]{3,120})\s*>")
_MOST = 400
"""Facts of one kind per file: generated tables can hold thousands of equal lines."""


def facts(tree: Tree, file: str, names: dict[str, str]) -> list[Fact]:
    code = tree.source.code
    found = _symbols(tree, file)
    for match in list(_INCLUDE.finditer(code))[:_MOST]:
        mark, header = match.groups()
        if "/" in header or "." in header:
            local = "local" if mark == '"' else ""
            found.append(Fact(Kind.INCLUDE, header, local, file, tree.source.line(match.start(1))))
    for literal in tree.source.literals:
        if (fact := _literal(literal.text, file, tree.source.line(literal.start))) is not None:
            found.append(fact)
    for name, base, place in tree.bases():
        found.append(Fact(Kind.INHERITS, plain(resolved(base, names)), name, file, tree.source.line(place)))
    for call in tree.calls(_MACROS):
        found += _registration(call, file, tree.source.line(call.place), names)
    for match in _LOADER.finditer(code):
        loaded = plain(resolved(match.group(1), names))
        found.append(Fact(Kind.SYMBOL, "pluginlib::ClassLoader", loaded, file, tree.source.line(match.start())))
    return found


def _symbols(tree: Tree, file: str) -> list[Fact]:
    """The first place of each library name: looked for in the set of names of the file, which is a tenth of its text."""
    code = tree.source.code
    names: dict[str, str] = {}
    for name in set(_NAMES.findall(code)):
        names[name] = name
        for tail in range(name.count("::")):
            names.setdefault(name.split("::", tail + 1)[-1], name)
    found: list[Fact] = []
    for match in _SYMBOLS.finditer("\n".join(names)):
        place = code.find(names.get(match.group(), match.group()))
        found.append(Fact(Kind.SYMBOL, match.group(), "", file, tree.source.line(max(0, place))))
    return sorted(found, key=lambda fact: (fact.line, fact.subject))[:_MOST]


def _literal(text: str, file: str, line: int) -> Fact | None:
    if len(text) > 300:
        return None
    device = _DEVICE.search(text)
    if device is not None:
        return Fact(Kind.DEVICE_PATH, device.group(), "", file, line)
    if _CAN.match(text):
        return Fact(Kind.DEVICE_PATH, text, "", file, line)
    if _TEXT.search(text):
        return Fact(Kind.TEXT, text, "", file, line)
    return None


def _registration(call: Call, file: str, line: int, names: dict[str, str]) -> list[Fact]:
    types = [plain(resolved(a, names)) for a in call.arguments]
    if call.name.startswith("RCLCPP") and types:
        return [Fact(Kind.COMPONENT, types[0], "", file, line)]
    if len(types) < 2:
        return []
    name, base = types[-2], types[-1]
    found = [Fact(Kind.PLUGIN_BASE, base, name, file, line)]
    if base in {"nodelet::Nodelet", "rclcpp_components::NodeFactory"}:
        found.append(Fact(Kind.COMPONENT, name, "nodelet", file, line))
    return found


def nodes(tree: Tree, file: str) -> list[Fact]:
    """Constructors and factories of nodes with the name they give."""
    found: list[Fact] = []
    for call in tree.calls(_NODES):
        position = 2 if call.name == "ros::init" else 0
        name = literal_of(call.arguments[position]) if len(call.arguments) > position else None
        if name:
            found.append(Fact(Kind.NODE, call.name, name, file, tree.source.line(call.place)))
    return found
