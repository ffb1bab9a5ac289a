"""What one place of one file shows, the smallest piece of evidence."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Kind(StrEnum):
    """What was found. `subject` and `value` of a fact mean what stands behind each kind."""

    DEPENDENCY = "dependency"
    """package.xml: subject = package, value = build | exec | both."""
    EXPORT = "export"
    """package.xml: subject = tag, value = attributes as `key=value` separated by spaces."""
    NAME = "name"
    """subject = a word of the package's or the executable's name."""
    PLUGIN_BASE = "plugin_base"
    """Plug-in XML, PLUGINLIB_EXPORT_CLASS: subject = base class, value = class."""
    INHERITS = "inherits"
    """A class of the source: subject = base class as written (aliases resolved), value = class."""
    INCLUDE = "include"
    """subject = included header or imported module."""
    SYMBOL = "symbol"
    """A name of a library in code: subject = `serial.Serial`, `rs2::pipeline`, `SCHED_FIFO`, `AF_CAN`."""
    DEVICE_PATH = "device_path"
    """A device or interface in code, parameters or launch files: subject = `/dev/ttyUSB0`, `can0`; value = parameter."""
    TEXT = "text"
    """Another telling string literal: subject = the text (URLs, `cuda:0`, sysfs paths)."""
    BUILD = "build"
    """CMake: subject = `find_package`, `language`, `pkg_check_modules`, `link`; value = what."""
    UDEV = "udev"
    """A udev rule: subject = `vid:pid` in hex, or the subsystem; value = SYMLINK name or mode."""
    HARDWARE_PLUGIN = "hardware_plugin"
    """ros2_control in URDF or xacro: subject = plug-in class, value = its device parameter."""
    PUBLISHES = "publishes"
    """subject = type, value = topic."""
    SUBSCRIBES = "subscribes"
    """subject = type, value = topic."""
    SERVES = "serves"
    """A service or action server: subject = type, value = name."""
    CALLS = "calls"
    """A service or action client: subject = type, value = name."""
    PERIOD = "period"
    """subject = seconds as a number, value = where from (timer, rate, parameter)."""
    PARAMETER = "parameter"
    """subject = name, value = default."""
    NODE = "node"
    """A node class: subject = base class or constructor, value = node name."""
    COMPONENT = "component"
    """A composable node or nodelet: subject = class."""
    STARTS = "starts"
    """A launch file: subject = `package/executable` or plug-in class, value = node name."""
    INTERFACE = "interface"
    """A definition of msg, srv or action: subject = `package/msg/Name`."""
    ALIAS = "alias"
    """C++: what a name stands for in another file. subject = `Image` (using, typedef), `&callback` (its parameter) or
    `.member` (what it publishes or takes), value = type as written."""
    CURATED = "curated"
    """The table of well-known packages: subject = package, value = entry."""


@dataclass(frozen=True, slots=True)
class Fact:
    """One piece of evidence. `weight` is how much it counts for what it is evidence of (0 to 1), set by the reader at 1
    where it cannot judge; `line` 0 means the file as a whole; `file` is relative to the package, with slashes. In a profile it
    is `other_package/path` for a file of another package (a launch file starts its node), and empty where no source is.
    """

    kind: Kind
    subject: str
    value: str = ""
    file: str = ""
    line: int = 0
    weight: float = 1.0

    @property
    def place(self) -> str:
        return f"{self.file}:{self.line}" if self.line else self.file


NOT_HERE: Final = ", which is not in the workspace"
"""End of the message about a launch file that is included and cannot be followed."""


@dataclass(frozen=True, slots=True)
class Problem:
    """What could not be read and why; the rest is read nevertheless."""

    file: str
    message: str
    line: int = 0
