"""Launch files as they were read, and what they start once includes are followed."""

import re
from dataclasses import dataclass
from typing import Final

from ros_profile.model.facts import Problem

UNKNOWN_TEXT: Final = "$(?)"
"""In a text: what cannot be read without running the file."""
NOT: Final = "not "
"""Before a condition that must be false: `unless` of every format of launch files."""


@dataclass(frozen=True, slots=True)
class LaunchArgument:
    name: str
    default: str | None
    """None: it must be given."""
    line: int = 0


@dataclass(frozen=True, slots=True)
class StartedNode:
    """A node or composable node. Texts may hold `$(var name)` (also for `$(arg name)` and LaunchConfiguration),
    `$(find pkg)`, `$(env X default)`; what cannot be read is UNKNOWN_TEXT.
    """

    package: str
    executable: str
    """Empty for a composable node."""
    plugin: str = ""
    """Class of a composable node, or nodelet type `pkg/Class`."""
    name: str = ""
    namespace: str = ""
    remaps: tuple[tuple[str, str], ...] = ()
    parameters: tuple[tuple[str, str], ...] = ()
    parameter_files: tuple[str, ...] = ()
    arguments: tuple[str, ...] = ()
    container: str = ""
    """Name of the container a composable node is loaded into: one process."""
    conditions: tuple[str, ...] = ()
    """Texts that must be true; `not …` for `unless`."""
    lifecycle: bool = False
    file: str = ""
    line: int = 0
    text_parameters: tuple[str, ...] = ()
    """Names of parameters whose value is a text, whatever it looks like: `"1.0"` of Python, `type="str"` of XML."""
    environment: tuple[tuple[str, str], ...] = ()
    prefix: str = ""
    """What stands before the program on its command line, such as `chrt -f 80`."""


@dataclass(frozen=True, slots=True)
class Include:
    """Another launch file: `target` like `$(find pkg)/launch/x.launch.py` or a path relative to this file."""

    target: str
    arguments: tuple[tuple[str, str], ...] = ()
    namespace: str = ""
    remaps: tuple[tuple[str, str], ...] = ()
    conditions: tuple[str, ...] = ()
    line: int = 0
    environment: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class LaunchFile:
    file: str
    format: str
    """python | xml | yaml."""
    arguments: tuple[LaunchArgument, ...] = ()
    nodes: tuple[StartedNode, ...] = ()
    includes: tuple[Include, ...] = ()
    parameters: tuple[tuple[str, str], ...] = ()
    """ROS 1: global `<param>` by absolute name."""
    problems: tuple[Problem, ...] = ()


def shorten_substitutions(text: str) -> str:
    """Returns a text with … for each substitution, or nothing where they are cut or inside each other.

    >>> shorten_substitutions("$(find base)/config/$(?).yaml"), shorten_substitutions("$(?) | humble) | x")
    ('…/config/….yaml', '')
    """
    readable = re.sub(r"\$\([^()$]*\)", "…", text)
    return "" if re.search(r"[$()|?']", readable) else readable
