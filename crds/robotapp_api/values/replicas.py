"""Replicas with ordinals (replicaIdentity: Ordinal): each is a component of its own, named after its component, such as `detector-0`.

So every rule about components holds for a replica as it stands: one Deployment, one pod at a time, its own claims, state and edges.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol, TypeVar

import msgspec

ORDINAL: Final = "Ordinal"
"""Value of `replicaIdentity`."""
MOST_COMPONENTS: Final = 64
MOST_EDGES: Final = 256
"""What an app may have, each replica with an ordinal counted as a component."""
_LISTS: Final = ("colocateWith", "separateFrom")

Json = Mapping[str, Any]


class _Identified(Protocol):
    @property
    def replica_identity(self) -> str: ...


class _Parts(Protocol):
    @property
    def components(self) -> Sequence[_Identified]: ...


Spec = TypeVar("Spec", bound=_Parts)


class NumberedReplica(NamedTuple):
    """One replica of a component with ordinals."""

    component: str
    """The component's name in the spec."""
    ordinal: int

    @property
    def name(self) -> str:
        """The replica's name as a component."""
        return f"{self.component}-{self.ordinal}"


Replicas = Mapping[str, Sequence[NumberedReplica]]
"""By the name of each component with ordinals, its replicas in the order of their ordinals."""


def list_replicas(components: Iterable[Json]) -> Replicas:
    """Returns the replicas of the components that have ordinals. One with `replicas: 0` keeps the first, which has no pod."""
    return {
        component["name"]: number_replicas(component["name"], count_replicas(component))
        for component in components
        if component.get("replicaIdentity") == ORDINAL
    }


def find_replicas(components: Iterable[Json]) -> dict[str, NumberedReplica]:
    """Returns the replicas that have ordinals by their names as components."""
    return {replica.name: replica for group in list_replicas(components).values() for replica in group}


def number_replicas(component: str, count: int) -> tuple[NumberedReplica, ...]:
    """Returns so many replicas of a component, one if there are to be none, and one more than an app may have if there are to be more."""
    return tuple(NumberedReplica(component, ordinal) for ordinal in range(min(max(1, count), MOST_COMPONENTS + 1)))


def count_replicas(component: Json) -> int:
    """Returns how many pods the component is to have, the schema's default if it does not say."""
    count = component.get("replicas", 1)
    return count if isinstance(count, int) else 1


def names_of(component: str, replicas: Replicas) -> tuple[str, ...]:
    """Returns the names under which the component runs: those of its replicas, or its own."""
    return tuple(replica.name for replica in replicas[component]) if component in replicas else (component,)


def is_replica_name(name: str, component: str) -> bool:
    """Decides whether the name is, or with more replicas would be, that of a replica of the component."""
    return re.fullmatch(rf"{re.escape(component)}-(0|[1-9]\d*)", name) is not None


def expand_replicas(spec: Json) -> Json:
    """Returns the JSON of a RobotApp's spec with each replica that has an ordinal as a component of its own; without any the spec itself.

    A spec that becomes too large is refused by its checks, and stays as it is.
    """
    replicas = list_replicas(spec.get("components") or ())
    if not replicas or count_components(spec, replicas) > MOST_COMPONENTS or count_edges(spec, replicas) > MOST_EDGES:
        return spec
    changes: dict[str, Any] = {
        "components": [copy for component in spec["components"] for copy in _expand_component(component, replicas)]
    }
    if spec.get("edges"):
        changes["edges"] = [copy for edge in spec["edges"] for copy in _expand_edge(edge, replicas)]
    if spec.get("overrides"):
        changes["overrides"] = [_expand_override(override, replicas) for override in spec["overrides"]]
    if (completion := spec.get("completion")) and (success := completion.get("success") or {}).get("components"):
        names = _expand_names(success["components"], replicas)
        changes["completion"] = {**completion, "success": {**success, "components": names}}
    return {**spec, **changes}


def expand_struct(spec: Spec) -> Spec:
    """Returns the same of a struct that holds a part of a spec."""
    if all(component.replica_identity != ORDINAL for component in spec.components):
        return spec
    return msgspec.convert(expand_replicas(msgspec.to_builtins(spec)), type(spec))


def count_components(spec: Json, replicas: Replicas) -> int:
    """Returns how many components there are with each replica as one."""
    return sum(len(names_of(component["name"], replicas)) for component in spec["components"])


def count_edges(spec: Json, replicas: Replicas) -> int:
    """Returns how many edges there are with each replica at an end of its own."""
    edges = spec.get("edges") or ()
    return sum(len(names_of(edge["from"], replicas)) * len(names_of(edge["to"], replicas)) for edge in edges)


def _expand_component(component: Json, replicas: Replicas) -> Iterator[Json]:
    copy = _expand_references(component, replicas)
    if component["name"] not in replicas:
        yield copy
        return
    # A Service is for all replicas; whoever renders it reads it in the spec as it is written.
    one = {key: value for key, value in copy.items() if key not in ("replicaIdentity", "service")}
    for replica in replicas[component["name"]]:
        yield {**one, "name": replica.name, "replicas": min(1, count_replicas(component))}


def _expand_references(component: Json, replicas: Replicas) -> dict[str, Any]:
    """Returns the component with the names of replicas wherever it names a component that has ordinals."""
    copy = dict(component)
    for field in _LISTS:
        if component.get(field):
            copy[field] = _expand_names(component[field], replicas)
    if (shared := component.get("sharedData")) and shared.get("with"):
        copy["sharedData"] = {**shared, "with": _expand_names(shared["with"], replicas)}
    if component.get("dependsOn"):
        copy["dependsOn"] = [
            {**dependency, "component": name}
            for dependency in component["dependsOn"]
            for name in names_of(dependency["component"], replicas)
        ]
    return copy


def _expand_names(names: Iterable[str], replicas: Replicas) -> list[str]:
    return [replica for name in names for replica in names_of(name, replicas)]


def _expand_edge(edge: Json, replicas: Replicas) -> Iterator[Json]:
    for source in names_of(edge["from"], replicas):
        for target in names_of(edge["to"], replicas):
            yield {**edge, "from": source, "to": target}


def _expand_override(override: Json, replicas: Replicas) -> Json:
    parts = ({**part, "name": name} for part in override["components"] for name in names_of(part["name"], replicas))
    return {**override, "components": list(parts)}
