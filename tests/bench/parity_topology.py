"""Shapes that make pods depend on each other, for the comparison with kube-scheduler: a pure function of the seed."""

from collections.abc import Callable, Mapping
from random import Random
from typing import Any

Json = dict[str, Any]
HOSTNAME = "kubernetes.io/hostname"
ZONE = "topology.kubernetes.io/zone"
KEYS = (ZONE, ZONE, HOSTNAME, "rack")
APPS = ("web", "db")
ARENA = "arena"
OTHER = "other"
NAMESPACES: Mapping[str, Mapping[str, str]] = {ARENA: {"team": "a"}, OTHER: {"team": "b"}}
IMAGES = ("example.com/large:1", "example.com/small:1", "example.com/common")
SIZES = {"example.com/large:1": 900 << 20, "example.com/small:1": 30 << 20, "example.com/common:latest": 400 << 20}
ENDING = "parity/ending"
"""Annotation of placed pods that are deleted with a long grace period, so that they stay while they terminate."""


def place(random: Random, node: Json) -> None:
    """Give a node topology labels and images."""
    labels = node["metadata"]["labels"]
    if random.random() < 0.8:
        labels[ZONE] = random.choice(("z1", "z2", "z3"))
    if random.random() < 0.6:
        labels["rack"] = random.choice(("r1", "r2"))
    if random.random() < 0.1:
        del labels[HOSTNAME]
    names = random.sample(sorted(SIZES), random.randint(0, 3))
    if names:
        node["status"]["images"] = [{"names": [name], "sizeBytes": SIZES[name]} for name in names]


def company(random: Random, name: str, node: str) -> Json:
    """A small placed pod with labels and perhaps affinity terms, in one of the namespaces."""
    spec: Json = {
        "nodeName": node,
        "containers": [{"name": "main", "image": IMAGES[1]}],
        "terminationGracePeriodSeconds": 0,
    }
    if random.random() < 0.4:
        affinity(random, spec, rate=0.4)
    meta: Json = {"name": name, "namespace": random.choice((ARENA, ARENA, ARENA, OTHER)), "labels": labels(random)}
    if random.random() < 0.15:
        meta["annotations"] = {ENDING: "true"}
    return {"metadata": meta, "spec": spec}


def services(random: Random) -> tuple[Json, ...]:
    """Services and ReplicaSets that stand for the default spread of their pods."""
    found: list[Json] = []
    if random.random() < 0.5:
        selector = random.choice(({"app": "web"}, {"tier": "a"}))
        spec = {"clusterIP": "None", "selector": selector}
        found.append({"kind": "Service", "metadata": {"name": "service", "namespace": ARENA}, "spec": spec})
    if random.random() < 0.5:
        template = {"metadata": {"labels": {"app": "db"}}, "spec": {"containers": [{"name": "m", "image": IMAGES[0]}]}}
        spec = {"replicas": 0, "selector": {"matchLabels": {"app": "db"}}, "template": template}
        found.append({"kind": "ReplicaSet", "metadata": {"name": "owner", "namespace": ARENA}, "spec": spec})
    return tuple(found)


def labels(random: Random) -> Json:
    """What selectors look for."""
    found: Json = {}
    if random.random() < 0.8:
        found["app"] = random.choice(APPS)
    if random.random() < 0.4:
        found["tier"] = random.choice(("a", "b"))
    return found


def owner() -> Json:
    """A controller reference to the ReplicaSet of `services`; nobody asks for its uid."""
    uid = "00000000-0000-0000-0000-000000000001"
    return {"apiVersion": "apps/v1", "kind": "ReplicaSet", "name": "owner", "uid": uid, "controller": True}


def selector(random: Random) -> Json | None:
    """A label selector of some kind."""
    return random.choice(
        (
            {"matchLabels": {"app": "web"}},
            {"matchLabels": {"app": "db"}},
            {"matchLabels": {"app": "web"}},
            {"matchExpressions": [{"key": "app", "operator": "In", "values": ["web", "db"]}]},
            {"matchExpressions": [{"key": "tier", "operator": "DoesNotExist"}]},
            {"matchExpressions": [{"key": "tier", "operator": "NotIn", "values": ["a"]}]},
            {},
            None,
        )
    )


