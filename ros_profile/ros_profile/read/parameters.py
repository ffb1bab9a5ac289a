"""Parameter files: `ros__parameters` of ROS 2, plain mappings of ROS 1, generate_parameter_library definitions."""

import re
from collections.abc import Iterator
from typing import Final

from ros_profile.model.endpoints import Parameter
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import SourceFile
from ros_profile.read import yaml_text
from ros_profile.read.text import decode

MAX_PARAMETERS: Final = 2000
MAX_BLANKS: Final = 8
"""Of a text that names a device, such as a command line; a longer one, or one in other letters, is a sentence for people."""
MAX_HANDED_ON: Final = 60_000
"""Bytes of a parameter file that a RobotApp takes over as it stands."""
DEVICE_PATH: Final = re.compile(
    r"/dev/(?:tty(?:USB|ACM|S|AMA|THS|O|mxc)?[\w*-]*|video\w*|input/\w+|serial/[\w/.:-]+|i2c-\w+|spidev[\w.]*|gpiochip\w*|hidraw\w*|bus/usb[\w/]*|[a-z][\w-]{1,40})"
    r"|\bs?v?can\d{1,2}\b"
)
_NO_DEVICE: Final = frozenset(
    f"/dev/{name}" for name in ("null", "stdout", "stderr", "stdin", "shm", "random", "urandom", "tty")
)
_TELLING: Final = re.compile(r"cuda(?::\d+)?|/sys/class/\w+[\w/]*|(?:rtsp|http|https|tcp|udp|serial)://\S+")


def read_parameters(data: bytes, file: str) -> SourceFile:
    """Any YAML file of a package; what is no parameter file gives nothing."""
    root, problems = yaml_text.parse(data, file)
    if root is None or root.kind != "map":
        return SourceFile(file, "parameters", problems=problems)
    generated = _is_parameter_library(root)
    found = list(_library(root, file) if generated else _values(root, file))[:MAX_PARAMETERS]
    facts = [
        fact for parameter in found for fact in text_facts(parameter.default, file, parameter.line, parameter.name)
    ]
    text = decode(data) if any(parameter.node for parameter in found) and len(data) <= MAX_HANDED_ON else ""
    return SourceFile(file, "parameters", tuple(facts), parameters=tuple(found), problems=problems, text=text)


def text_facts(text: str, file: str, line: int, name: str = "") -> Iterator[Fact]:
    """What a text value shows: device paths, and texts that tell of hardware."""
    if len(text) > 1000 or text.count(" ") > MAX_BLANKS or not text.isascii():
        return
    for match in DEVICE_PATH.finditer(text):
        if match[0] not in _NO_DEVICE:
            yield Fact(Kind.DEVICE_PATH, match[0], name, file, line)
    if found := _TELLING.match(text):
        yield Fact(Kind.TEXT, found[0][:200], name, file, line)


def _is_parameter_library(root: yaml_text.Node) -> bool:
    """generate_parameter_library: leaves are mappings with `type` and perhaps `default_value`."""
    return any(
        child.kind == "map" and any(_is_definition(leaf) for _, _, leaf in child.items())
        for _, _, child in root.items()
    ) or any("default_value" in name.rsplit(".", 1)[-1] for name, _ in yaml_text.scalars(root))


def _is_definition(node: yaml_text.Node) -> bool:
    kind = node.get("type")
    return kind is not None and kind.kind == "scalar" and node.get("default_value") is not None


def _library(root: yaml_text.Node, file: str, prefix: str = "", owner: str = "") -> Iterator[Parameter]:
    for key, line, child in root.items():
        if child.kind != "map":
            continue
        if not owner:
            yield from _library(child, file, "", key)
        elif (kind := child.get("type")) is not None and kind.kind == "scalar":
            default = child.get("default_value")
            yield Parameter(f"{prefix}{key}", default.text if default else "", file, line, owner=owner)
        else:
            yield from _library(child, file, f"{prefix}{key}.", owner)


def _values(root: yaml_text.Node, file: str, path: str = "") -> Iterator[Parameter]:
    """ROS 2: below each `ros__parameters`, with the keys above as node name. Without any: ROS 1, names as they are."""
    ros2 = list(_below_marker(root, file, path))
    if ros2:
        yield from ros2
        return
    for name, node in yaml_text.scalars(root):
        yield Parameter(name, node.text, file, node.line)


def _below_marker(node: yaml_text.Node, file: str, path: str) -> Iterator[Parameter]:
    for key, _, child in node.items():
        if key == "ros__parameters":
            for name, leaf in yaml_text.scalars(child):
                yield Parameter(name, leaf.text, file, leaf.line, node=path or "/**")
        elif child.kind == "map":
            yield from _below_marker(child, file, f"{path}/{key.strip('/')}" if path else key)
