"""What the author of a RobotApp made of a launch file has to decide, to add, or to know: comments in the file, lines of a report."""

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ros_profile.model.conclusions import LaunchedNode, LaunchProfile
from ros_profile.model.launch import shorten_substitutions
from ros_profile.output.commands import absolute_files, complete_arguments, is_untold
from ros_profile.output.hardware import EXCLUSIVE_TYPES
from ros_profile.output.names import MAX_COMPONENTS, ROS1_DISTROS
from ros_profile.output.processes import (
    ENDING,
    OPERATOR_VARIABLES,
    VARIABLE_NAME,
    VIEWERS,
    Component,
    components,
    inline_files,
    list_processes,
    network_of,
    opened_hardware,
)
from ros_profile.output.values import claimable, distinct, library, perhaps, requirement, unclaimed


class Note(NamedTuple):
    """One sentence about the app. `subject`: components, or the file of the problem; "" where the sentence names its own."""

    subject: str
    text: str
    file: str
    line: int
    lost: bool = True
    """Something of the launch file is not in the app; False for what is in it and may not belong there."""

    def __str__(self) -> str:
        return f"{self.subject}: {self.text}" if self.subject else self.text


def list_notes(launch: LaunchProfile, distro: str) -> list[Note]:
    """Returns the notes in the order of a reader: doubts, components, what is left out, what could not be read."""
    parts = components(launch.nodes)
    notes = list(_note_doubts(parts))
    taken = inline_files(parts, dict(launch.parameter_texts), ros1=distro in ROS1_DISTROS)
    for component, files in zip(parts, taken, strict=True):
        notes += _note_component(component, files, distro)
    notes += _note_absent(launch)
    notes += [Note(one.file, one.message[:300], one.file, one.line) for one in launch.problems]
    return list(dict.fromkeys(notes))


def _note_absent(launch: LaunchProfile) -> Iterator[Note]:
    """Yields what of the launch file is no component."""
    for node in launch.nodes:
        name = f"{node.executable} of {node.package}"
        if node.executable in ENDING:
            text = f"{name} ends by itself and is left out: a RobotApp would start it again and again; start it in another component, by a launch file"
            yield Note("", text, node.file, node.line)
        elif node.executable in VIEWERS:
            yield Note("", f"{name} is left out: it belongs on a desk", node.file, node.line)
    for part in list_processes(launch.nodes)[MAX_COMPONENTS:]:
        text = f"is left out: an app has at most {MAX_COMPONENTS} components; put it into an app of its own"
        yield Note(part.name, text, part.nodes[0].file, part.nodes[0].line)


def _note_doubts(parts: Iterable[Component]) -> Iterator[Note]:
    """Yields components that may not belong: conditions of a launch file often choose one of several drivers."""
    doubtful = [part for part in parts if not all(node.certain for node in part.nodes)]
    for part in doubtful:
        text = "is started under a condition that the launch file works out; leave it out where it does not hold"
        yield Note(part.name, text, part.nodes[0].file, part.nodes[0].line, lost=False)
    owners: dict[str, list[Component]] = {}
    for part in doubtful:
        kinds = {hardware.type for node in part.nodes for hardware in opened_hardware(node)}
        for kind in sorted(kinds & EXCLUSIVE_TYPES):
            owners.setdefault(kind, []).append(part)
    for kind, rivals in owners.items():
        if len(rivals) > 1:
            names = ", ".join(part.name for part in rivals)
            text = f"each wants a {kind} device for itself, under a condition: keep the one that your robot has"
            yield Note(names, text, rivals[0].nodes[0].file, rivals[0].nodes[0].line, lost=False)


def _note_component(component: Component, files: Iterable[str], distro: str) -> Iterator[Note]:
    """Yields what of a component the reader has to decide about or to add. `files`: the parameter files in the app."""
    taken = frozenset(files)
    first = component.nodes[0]
    for node in component.nodes:
        for doubted in node.assessment.doubted:
            yield Note(component.name, f"perhaps {perhaps(doubted)}: left out", first.file, first.line)
    for node in component.nodes:
        for one in claimable(opened_hardware(node)):
            if library(one):
                text = f"{requirement(one)['type']} is opened through {library(one)}; where a robot has several, write the interface, usbID or model"
                yield Note(component.name, text, node.file, node.line, lost=False)
        for text in _describe_node(node, taken, distro):
            yield Note(component.name, text, node.file, node.line)


def _describe_node(node: LaunchedNode, taken: frozenset[str], distro: str) -> Iterator[str]:
    hardware = opened_hardware(node)
    yield from unclaimed(hardware)
    if (network := network_of(node)) and len(hardware) < len(distinct(node.assessment.hardware)):
        yield f"no serial device, because of {network}"
    if is_untold(node):
        words = " ".join(complete_arguments(node))[:300]
        yield f"is started with arguments that the launch file works out; add them to args: {words}"
    yield from _describe_worked_out(node)
    yield from _describe_start(node, ros1=distro in ROS1_DISTROS)
    passed = taken.union(absolute_files(node))
    for file in node.parameter_files:
        if file not in passed:
            yield f"parameters of {_file_name(file)} are not in the app; write the file under parameters"


def _describe_start(node: LaunchedNode, *, ros1: bool) -> Iterator[str]:
    """Yields what of the way a node is started is not in its command line and variables."""
    if node.prefix and (ros1 or node.plugin or "$" in node.prefix):
        yield f"is started with {node.prefix[:100]} before its program, which is left out"
    for key, value in node.environment:
        if key in OPERATOR_VARIABLES:
            yield f"variable {key}={value[:100]} is left out, because the operator sets it; write spec.ros{1 if ros1 else 2}"
        elif "$" in value or not VARIABLE_NAME.fullmatch(key):
            yield f"variable {key[:100]} is worked out by the launch file; write it under env"


def _describe_worked_out(node: LaunchedNode) -> Iterator[str]:
    """Yields what of a node's start only the launch file knows, and is therefore missing."""
    if "$" in node.namespace:
        yield f"its namespace is worked out by the launch file ({node.namespace[:100]}); add -r __ns:=/… to args where there is one"
    missing = (
        (node.parameters, "parameter", "write it into a parameter file"),
        (node.remaps, "remap", "add it to args"),
    )
    in_arguments = {word.partition(":=")[0] for word in node.arguments if ":=" in word}  # ROS 1 reads remaps there, too
    for pairs, what, cure in missing:
        for key, value in pairs:
            if what == "remap" and key in in_arguments:
                continue
            if "$" in key + value or "\n" in value:
                yield f"{what} {key[:100]} is worked out by the launch file; {cure}"


def _file_name(file: str) -> str:
    """Returns the name of a parameter file as far as the launch file tells it.

    >>> _file_name("base/config/$(?).yaml"), _file_name("base/ | humble) | $(?).yaml")
    ('a file whose name the launch file works out (base/config/….yaml)', 'a file whose name the launch file works out')
    """
    if not re.search(r"[$|?]", file):
        return file
    readable = shorten_substitutions(file)
    return "a file whose name the launch file works out" + (f" ({readable[:100]})" if readable else "")
