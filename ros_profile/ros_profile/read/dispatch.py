"""Which reader reads which file."""

from collections.abc import Callable
from typing import Final

from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import SourceFile
from ros_profile.read.cmake import read_cmake
from ros_profile.read.cpp import SUFFIXES as CPP_SUFFIXES
from ros_profile.read.cpp import read_cpp
from ros_profile.read.interfaces import SUFFIXES as INTERFACE_SUFFIXES
from ros_profile.read.interfaces import read_interface
from ros_profile.read.launch.python import read_launch_python
from ros_profile.read.launch.xml_file import read_launch_xml
from ros_profile.read.launch.yaml_file import read_launch_yaml
from ros_profile.read.parameters import read_parameters
from ros_profile.read.python.setup import read_setup_cfg, read_setup_py
from ros_profile.read.python.source import read_python
from ros_profile.read.udev import read_udev
from ros_profile.read.xml_files import read_xml

Reader = Callable[[bytes, str], SourceFile]

_BY_NAME: Final[dict[str, Reader]] = {
    "setup.py": read_setup_py,
    "setup.cfg": read_setup_cfg,
    "cmakelists.txt": read_cmake,
}
_BY_SUFFIX: Final[dict[str, Reader]] = {
    ".py": read_python,
    **dict.fromkeys((".yaml", ".yml"), read_parameters),
    **dict.fromkeys(CPP_SUFFIXES, read_cpp),
    ".cmake": read_cmake,
    **dict.fromkeys((".xml", ".urdf", ".xacro"), read_xml),
    ".rules": read_udev,
    **dict.fromkeys(INTERFACE_SUFFIXES, read_interface),
}


def reader_of(file: str, head: bytes = b"") -> Reader | None:
    """The reader for a file by its name; for one without suffix by its first line."""
    name = file.rpartition("/")[2].lower()
    if name == "package.xml" or name.endswith(".launch.py"):  # a part of launch files that no node runs
        return None
    if found := _BY_NAME.get(name):
        return found
    suffix = name[name.rfind(".") :] if "." in name else ""
    if not suffix:
        first = head[:100].partition(b"\n")[0]
        return read_python if first.startswith(b"#!") and b"python" in first else None
    return _BY_SUFFIX.get(suffix)


_BEFORE_ROOT: Final = ((b"<!--", b"-->"), (b"<?", b"?>"), (b"<!", b">"))

LaunchReader = Callable[[bytes, str], LaunchFile]


def launch_reader_of(file: str, data: bytes) -> LaunchReader | None:
    """The reader for a launch file, known by what stands in it: launch files are included under any name."""
    name = file.lower()
    if name.endswith(".py"):
        return read_launch_python if b"def generate_launch_description" in data else None
    if name.endswith(".launch"):
        return read_launch_xml
    if name.endswith(".xml") and _first_tag(data[:20_000]) == b"launch":
        return read_launch_xml
    if name.endswith((".yaml", ".yml")) and _is_list_of_actions(data[:20_000]):
        return read_launch_yaml
    return None


def _first_tag(data: bytes) -> bytes:
    """Returns the name of the root element, without what XML allows before it."""
    start = data.find(b"<")
    while start >= 0:
        end = next((mark for begin, mark in _BEFORE_ROOT if data.startswith(begin, start)), None)
        if end is None:
            words = data[start + 1 : start + 100].replace(b">", b" ").replace(b"/", b" ").split(maxsplit=1)
            return words[0] if words else b""
        closed = data.find(end, start)
        start = data.find(b"<", closed + len(end)) if closed >= 0 else -1
    return b""


def _is_list_of_actions(data: bytes) -> bool:
    """Returns whether a YAML file has a list under the key `launch`."""
    lines = [line for line in data.splitlines() if line.strip() and not line.lstrip().startswith(b"#")]
    after = (lines[index + 1] for index, line in enumerate(lines[:-1]) if line.split() == [b"launch:"])
    return any(line.lstrip().startswith(b"-") for line in after)
