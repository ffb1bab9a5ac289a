"""Lookup of packages, launch files, parameter files and executables of one workspace by name."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

from ros_profile.decide.units import executable_unit, known_unit, package_unit
from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import Executable, Package, SourceFile, Unit


class Index:
    """Everything launch files can name. Units are made once."""

    def __init__(self, packages: Iterable[Package], *, curated: bool = True) -> None:
        self._curated = curated
        self.packages = tuple(packages)
        self._by_name = {package.name: package for package in self.packages}
        self._units: dict[tuple[str, str, str], Unit] = {}

    def package(self, name: str) -> Package | None:
        return self._by_name.get(name)

    @cached_property
    def _plugins(self) -> dict[str, tuple[Package, Executable]]:
        return {e.plugin: (p, e) for p in self.packages for e in p.executables if e.plugin}

    def launch_file(self, package: str, path: str) -> tuple[Package, LaunchFile] | None:
        """The launch file at a path of a package; where the installed path differs from the source's, by its name."""
        holder = self._by_name.get(package)
        if holder is None:
            return None
        name = path.rpartition("/")[2]
        exact = [one for one in holder.launch_files if one.file == path.strip("/")]
        named = [one for one in holder.launch_files if one.file.rpartition("/")[2] == name]
        found = exact or (named if len(named) == 1 else [])
        return (holder, found[0]) if found else None

    def parameter_file(self, package: str, path: str) -> SourceFile | None:
        holder = self._by_name.get(package)
        if holder is None:
            return None
        name = path.rpartition("/")[2]
        files = [s for s in holder.sources if s.language == "parameters"]
        exact = [s for s in files if s.file == path.strip("/")]
        named = [s for s in files if s.file.rpartition("/")[2] == name]
        return next(iter(exact or named), None)

    def executable(self, package: str, name: str, plugin: str) -> tuple[Package, Executable] | None:
        """What a launch file starts; a script may be named with or without `.py`, and a component has a program as well."""
        if plugin:
            if plugin in self._plugins:
                return self._plugins[plugin]
            return self._similar(package, plugin)
        holder = self._by_name.get(package)
        if holder is None:
            return None
        names = (name, f"{name}.py", name.removesuffix(".py"))
        programs = [e for n in names for e in holder.executables if e.name == n]
        found = next((e for e in programs if not e.plugin), next(iter(programs), None))
        return (holder, found) if found else None

    def _similar(self, package: str, plugin: str) -> tuple[Package, Executable] | None:
        """A nodelet is named `package/Class`, whatever namespace its class has in C++."""
        slashed, simple = plugin.replace("/", "::"), _simple(plugin)
        for known, found in self._plugins.items():
            if known.replace("/", "::") == slashed or (found[0].name == package and _simple(known) == simple):
                return found
        return None

    def plugin_unit(self, plugin: str) -> Unit | None:
        """The unit of a plug-in that a parameter names by its class."""
        found = self._plugins.get(plugin)
        return self.unit(found[0].name, found[1].name, plugin) if found else None

    def unit(self, package: str, name: str, plugin: str) -> Unit | None:
        """The unit of what is started. A package with no executable that could be read stands for all it starts."""
        key = (package, name, plugin)
        if key not in self._units:
            found = self.executable(package, name, plugin)
            holder = self._by_name.get(package)
            if found:
                self._units[key] = _without_siblings(executable_unit(*found), found[1], found[0].executables)
            elif holder is None and self._curated and (known := known_unit(package, name, plugin)):
                self._units[key] = known
            elif holder is not None and len(holder.executables) <= 1 and holder.sources:
                self._units[key] = package_unit(holder)
            else:
                return None
        return self._units[key]


def _simple(plugin: str) -> str:
    return plugin.replace("/", "::").rpartition("::")[2]


def _without_siblings(unit: Unit, executable: Executable, others: Iterable[Executable]) -> Unit:
    """A library often holds several components: what the classes of the others make is not of this one."""
    own = _simple(executable.plugin)
    siblings = {_simple(one.plugin) for one in others if one.plugin} - {own}
    if not own or not siblings:
        return unit
    return replace(
        unit,
        endpoints=tuple(one for one in unit.endpoints if one.owner not in siblings),
        timers=tuple(one for one in unit.timers if one.owner not in siblings),
    )
