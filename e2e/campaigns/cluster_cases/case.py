"""A case: what to create, what comes back, and how it was drawn."""

import json
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st

from campaigns.cluster_cases.catalogue import ALL_FAMILIES, clash
from campaigns.cluster_cases.choices import Choices, DrawnChoices, SeededChoices
from campaigns.cluster_cases.scene import Scene, draw_scene
from campaigns.reference_scheduler import ClusterDump

Json = dict[str, Any]

_REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
_PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"


def admitted(pod: Json) -> Json:
    """Label keys become requirements of the selectors; with host networking container ports are host ports.

    Pod-level requests get what the containers ask for where they say nothing themselves.
    """
    made = deepcopy(pod)
    labels = made["metadata"].get("labels") or {}
    for term in _terms(made):
        _merge(term, labels)
    if made["spec"].get("hostNetwork"):
        for container in made["spec"]["containers"]:
            for port in container.get("ports") or []:
                port.setdefault("hostPort", port["containerPort"])
    _complete_pod_level(made)
    return made


def _terms(pod: Json) -> Iterator[Json]:
    """Everything with label keys: spread constraints and terms of pod affinity."""
    yield from pod["spec"].get("topologySpreadConstraints") or []
    affinity = pod["spec"].get("affinity") or {}
    for kind in ("podAffinity", "podAntiAffinity"):
        part = affinity.get(kind) or {}
        yield from part.get(_REQUIRED) or []
        for weighted in part.get(_PREFERRED) or []:
            yield weighted["podAffinityTerm"]


def _merge(term: Json, labels: Json) -> None:
    for field, operator in (("matchLabelKeys", "In"), ("mismatchLabelKeys", "NotIn")):
        for key in term.get(field) or []:
            if key in labels and term.get("labelSelector") is not None:
                requirement = {"key": key, "operator": operator, "values": [labels[key]]}
                term["labelSelector"].setdefault("matchExpressions", []).append(requirement)


def _complete_pod_level(pod: Json) -> None:
    level = (pod["spec"].get("resources") or {}).get("requests")
    containers = pod["spec"]["containers"]
    if not level or len(containers) != 1:
        return
    for name, amount in ((containers[0].get("resources") or {}).get("requests") or {}).items():
        if name in {"cpu", "memory"} or name.startswith("hugepages-"):
            level.setdefault(name, amount)


MORE = 2
"""Families mixed in beside the first."""


@dataclass(frozen=True)
class Case:
    """families: the first is at the centre."""

    families: tuple[str, ...]
    objects: tuple[Json, ...]

    @property
    def pod(self) -> Json:
        """The pod to place, as the API server gives it back."""
        return admitted(self.objects[-1])

    @property
    def cluster(self) -> ClusterDump:
        """All other objects, as the API server gives them back."""
        return ClusterDump.of(admitted(each) if each["kind"] == "Pod" else each for each in self.objects[:-1])

    def __repr__(self) -> str:
        return f"Case({'+'.join(self.families)}):\n{json.dumps(self.objects, indent=1)}"


def build_case(
    choices: Choices, families: Sequence[str], *, first: str = "", nodes: int = 12, placed: int = 30
) -> Case:
    """With `first` at the centre, else any of `families`."""
    chosen = [first or choices.pick(families)]
    for _ in range(choices.pick((0, 1, MORE))):
        one = choices.pick(families)
        if one not in chosen and not any(clash(one, other) for other in chosen):
            chosen.append(one)
    scene = draw_scene(choices, nodes=nodes, placed=placed)
    for name in sorted(chosen, key=list(ALL_FAMILIES).index):
        ALL_FAMILIES[name].apply(choices, scene)
    return Case(tuple(chosen), _objects(scene))


def _objects(scene: Scene) -> tuple[Json, ...]:
    return (*scene.objects, *scene.nodes, *scene.placed, scene.pod)


def seeded_case(seed: str, *, number: int, families: Sequence[str], nodes: int = 12, placed: int = 30) -> Case:
    """Number `number` of a run: the families take turns at the centre."""
    first = families[number % len(families)]
    return build_case(SeededChoices(f"{seed}/{number}/{first}"), families, first=first, nodes=nodes, placed=placed)


@st.composite
def cases(draw: st.DrawFn, families: Sequence[str], *, nodes: int = 6, placed: int = 8) -> Case:
    """For hypothesis: smaller than seeded ones, so that many can be drawn and shrunk."""
    return build_case(DrawnChoices(draw), families, nodes=nodes, placed=placed)
