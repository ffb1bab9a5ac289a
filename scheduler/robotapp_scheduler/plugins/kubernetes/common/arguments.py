"""What plugins' arguments may hold: resources of NodeResourcesFit and NodeResourcesBalancedAllocation, and `compatVersion`.

That is the kube-scheduler release whose decisions a plugin gives: a few formulas changed between 1.35 and 1.37.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Protocol

OLD: Final = "1.35"
NEW: Final = "1.37"


def is_new(compat_version: str) -> bool:
    """True for 1.37. Raises ValueError for a release whose rules are not built in."""
    if compat_version not in {OLD, NEW}:
        raise ValueError(f"compatVersion: {compat_version!r} is unknown; allowed: {OLD}, {NEW}")
    return compat_version == NEW


MOST_WEIGHT: Final = 100
QUALIFIED: Final = re.compile(r"([a-z0-9]([-a-z0-9.]{0,251}[a-z0-9])?/)?[A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?")


class Weighed(Protocol):
    """A resource and how much it counts."""

    @property
    def name(self) -> str: ...
    @property
    def weight(self) -> int: ...


def raise_problems(problems: Iterable[str]) -> None:
    """Raises ValueError with all of them, if there are any."""
    found = list(problems)
    if found:
        raise ValueError("; ".join(found))


def fit_problems(resources: Sequence[Weighed], ignored: Sequence[str], groups: Sequence[str]) -> Iterator[str]:
    """Of NodeResourcesFit; a weight of 0 stands for 1, as upstream defaults it."""
    for i, name in enumerate(ignored):
        if QUALIFIED.fullmatch(name) is None:
            yield f'ignoredResources[{i}]: Invalid value: "{name}": must be a resource name such as example.com/gpu'
    for i, group in enumerate(groups):
        if "/" in group:
            yield f"ignoredResourceGroups[{i}]: Invalid value: \"{group}\": resource group name can't contain '/'"
        elif QUALIFIED.fullmatch(group) is None:
            yield f'ignoredResourceGroups[{i}]: Invalid value: "{group}": must be a name such as example.com'
    for i, resource in enumerate(resources):
        if not 0 <= resource.weight <= MOST_WEIGHT:
            text = f"resource weight of {resource.name} not in valid range (0, 100]"
            yield f"scoringStrategy.resources[{i}].weight: Invalid value: {resource.weight}: {text}"


def balance_problems(resources: Sequence[Weighed]) -> Iterator[str]:
    """Of NodeResourcesBalancedAllocation: every resource counts the same, once."""
    seen: set[str] = set()
    for i, resource in enumerate(resources):
        if resource.name in seen:
            yield f'resources[{i}].name: Duplicate value: "{resource.name}"'
        seen.add(resource.name)
        if resource.weight not in (0, 1):
            yield f"resources[{i}].weight: Invalid value: {resource.weight}: must be 1"
