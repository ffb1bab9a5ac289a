"""A profile for programs: JSON, pod annotations, the scheduler block of a Rigelfile."""

import json
from typing import Any, Final

import msgspec
import yaml

from ros_profile.model.conclusions import Assessment, PackageProfile, Placement, Profile
from ros_profile.output.names import SCHEDULER_PREFIX
from ros_profile.output.values import claimable, distinct, library, perhaps, policies, requirement, unclaimed

_SNAKE: Final = {"qos_class": "qos_class", "latency_budget": "latency_budget", "deadline": "deadline"}


def as_json(profile: Profile) -> str:
    """Everything, with evidence."""
    return msgspec.json.format(msgspec.json.encode(profile), indent=2).decode() + "\n"


def from_json(data: bytes) -> Profile:
    """What `as_json` wrote. ValueError for anything else."""
    try:
        return msgspec.json.decode(data, type=Profile)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(f"is no profile in JSON: {error}") from error


def annotations(assessment: Assessment) -> dict[str, str]:
    """The annotations of a pod, JSON in each."""
    found: dict[str, Any] = {"policies": policies(assessment, _SNAKE)}
    hardware = [requirement(one) for one in claimable(distinct(assessment.hardware))]
    if hardware:
        found["affinity"] = {"hardware_requirements": hardware}
    return {f"{SCHEDULER_PREFIX}{key}": json.dumps(value, sort_keys=True) for key, value in found.items() if value}


def as_annotations(profile: Profile) -> str:
    """One YAML document per package: what belongs under `metadata.annotations` of its pod."""
    return "---\n".join(
        _document(package.name, annotations(package.assessment), package) for package in profile.packages
    )


def scheduler_block(assessment: Assessment) -> dict[str, Any]:
    """The `scheduler` block of a Rigelfile."""
    block: dict[str, Any] = {}
    if stated := policies(assessment, _SNAKE):
        block["policies"] = stated
    hardware = [requirement(one) for one in claimable(distinct(assessment.hardware))]
    if hardware:
        block["affinity"] = {"hardware_requirements": hardware}
    return block


def as_rigelfile(profile: Profile) -> str:
    """What belongs under `orchestration` of a Rigelfile: one block for a package alone, else one per package."""
    packages = [package for package in profile.packages if scheduler_block(package.assessment)]
    if len(profile.packages) == 1 and packages:
        return _document("orchestration", {"scheduler": scheduler_block(packages[0].assessment)}, packages[0])
    blocks = {package.name: {"scheduler": scheduler_block(package.assessment)} for package in packages}
    comments = [
        line
        for package in profile.packages
        if package.name in blocks or package.assessment.doubted
        for line in _comments(package)
    ]
    return "".join(comments) + _dump({"orchestration": {"components": blocks}})


def _document(key: str, body: dict[str, Any], package: PackageProfile) -> str:
    return "".join(_comments(package)) + _dump({key: body})


def _comments(package: PackageProfile) -> list[str]:
    """What was left out and why, so that the user can decide."""
    assessment = package.assessment
    lines = [f"# {package.name}: inferred from its source; ros-scheduler-profile --explain shows why\n"]
    lines += [
        f"# {package.name}: perhaps {perhaps(one)}: left out, a wrong one keeps the pod pending\n"
        for one in assessment.doubted
    ]
    lines += [
        f"# {package.name}: {requirement(one)['type']} is opened through {library(one)}\n"
        for one in distinct(assessment.hardware)
        if library(one)
    ]
    lines += [f"# {package.name}: {text}\n" for text in unclaimed(distinct(assessment.hardware))]
    if assessment.placement is not None and assessment.placement.value is not Placement.ANY:
        lines.append(f"# {package.name}: runs best on: {assessment.placement.value.value}\n")
    return lines


def _dump(value: Any) -> str:
    return yaml.safe_dump(value, sort_keys=False, allow_unicode=True, width=120)
