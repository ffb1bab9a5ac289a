"""XML files of a package that are no launch files: plug-in descriptions and robot models (URDF, xacro)."""

from collections.abc import Iterator
from typing import Any

from ros_profile.model.facts import Fact, Kind, Problem
from ros_profile.model.package import SourceFile
from ros_profile.read.parameters import text_facts
from ros_profile.read.xml_text import Unreadable, attribute, line_of, parse, tag_of

_PLUGIN_ROOTS = frozenset({"class_libraries", "library", "libraries"})
_MOST_BYTES = 1 << 20


def read_xml(data: bytes, file: str) -> SourceFile:
    """By the name of the root element; XML of another kind (behaviour trees, worlds) gives nothing."""
    if len(data) <= _MOST_BYTES and not any(mark in data for mark in (b"librar", b"<robot", b":xacro")):
        return SourceFile(file, "xml")
    root = parse(data)
    if isinstance(root, Unreadable):
        return SourceFile(file, "xml", problems=(Problem(file, root.message, root.line),))
    name = tag_of(root)
    if name in _PLUGIN_ROOTS:
        return SourceFile(file, "plugin_xml", tuple(_plugins(root, file)))
    if name == "robot":
        return SourceFile(file, "urdf", tuple(_model(root, file)))
    return SourceFile(file, "xml")


def _plugins(root: Any, file: str) -> Iterator[Fact]:
    for element in root.iter():
        if tag_of(element) != "class":
            continue
        base, name = attribute(element, "base_class_type", "base_class"), attribute(element, "type", "name")
        if not base and not name:
            continue
        yield Fact(Kind.PLUGIN_BASE, base.lstrip(":"), name.lstrip(":"), file, line_of(element))
        if base.endswith("nodelet::Nodelet"):
            yield Fact(Kind.COMPONENT, name.lstrip(":"), "nodelet", file, line_of(element))


def _model(root: Any, file: str) -> Iterator[Fact]:
    """ros2_control hardware, and the device paths in its parameters and in arguments of xacro."""
    for element in root.iter():
        tag = tag_of(element)
        if tag == "hardware":
            yield from _hardware(element, file)
        elif tag in {"arg", "property"}:
            text = attribute(element, "default", "value")
            yield from text_facts(text, file, line_of(element), attribute(element, "name"))


def _hardware(element: Any, file: str) -> Iterator[Fact]:
    plugins = [child for child in element if tag_of(child) == "plugin" and (child.text or "").strip()]
    device = ""
    for child in element:
        if tag_of(child) == "param":
            found = list(text_facts((child.text or "").strip(), file, line_of(child), attribute(child, "name")))
            device = device or next((fact.subject for fact in found), "")
            yield from found
    for plugin in plugins:
        yield Fact(Kind.HARDWARE_PLUGIN, plugin.text.strip()[:200], device, file, line_of(plugin))
