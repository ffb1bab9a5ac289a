"""A profile for people: one paragraph per package, with reasons and evidence on request."""

import re
import textwrap
from collections.abc import Iterable, Iterator
from typing import Any, Final

from ros_profile.model.conclusions import Assessment, Estimate, LaunchProfile, PackageProfile, Profile
from ros_profile.model.facts import Kind, Problem
from ros_profile.output.values import bits, duration

MAX_EVIDENCE: Final = 6
MAX_EDGES: Final = 40
_NO_FILE: Final = {
    "": "(its source is not here)",
    "curated": "(table of well-known nodes)",
    "table": "(table of well-known packages)",
}
_SHOWN: Final = {"both": "build and run", "exec": "run"}
"""Words of the manifest that read badly alone."""


WIDTH: Final = 100
_HARD: Final = "\N{NO-BREAK SPACE}"


def text(profile: Profile, *, explain: bool = False, width: int = WIDTH) -> str:
    """The whole profile, in lines of `width` characters where words allow it."""
    lines: list[str] = []
    for package in profile.packages:
        lines += [*_package(package, explain=explain), ""]
    lines += _problems(profile.problems)
    # A name in a source may hold line ends: it must not look like a line of ours, such as another class.
    plain = [line.replace("\n", "\\u000a") for line in lines]
    return "\n".join(part for line in plain for part in _fitted(line, width)).rstrip("\n") + "\n"


def _fitted(line: str, width: int) -> list[str]:
    """A line that is too long in several, the rest indented; `deadline 10ms` and what stands in brackets stay whole."""
    if len(line) <= width:
        return [line]
    indent = line[: len(line) - len(line.lstrip())]
    first, *parts = line.strip().split(" · ")
    whole = re.sub(r" \([^()]*\)", lambda found: found[0].replace(" ", _HARD), first)
    joined = f"{_HARD}· ".join([whole, *(part.replace(" ", _HARD) for part in parts)])
    wrapped = textwrap.wrap(
        joined,
        width,
        initial_indent=indent,
        subsequent_indent=f"{indent}      ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [part.replace(_HARD, " ") for part in wrapped]


def _package(package: PackageProfile, *, explain: bool) -> Iterator[str]:
    version = f"ROS {package.ros_version}" if package.ros_version else "ROS 1 and 2"
    yield f"{package.name} ({version}, {package.path})"
    yield from _assessment(package.assessment, "  ", explain=explain)
    for executable in package.executables:
        shown = executable.plugin or executable.name
        yield f"  {executable.kind} {shown}: {summary(executable.assessment)}"
        if explain:
            yield from _evidence(executable.assessment, "      ")
    for launch in package.launches:
        yield from _launch(launch, explain=explain)
    yield from _problems(package.problems, "  ")


def _assessment(assessment: Assessment, indent: str, *, explain: bool) -> Iterator[str]:
    yield f"{indent}{summary(assessment)}"
    if explain:
        yield from _evidence(assessment, indent + "  ")
    for hint in assessment.hints:
        yield f"{indent}hint: {hint}"


def summary(assessment: Assessment) -> str:
    """`realtime (RT-C, 0.93) · deadline 50ms · budget 17ms · serial (0.9) · robot`."""
    parts = []
    if assessment.qos_class is None:
        parts.append("class unknown")
    else:
        sub_class = f"{assessment.sub_class.value.value}, " if assessment.sub_class else ""
        parts.append(f"{assessment.qos_class.value.value} ({sub_class}{assessment.qos_class.confidence:.2f})")
    if assessment.deadline_s is not None:
        parts.append(f"deadline {duration(assessment.deadline_s.value)}")
    if assessment.latency_budget_s is not None:
        parts.append(f"budget {duration(assessment.latency_budget_s.value)}")
    parts += [_hardware(one) for one in assessment.hardware]
    parts += [_hardware(one, "?") for one in assessment.doubted]
    if assessment.placement is not None:
        parts.append(assessment.placement.value.value)
    if assessment.bandwidth_bps is not None:
        parts.append(f"{bits(assessment.bandwidth_bps.value)}bit/s")
    if assessment.lifecycle:
        parts.append("lifecycle")
    return " · ".join(parts)


def _hardware(estimate: Estimate[Any], doubt: str = "") -> str:
    hardware = estimate.value
    more = " ".join(part for part in (hardware.model, hardware.interface, hardware.usb_id) if part)
    shown = f"{hardware.type} {more}".strip()
    return f"{shown}{doubt} ({estimate.confidence:.2f})"


def _evidence(assessment: Assessment, indent: str) -> Iterator[str]:
    named: list[tuple[str, Estimate[Any] | None]] = [
        ("class", assessment.qos_class),
        ("sub-class", assessment.sub_class),
        ("deadline", assessment.deadline_s),
        ("budget", assessment.latency_budget_s),
        ("placement", assessment.placement),
        ("bandwidth", assessment.bandwidth_bps),
    ]
    named += [(one.value.type, one) for one in assessment.hardware]
    named += [(f"{one.value.type}?", one) for one in assessment.doubted]
    for name, estimate in named:
        if estimate is None or not (estimate.reason or estimate.evidence):
            continue
        yield f"{indent}{name}: {estimate.reason}".rstrip(": ")
        for fact in estimate.evidence[:MAX_EVIDENCE]:
            value = f" ({_SHOWN.get(fact.value, fact.value)})" if fact.value else ""
            subject = f"{fact.subject} s" if fact.kind is Kind.PERIOD else fact.subject
            place = _NO_FILE["table"] if fact.kind is Kind.CURATED else _NO_FILE.get(fact.file, fact.place)
            yield f"{indent}  {place}  {fact.kind.value} {subject}{value}  [{fact.weight:g}]"
        if len(estimate.evidence) > MAX_EVIDENCE:
            yield f"{indent}  and {len(estimate.evidence) - MAX_EVIDENCE} more"


def _launch(launch: LaunchProfile, *, explain: bool) -> Iterator[str]:
    yield f"  launch {launch.file}: {summary(launch.assessment)}"
    for node in launch.nodes:
        what = node.plugin or node.executable
        doubt = "" if node.certain else "  (depends on a condition)"
        yield f"    {node.full_name}  {node.package}/{what}: {summary(node.assessment)}{doubt}"
        if explain:
            yield from _evidence(node.assessment, "        ")
    for edge in launch.edges[:MAX_EDGES]:
        yield f"    {edge.source} -> {edge.target}  {edge.kind.lower()} {edge.topic} {edge.type}".rstrip()
    if len(launch.edges) > MAX_EDGES:
        yield f"    and {len(launch.edges) - MAX_EDGES} more edges; --format json has all"
    yield from _problems(launch.problems, "    ")


def _problems(problems: Iterable[Problem], indent: str = "") -> Iterator[str]:
    for problem in problems:
        place = f"{problem.file}:{problem.line}" if problem.line else problem.file
        yield f"{indent}note: {place} {problem.message}"
