"""What a change of source changed: two profiles compared, value by value."""

from collections.abc import Iterator, Mapping
from typing import Any

from ros_profile.model.conclusions import Assessment, LaunchProfile, PackageProfile, Profile
from ros_profile.output.values import bits, duration


def difference(old: Profile, new: Profile) -> list[str]:
    """Lines `package …: what: before -> after`; empty when nothing that counts has changed."""
    before = {package.name: package for package in old.packages}
    after = {package.name: package for package in new.packages}
    lines = [f"{name}: package removed" for name in sorted(before.keys() - after.keys())]
    lines += [f"{name}: package added" for name in sorted(after.keys() - before.keys())]
    for name in sorted(before.keys() & after.keys()):
        lines += _package(before[name], after[name])
    return lines


def _package(old: PackageProfile, new: PackageProfile) -> Iterator[str]:
    yield from _assessment(new.name, old.assessment, new.assessment)
    parts_before = {executable.plugin or executable.name: executable for executable in old.executables}
    parts_after = {executable.plugin or executable.name: executable for executable in new.executables}
    yield from _members(new.name, "executable", parts_before, parts_after)
    for name in sorted(parts_before.keys() & parts_after.keys()):
        yield from _assessment(f"{new.name} {name}", parts_before[name].assessment, parts_after[name].assessment)
    files_before = {launch.file: launch for launch in old.launches}
    files_after = {launch.file: launch for launch in new.launches}
    yield from _members(new.name, "launch file", files_before, files_after)
    for name in sorted(files_before.keys() & files_after.keys()):
        yield from _launch(f"{new.name} {name}", files_before[name], files_after[name])


def _members(place: str, what: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    yield from (f"{place}: {what} {name} removed" for name in sorted(old.keys() - new.keys()))
    yield from (f"{place}: {what} {name} added" for name in sorted(new.keys() - old.keys()))


def _launch(place: str, old: LaunchProfile, new: LaunchProfile) -> Iterator[str]:
    yield from _assessment(place, old.assessment, new.assessment)
    before = {f"{e.source} -> {e.target} {e.topic}": e for e in old.edges}
    after = {f"{e.source} -> {e.target} {e.topic}": e for e in new.edges}
    yield from _members(place, "edge", before, after)
    nodes_before = {node.full_name: node for node in old.nodes}
    nodes_after = {node.full_name: node for node in new.nodes}
    yield from _members(place, "node", nodes_before, nodes_after)


def _assessment(place: str, old: Assessment, new: Assessment) -> Iterator[str]:
    before, after = _values(old), _values(new)
    for key in before:
        if before[key] != after[key]:
            yield f"{place}: {key}: {before[key]} -> {after[key]}"


def _values(assessment: Assessment) -> dict[str, str]:
    """What is compared; confidences alone are no change."""
    hardware = sorted(
        " ".join(p for p in (h.value.type, h.value.model, h.value.interface) if p) for h in assessment.hardware
    )
    return {
        "class": assessment.qos_class.value.value if assessment.qos_class else "unknown",
        "sub-class": assessment.sub_class.value.value if assessment.sub_class else "unknown",
        "deadline": duration(assessment.deadline_s.value) if assessment.deadline_s else "none",
        "budget": duration(assessment.latency_budget_s.value) if assessment.latency_budget_s else "none",
        "hardware": ", ".join(hardware) or "none",
        "placement": assessment.placement.value.value if assessment.placement else "unknown",
        "bandwidth": bits(assessment.bandwidth_bps.value) if assessment.bandwidth_bps else "unknown",
    }
