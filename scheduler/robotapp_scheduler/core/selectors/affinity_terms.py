"""Inter-pod affinity terms of a pod, compiled once per distinct affinity and namespace, and the namespaces that they may select."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Final, NamedTuple

import msgspec

from robotapp_api.values.selector import label_requirements, matches_requirements
from robotapp_scheduler.core.api.core_v1 import Affinity, Namespace, PodAffinity, PodAffinityTerm
from robotapp_scheduler.core.selectors.pod_matcher import PodMatcher, Requirements

NO_LABELS: Final[Mapping[str, str]] = {}


class Namespaces:
    """Labels of the known namespaces; `generation` grows when one comes, goes or changes labels."""

    __slots__ = ("_labels", "_matching", "generation")

    def __init__(self) -> None:
        self._labels: dict[str, Mapping[str, str]] = {}
        self._matching: dict[Requirements, frozenset[str]] = {}
        self.generation = 0

    def __repr__(self) -> str:
        return f"Namespaces({len(self._labels)})"

    def apply(self, namespace: Namespace) -> bool:
        """Take in a namespace; True when that changes anything."""
        labels = namespace.metadata.labels or NO_LABELS
        if self._labels.get(namespace.metadata.name) == labels:
            return False
        self._labels[namespace.metadata.name] = labels
        self._changed()
        return True

    def remove(self, name: str) -> bool:
        """Forget a namespace; True when it was known."""
        if self._labels.pop(name, None) is None:
            return False
        self._changed()
        return True

    def labels_of(self, name: str) -> Mapping[str, str]:
        """Labels of a namespace, none when it is not known."""
        return self._labels.get(name, NO_LABELS)

    def matching(self, requirements: Requirements) -> frozenset[str]:
        """Names of the known namespaces that meet these expressions."""
        found = self._matching.get(requirements)
        if found is None:
            names = (name for name, labels in self._labels.items() if matches_requirements(requirements, labels))
            found = self._matching[requirements] = frozenset(names)
        return found

    def _changed(self) -> None:
        self._matching.clear()
        self.generation += 1


MOST_COMPILED: Final = 8192


class Kind(StrEnum):
    """The effect of a placed pod's term on a pod that is to be placed."""

    KEEPS_AWAY = "required anti-affinity"
    ATTRACTS = "required affinity"
    WEIGHS = "preferred affinity or anti-affinity"


class Term(NamedTuple):
    """One term. `weight` is signed: negative for anti-affinity, and ±1 for required terms."""

    kind: Kind
    topology_key: str
    weight: int
    namespaces: frozenset[str]
    namespace_requirements: Requirements | None
    """Namespaces by label; None = none, () = all."""
    requirements: Requirements | None

    def concerns(self, namespace: str, labels: Mapping[str, str], namespace_labels: Mapping[str, str]) -> bool:
        """Whether the term of a placed pod matches this pod."""
        if self.requirements is None:
            return False
        if namespace not in self.namespaces:
            wanted = self.namespace_requirements
            if wanted is None or not matches_requirements(wanted, namespace_labels):
                return False
        return matches_requirements(self.requirements, labels)

    def may_concern(self, namespace: str, labels: Mapping[str, str]) -> bool:
        """Whether it matches this pod, provided that the pod's namespace has the labels it requires."""
        if self.requirements is None or (namespace not in self.namespaces and self.namespace_requirements is None):
            return False
        return matches_requirements(self.requirements, labels)

    def matcher(self, namespaces: Namespaces) -> PodMatcher:
        """A matcher for the placed pods that the term of a pod to be placed matches."""
        wanted = self.namespace_requirements
        if wanted is None:
            return PodMatcher(self.namespaces, self.requirements)
        if not wanted:
            return PodMatcher(None, self.requirements)
        return PodMatcher(self.namespaces | namespaces.matching(wanted), self.requirements)


class Terms(NamedTuple):
    """All terms of one pod. `broken` names a term whose selector cannot be evaluated."""

    affinity: tuple[Term, ...] = ()
    anti_affinity: tuple[Term, ...] = ()
    preferred: tuple[Term, ...] = ()
    broken: str = ""

    def __bool__(self) -> bool:
        return self is not NO_TERMS

    def want(self, namespace: str, labels: Mapping[str, str]) -> bool:
        """Whether there is required affinity, and all of its terms may match this pod."""
        return bool(self.affinity) and all(term.may_concern(namespace, labels) for term in self.affinity)


NO_TERMS: Final = Terms()


def affinity_key(affinity: Affinity | None) -> bytes:
    """The pod affinity and anti-affinity as a key, b"" without any."""
    if affinity is None or (affinity.pod_affinity is None and affinity.pod_anti_affinity is None):
        return b""
    return msgspec.json.encode((affinity.pod_affinity, affinity.pod_anti_affinity))


class Compiler:
    """Terms by namespace and affinity: 10,000 replicas share one object."""

    __slots__ = ("_known",)

    def __init__(self) -> None:
        self._known: dict[tuple[str, bytes], Terms] = {}

    def __repr__(self) -> str:
        return f"Compiler({len(self._known)} affinities)"

    def terms(self, namespace: str, key: bytes, affinity: Affinity | None) -> Terms:
        """The terms of a pod; `key` is its `affinity_key`."""
        if not key or affinity is None:
            return NO_TERMS
        found = self._known.get((namespace, key))
        if found is None:
            if len(self._known) >= MOST_COMPILED:
                self._known.clear()
            found = self._known[namespace, key] = compiled(namespace, affinity)
        return found


def compiled(namespace: str, affinity: Affinity) -> Terms:
    """The terms of a pod of this namespace."""
    nothing = PodAffinity()
    towards, away = affinity.pod_affinity or nothing, affinity.pod_anti_affinity or nothing
    broken: list[str] = []

    def term(raw: PodAffinityTerm, kind: Kind, weight: int, path: str) -> Term:
        if not (_readable(raw.label_selector) and _readable(raw.namespace_selector)):
            broken.append(path)
        plain = not raw.namespaces and raw.namespace_selector is None
        return Term(
            kind=kind,
            topology_key=raw.topology_key,
            weight=weight,
            namespaces=frozenset((namespace,) if plain else raw.namespaces),
            namespace_requirements=label_requirements(raw.namespace_selector),
            requirements=label_requirements(raw.label_selector),
        )

    def required(raw: Sequence[PodAffinityTerm], kind: Kind, weight: int, path: str) -> tuple[Term, ...]:
        return tuple(term(each, kind, weight, f"{path}.required[{i}]") for i, each in enumerate(raw))

    def preferred(raw: PodAffinity, sign: int, path: str) -> tuple[Term, ...]:
        return tuple(
            term(each.pod_affinity_term, Kind.WEIGHS, sign * each.weight, f"{path}.preferred[{i}]")
            for i, each in enumerate(raw.preferred)
        )

    return Terms(
        required(towards.required, Kind.ATTRACTS, 1, "podAffinity"),
        required(away.required, Kind.KEEPS_AWAY, 1, "podAntiAffinity"),
        (*preferred(towards, 1, "podAffinity"), *preferred(away, -1, "podAntiAffinity")),
        ", ".join(broken),
    )


def attracts_itself(namespace: str, labels: Mapping[str, str], affinity: Affinity | None) -> bool:
    """Whether all required affinity terms of a pod match the pod itself: then it may go anywhere while they match no other."""
    return affinity is not None and compiled(namespace, affinity).want(namespace, labels)


def _readable(selector: Mapping[str, object] | None) -> bool:
    return selector is None or label_requirements(selector) is not None
