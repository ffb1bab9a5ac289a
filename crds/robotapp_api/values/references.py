"""References such as $(ROBOTAPP_ROBOT) in fields that the operator fills in, by the kubelet's rules: `$$(NAME)` stays as it is."""

import re
from collections.abc import Mapping
from typing import Final

_REFERENCE: Final = re.compile(r"\$\$|\$\(([A-Za-z_][A-Za-z0-9_]*)\)")


def replace_references(text: str, values: Mapping[str, str]) -> str:
    """Returns the text with the value of each name in place of its reference. Other references stay, for the kubelet."""
    return _REFERENCE.sub(lambda match: values.get(match[1] or "", match[0]), text)


def to_ros_name(text: str) -> str:
    """Returns the text as a part of a ROS name, which has letters, digits and underscores and begins with no digit: amr-07 is amr_07."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return f"robot_{name}" if name[:1].isdigit() else name