def spread(random: Random, spec: Json) -> None:
    """One or two spread constraints."""
    found: dict[tuple[str, str], Json] = {}
    for _ in range(random.randint(1, 2)):
        when = random.choice(("DoNotSchedule", "DoNotSchedule", "ScheduleAnyway"))
        constraint: Json = {
            "topologyKey": random.choice(KEYS), "whenUnsatisfiable": when, "maxSkew": random.choice((1, 1, 2, 3)),
        }  # fmt: skip
        chosen = selector(random)
        if chosen is not None:
            constraint["labelSelector"] = chosen
            if random.random() < 0.25:
                constraint["matchLabelKeys"] = ["tier"]
        if when == "DoNotSchedule" and random.random() < 0.4:
            constraint["minDomains"] = random.randint(1, 4)
        if random.random() < 0.3:
            constraint["nodeAffinityPolicy"] = random.choice(("Honor", "Ignore"))
        if random.random() < 0.4:
            constraint["nodeTaintsPolicy"] = random.choice(("Honor", "Honor", "Ignore"))
        found[constraint["topologyKey"], when] = constraint
    spec["topologySpreadConstraints"] = list(found.values())


def term(random: Random) -> Json:
    """One affinity term."""
    found: Json = {"topologyKey": random.choice(KEYS)}
    chosen = selector(random)
    if chosen is not None:
        found["labelSelector"] = chosen
        if random.random() < 0.2 and "tier" not in str(chosen):
            found[random.choice(("matchLabelKeys", "mismatchLabelKeys"))] = ["tier"]
    if random.random() < 0.2:
        found["namespaces"] = random.sample((ARENA, OTHER), random.randint(1, 2))
    if random.random() < 0.2:
        found["namespaceSelector"] = random.choice(
            ({}, {"matchLabels": {"team": "b"}}, {"matchExpressions": [{"key": "team", "operator": "Exists"}]})
        )
    return found


def affinity(random: Random, spec: Json, *, rate: float) -> None:
    """Required and preferred terms on both sides, each with a probability of `rate`."""
    for side in ("podAffinity", "podAntiAffinity"):
        if random.random() < rate:
            _side(spec, side)["requiredDuringSchedulingIgnoredDuringExecution"] = [
                term(random) for _ in range(random.choice((1, 1, 2)))
            ]
        if random.random() < rate:
            _side(spec, side)["preferredDuringSchedulingIgnoredDuringExecution"] = [
                {"weight": random.randint(1, 100), "podAffinityTerm": term(random)} for _ in range(random.randint(1, 2))
            ]


def _side(spec: Json, side: str) -> Json:
    found: Json = spec.setdefault("affinity", {}).setdefault(side, {})
    return found


def _required(side: str) -> Callable[[Random, Json], None]:
    def family(random: Random, spec: Json) -> None:
        terms = [term(random) for _ in range(random.choice((1, 1, 2)))]
        _side(spec, side)["requiredDuringSchedulingIgnoredDuringExecution"] = terms

    return family


def _preferred(side: str) -> Callable[[Random, Json], None]:
    def family(random: Random, spec: Json) -> None:
        terms = [
            {"weight": random.randint(1, 100), "podAffinityTerm": term(random)} for _ in range(random.randint(1, 2))
        ]
        _side(spec, side)["preferredDuringSchedulingIgnoredDuringExecution"] = terms

    return family


def _images(random: Random, spec: Json) -> None:
    spec["containers"][0]["image"] = random.choice(IMAGES)
    if random.random() < 0.5:
        spec["containers"].append({"name": "more", "image": random.choice(IMAGES)})
    if random.random() < 0.3:
        spec["initContainers"] = [{"name": "first", "image": random.choice(IMAGES)}]


FAMILIES: Mapping[str, Callable[[Random, Json], None]] = {
    "images": _images,
    "pod-affinity": _required("podAffinity"),
    "pod-anti-affinity": _required("podAntiAffinity"),
    "preferred-pod-affinity": _preferred("podAffinity"),
    "preferred-pod-anti-affinity": _preferred("podAntiAffinity"),
    "spread": spread,
}
