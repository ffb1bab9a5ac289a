"""ros2_control: what the control node opens is opened by the plug-ins that a robot model names."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from ros_profile.decide.classify.features import name_roles
from ros_profile.decide.launching import Launched
from ros_profile.decide.places import abroad
from ros_profile.decide.workspace import Index
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Package, SourceFile, Unit

_OPENING: Final = frozenset({Kind.SYMBOL, Kind.INCLUDE, Kind.DEVICE_PATH, Kind.TEXT, Kind.BUILD})
"""What shows in the code of a plug-in that it opens a device."""


def runs_control(launched: Launched) -> bool:
    """Returns whether a launched node is the control node of ros2_control, which loads hardware plug-ins."""
    return launched.executable == "ros2_control_node"


def with_control_hardware(unit: Unit, launched: Launched, index: Index) -> Unit:
    """Returns the unit of a control node with the evidence of the plug-ins that it loads."""
    package = index.package(launched.file.partition("/")[0])
    if package is None:
        return unit
    evidence = [fact for holder, source in _models(package, index) for fact in _plugin_evidence(holder, source, index)]
    if not evidence:
        return unit
    hosts = Fact(Kind.SYMBOL, "pluginlib::ClassLoader", "hardware_interface::SystemInterface", evidence[0].file)
    return replace(unit, facts=(*unit.facts, hosts, *evidence))


def _models(package: Package, index: Index) -> Iterator[tuple[Package, SourceFile]]:
    """Yields the robot models of a package and of those it depends on."""
    for name in (package.name, *sorted(package.manifest.depends("exec", "build") - {package.name})):
        if (holder := index.package(name)) is not None:
            yield from ((holder, source) for source in holder.sources if source.language == "urdf")


def _plugin_evidence(holder: Package, model: SourceFile, index: Index) -> Iterator[Fact]:
    """Yields what shows which devices the plug-ins of a model open; one that stands in for a device opens none."""
    plugins = [fact for fact in model.facts if fact.kind is Kind.HARDWARE_PLUGIN and not _is_simulated(fact.subject)]
    if not plugins:
        return
    for fact in model.facts:
        if fact.kind in (Kind.HARDWARE_PLUGIN, Kind.DEVICE_PATH):
            yield replace(fact, file=abroad(holder.name, fact.file))
    for plugin in plugins:
        package = plugin.subject.replace("::", "/").partition("/")[0]
        unit = index.unit(package, "", plugin.subject)
        for fact in unit.facts if unit is not None else ():
            if fact.kind in _OPENING:
                yield replace(fact, file=abroad(package, fact.file))


def _is_simulated(plugin: str) -> bool:
    parts = plugin.replace("::", "/").split("/")
    return any("simulation" in name_roles(part) for part in parts)
