"""ROS names to Kubernetes names."""

import re
from typing import Final

from rigel_bridge.document.tree import Node

MAX_APP_NAME: Final = 40
MAX_COMPONENT_NAME: Final = 63
_OTHER: Final = re.compile(r"[^a-z0-9]+")


def label(text: str) -> str:
    """`teleop_robot` -> `teleop-robot`: how a package names its component, wherever the file names the package.

    Empty when no letter or digit is left.
    """
    return _OTHER.sub("-", text.lower()).strip("-")


def checked_label(text: str, node: Node, *, longest: int) -> str:
    """`label`, or an error at `node` when the result is empty or too long."""
    name = label(text)
    if not name:
        raise node.fail(f"{text!r} has no letter or digit to make a name of")
    if len(name) > longest:
        raise node.fail(f"name {name} is longer than {longest} characters")
    return name
