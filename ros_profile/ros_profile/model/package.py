"""A package as it was read: its manifest, its sources, its executables and what else lies in it."""

from dataclasses import dataclass, field

from ros_profile.model.endpoints import Endpoint, Parameter, Timer
from ros_profile.model.facts import Fact, Problem
from ros_profile.model.launch import LaunchFile


@dataclass(frozen=True, slots=True)
class Dependency:
    name: str
    kinds: tuple[str, ...]
    """`build`, `build_export`, `buildtool`, `exec`, `test`, `doc`; `depend` is build, build_export and exec."""
    line: int = 0


@dataclass(frozen=True, slots=True)
class Export:
    """A tag of <export>: `<nav_core plugin="${prefix}/x.xml"/>` is tag nav_core with attribute plugin."""

    tag: str
    text: str = ""
    attributes: tuple[tuple[str, str], ...] = ()
    line: int = 0


@dataclass(frozen=True, slots=True)
class Manifest:
    """package.xml. `ros_version` is 1, 2 or 0 (both or unknown). `tolerant`: catkin_pkg refused it."""

    name: str
    version: str = ""
    description: str = ""
    build_type: str = ""
    ros_version: int = 0
    dependencies: tuple[Dependency, ...] = ()
    exports: tuple[Export, ...] = ()
    file: str = "package.xml"
    tolerant: bool = False

    def depends(self, *kinds: str) -> frozenset[str]:
        """Names of the dependencies of any of these kinds; of all kinds without arguments."""
        return frozenset(d.name for d in self.dependencies if not kinds or set(kinds) & set(d.kinds))


@dataclass(frozen=True, slots=True)
class SourceFile:
    """What one source file holds: Python, C++, CMake, plug-in XML, URDF, udev rules, definitions. Readers give this."""

    file: str
    language: str
    """python | cpp | cmake | plugin_xml | urdf | udev | parameters | interface | setup."""
    facts: tuple[Fact, ...] = ()
    endpoints: tuple[Endpoint, ...] = ()
    timers: tuple[Timer, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    node_names: tuple[str, ...] = ()
    """Default names of nodes it creates, as written in code."""
    uses: tuple[str, ...] = ()
    """Other files of the package it needs: imported modules (`pkg.driver`), included headers (`pkg/driver.hpp`)."""
    executables: tuple["Executable", ...] = ()
    """Executables a build file (CMakeLists.txt, setup.py, setup.cfg) declares."""
    problems: tuple[Problem, ...] = ()
    text: str = ""
    """Of a parameter file of ROS 2 that is small enough to be handed on: the file itself."""


@dataclass(frozen=True, slots=True)
class Executable:
    """What a launch file can start. `kind`: program | script | component | plugin.

    `files` are the sources it is made of, relative to the package: in what a build file declares as it stands there,
    later with everything they include or import within the package.
    """

    name: str
    kind: str
    files: tuple[str, ...] = ()
    plugin: str = ""
    """Class of a component or plug-in, `pkg::Class`."""
    line: int = 0
    file: str = ""


@dataclass(frozen=True, slots=True)
class Package:
    manifest: Manifest
    path: str
    """Relative to the workspace, `.` when the package itself was given."""
    sources: tuple[SourceFile, ...] = ()
    executables: tuple[Executable, ...] = ()
    launch_files: tuple[LaunchFile, ...] = ()
    problems: tuple[Problem, ...] = ()

    @property
    def name(self) -> str:
        return self.manifest.name


@dataclass(frozen=True, slots=True)
class Unit:
    """What is classified as one: an executable with its files, or a whole package. Made from a Package by
    `decide.units`; everything of the files in one place.
    """

    package: Manifest
    name: str
    """Of the executable, or of the package."""
    kind: str
    """program | script | component | plugin | package."""
    facts: tuple[Fact, ...] = ()
    endpoints: tuple[Endpoint, ...] = ()
    timers: tuple[Timer, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    files: tuple[str, ...] = ()
    languages: frozenset[str] = field(default_factory=frozenset)
    has_launch: bool = False
