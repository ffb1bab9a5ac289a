"""What may be written about resources in the arguments of NodeResourcesFit and NodeResourcesBalancedAllocation."""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Protocol

MOST_WEIGHT: Final = 100
QUALIFIED: Final = re.compile(r"([a-z0-9]([-a-z0-9.]{0,251}[a-z0-9])?/)?[A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?")


class Weighed(Protocol):
    """A resource and how much it counts."""

    @property
    def name(self) -> str: ...
    @property
    def weight(self) -> int: ...


def refuse(problems: Iterable[str]) -> None:
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
