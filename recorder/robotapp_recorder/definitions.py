"""The text of a message definition with all the types it uses, as MCAP files of ROS 2 hold it (`ros2msg`). Pure."""

import re
from collections.abc import Callable
from typing import Final

Read = Callable[[str, str], str | None]
"""Returns the text of `PACKAGE/msg/NAME.msg`, None where it is not installed."""

_BETWEEN: Final = "=" * 80
_TYPE: Final = re.compile(r"^([A-Za-z]\w*(?:/[A-Za-z]\w*)*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[A-Za-z]\w*")
_BUILT_IN: Final = frozenset(
    [
        "bool",
        "byte",
        "char",
        "float32",
        "float64",
        "int8",
        "uint8",
        "int16",
        "uint16",
        "int32",
        "uint32",
        "int64",
        "uint64",
        "string",
        "wstring",
    ]
)


def write_definition(type_name: str, read: Read) -> str | None:
    """Returns the definition of a type such as `std_msgs/msg/String`; None where a part of it is not installed."""
    package, name = _split(type_name)
    text = read(package, name)
    if text is None:
        return None
    parts, waiting, finished_types = [text], list_used_types(text, package), {f"{package}/{name}"}
    while waiting:
        used = waiting.pop(0)
        if used in finished_types:
            continue
        finished_types.add(used)
        used_package, used_name = used.split("/")
        used_text = read(used_package, used_name)
        if used_text is None:
            return None
        parts.append(f"{_BETWEEN}\nMSG: {used}\n{used_text}")
        waiting += list_used_types(used_text, used_package)
    return "\n".join(parts)


def list_used_types(text: str, package: str) -> list[str]:
    """Returns the types of the fields of a definition that are messages themselves, as `PACKAGE/NAME`."""
    used = []
    for line in text.splitlines():
        field = _TYPE.match(line.split("#", 1)[0].strip())
        if field and field[1] not in _BUILT_IN:
            used.append("/".join(_split(field[1] if "/" in field[1] else f"{package}/{field[1]}")))
    return used


def _split(type_name: str) -> tuple[str, str]:
    """Returns package and name of `std_msgs/msg/String` or `std_msgs/String`."""
    first, *_, last = type_name.split("/")
    return first, last
