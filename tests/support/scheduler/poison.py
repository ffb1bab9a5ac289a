"""Objects that nobody should send: huge, deep, absurd or self-contradicting, each with a name.

`live` ones are accepted by the API server (1.37.1); the others it refuses, or sits over for longer than a client waits
(thousands of affinity terms), so they reach a scheduler only through another server, a fake one, or in a cluster dump.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from robotapp_api.model.names import SCHEDULER_NAME, Annotation

Json = dict[str, Any]
MANY: Final = 10_000
"""Entries of a list that has no place for so many."""
ZONE: Final = "topology.kubernetes.io/zone"
HOST: Final = "kubernetes.io/hostname"


@dataclass(frozen=True, slots=True)
class Poison:
    """One bad object: its name, its body, and whether a live API server takes it."""

    name: str
    body: Json
    live: bool = True


def pod_body(
    name: str, *, requests: Mapping[str, str] | None = None, metadata: Json | None = None, **spec: Any
) -> Json:
    """A pod of ours that asks for little."""
    container = {
        "name": "main",
        "image": "registry.invalid/main:1",
        "resources": {"requests": {"cpu": "1m"} if requests is None else dict(requests)},
    }
    return {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": name, "namespace": "default", **(metadata or {})},
        "spec": {
            "schedulerName": SCHEDULER_NAME,
            "terminationGracePeriodSeconds": 0,
            "containers": [container],
            **spec,
        },
    }


@cache
def poison_pods() -> tuple[Poison, ...]:
    """Pods, named by what is wrong with them."""
    kinds = (_constraints, _terms, _node_terms, _many, _numbers, _texts, _invalid)
    return tuple(poison for kind in kinds for poison in kind())


def _pod(name: str, *, live: bool = True, **given: Any) -> Poison:
    return Poison(name, pod_body(f"poison-{name}", **given), live)


def selector(number: int = 0) -> Json:
    return {"matchLabels": {"app": f"a-{number}"}}


def spread(key: str, *, hard: bool = True, number: int = 0, **fields: Any) -> Json:
    return {
        "maxSkew": 1,
        "topologyKey": key,
        "whenUnsatisfiable": "DoNotSchedule" if hard else "ScheduleAnyway",
        "labelSelector": selector(number),
        **fields,
    }


def _constraints() -> Iterator[Poison]:
    """The API server wants each (key, action) pair once; thousands of keys it takes."""
    yield _pod("spread-keys-hard", topologySpreadConstraints=[spread(f"k/{n}", number=n) for n in range(5000)])
    yield _pod("spread-keys-soft", topologySpreadConstraints=[spread(f"k/{n}", hard=False) for n in range(5000)])
    yield _pod("spread-same-key", live=False, topologySpreadConstraints=[spread(HOST, number=n) for n in range(MANY)])
    huge = spread(HOST, maxSkew=2**31 - 1, minDomains=2**31 - 1)
    yield _pod("spread-absurd-numbers", topologySpreadConstraints=[huge])
    keys = [f"label-{n}" for n in range(5000)]
    yield _pod(
        "spread-label-keys",
        metadata={"labels": {"label-1": "x"}},
        topologySpreadConstraints=[spread(HOST, matchLabelKeys=keys)],
    )
    yield _pod("spread-selector", topologySpreadConstraints=[spread(HOST, labelSelector=long_selector())])


def long_selector(count: int = 5000) -> Json:
    return {"matchExpressions": [{"key": f"k{n}", "operator": "NotIn", "values": ["a", "b"]} for n in range(count)]}


def _terms() -> Iterator[Poison]:
    def term(number: int, key: str = HOST) -> Json:
        return {"topologyKey": key, "labelSelector": selector(number)}

    def weighted(number: int, key: str = HOST) -> Json:
        return {"weight": 100, "podAffinityTerm": term(number, key)}

    def affinity(kind: str, when: str, terms: list[Json]) -> Json:
        return {kind: {f"{when}DuringSchedulingIgnoredDuringExecution": terms}}

    count = MANY
    for kind in ("podAffinity", "podAntiAffinity"):
        yield _pod(f"{kind}-required", live=False, affinity=affinity(kind, "required", [term(n) for n in range(count)]))
        yield _pod(
            f"{kind}-preferred", live=False, affinity=affinity(kind, "preferred", [weighted(n) for n in range(count)])
        )
        keys = [term(n, f"k/{n}") for n in range(5000)]
        yield _pod(f"{kind}-keys", live=False, affinity=affinity(kind, "required", keys))
    wide = [{**term(1), "namespaces": [f"ns-{n}" for n in range(MANY)]}]
    yield _pod("podAffinity-namespaces", live=False, affinity=affinity("podAffinity", "required", wide))
    chosen = [{**term(1), "namespaceSelector": long_selector()}]
    yield _pod("podAffinity-namespace-selector", live=False, affinity=affinity("podAffinity", "required", chosen))


def _node_terms() -> Iterator[Poison]:
    def node_affinity(when: str, terms: list[Json]) -> Json:
        return {"nodeAffinity": {f"{when}DuringSchedulingIgnoredDuringExecution": terms}}

    def expression(number: int, **fields: Any) -> Json:
        return {"key": f"k{number}", "operator": "In", "values": ["a", "b"], **fields}

    terms = [{"matchExpressions": [expression(n)]} for n in range(MANY)]
    yield _pod("node-terms", affinity=node_affinity("required", {"nodeSelectorTerms": terms}))  # type: ignore[arg-type]
    one = [{"matchExpressions": [expression(n, operator="NotIn") for n in range(MANY)]}]
    yield _pod("node-expressions", affinity=node_affinity("required", {"nodeSelectorTerms": one}))  # type: ignore[arg-type]
    values = [{"matchExpressions": [expression(1, values=[f"v{n}" for n in range(5 * MANY)])]}]
    yield _pod("node-values", affinity=node_affinity("required", {"nodeSelectorTerms": values}))  # type: ignore[arg-type]
    preferred = [{"weight": 1, "preference": {"matchExpressions": [expression(n)]}} for n in range(MANY)]
    yield _pod("node-preferred", affinity=node_affinity("preferred", preferred))
    more = [{"matchExpressions": [{"key": HOST, "operator": "Gt", "values": ["9" * 18]}]}] * 100
    yield _pod("node-gt", affinity=node_affinity("required", {"nodeSelectorTerms": more}))  # type: ignore[arg-type]
    fields = [{"matchFields": [{"key": "metadata.name", "operator": "In", "values": [f"n{n}"]}]} for n in range(MANY)]
    yield _pod("node-fields", affinity=node_affinity("required", {"nodeSelectorTerms": fields}))  # type: ignore[arg-type]
    yield _pod("node-selector", nodeSelector={f"k{n}": "v" for n in range(MANY)})


def _many() -> Iterator[Poison]:
    tolerations = [{"key": f"k{n}", "operator": "Equal", "value": "v", "effect": "NoSchedule"} for n in range(MANY)]
    yield _pod("tolerations", tolerations=tolerations)

    def container(number: int, **fields: Any) -> Json:
        return {
            "name": f"c{number}",
            "image": f"registry.invalid/i{number}:1",
            "resources": {"requests": {"cpu": "1m"}},
            **fields,
        }

    yield _pod("containers", containers=[container(n) for n in range(5000)])
    yield _pod("init-containers", initContainers=[container(n) for n in range(3000)])
    yield _pod("sidecars", initContainers=[container(n, restartPolicy="Always") for n in range(3000)])
    ports = [{"containerPort": n + 1, "hostPort": n + 1} for n in range(MANY)]
    yield _pod("host-ports", containers=[container(0, ports=ports)])
    ips = [{"containerPort": 1, "hostPort": 1 + n % 60_000, "hostIP": f"10.{n >> 8}.{n & 255}.1"} for n in range(MANY)]
    yield _pod("host-ips", containers=[container(0, ports=ips)])
    claims = [{"name": f"v{n}", "persistentVolumeClaim": {"claimName": f"c{n}"}} for n in range(5000)]
    yield _pod("claims", volumes=claims)
    ephemeral = {"spec": {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": "1Gi"}}}}
    scratch = [{"name": f"v{n}", "ephemeral": {"volumeClaimTemplate": ephemeral}} for n in range(3000)]
    yield _pod("ephemeral-volumes", volumes=scratch)
    disks = [{"name": f"v{n}", "iscsi": {"targetPortal": f"10.0.0.1:{n}", "iqn": f"iqn.2001-04.x:{n}", "lun": 0}}
             for n in range(4000)]  # fmt: skip
    yield _pod("disks", volumes=disks)
    yield _pod("resources", live=False, requests={f"x.example/r{n}": "1" for n in range(MANY)})
    gates = [{"name": f"g.example/{n}"} for n in range(MANY)]
    yield _pod("gates", schedulingGates=gates)
    labels = {f"l{n}": "v" for n in range(20_000)}
    yield _pod("labels", metadata={"labels": labels})
    owners = [{"apiVersion": "v1", "kind": "ConfigMap", "name": f"o{n}", "uid": f"u{n}"} for n in range(5000)]
    yield _pod("owners", metadata={"ownerReferences": owners})


def _numbers() -> Iterator[Poison]:
    yield _pod("nines", requests={"cpu": "9" * 15, "memory": "9" * 18})
    yield _pod("exa", live=False, requests={"cpu": "8E", "memory": "7E", "x.example/r": "9223372036854775807"})
    for text in ("1e400", "9" * 400, "1e999999999", "-1", "NaN", "", "1" + "0" * 5000 + "Ki", "0x10", "1 Gi"):
        taken = text in ("1e400", "9" * 400, "1" + "0" * 5000 + "Ki")
        yield _pod(f"quantity-{text[:12]}-{len(text)}", live=taken, requests={"cpu": text, "memory": text})
    yield _pod("nano", requests={"cpu": "1m", "memory": "1"})
    yield _pod("priority", live=False, priority=2**31 - 1)
    yield _pod("priority-beyond", live=False, priority=2**80)
    yield _pod("overhead", live=False, overhead={"cpu": "1e400"})


def _texts() -> Iterator[Poison]:
    yield _pod("annotation", metadata={"annotations": {"x.example/blob": "a" * 250_000}})
    env = [{"name": f"E{n}", "value": "x" * 100_000} for n in range(13)]
    container = {"name": "main", "image": "registry.invalid/main:1", "env": env}
    yield _pod("megabyte", containers=[container])
    command = {"name": "main", "image": "registry.invalid/main:1", "command": ['\\" \u2028é' * 40 for _ in range(2500)]}
    yield _pod("escapes", containers=[command])
    deep = "[" * 100_000
    for key in (Annotation.POLICIES, Annotation.TOPOLOGY, Annotation.AFFINITY, Annotation.SHARED_DATA):
        yield _pod(f"deep-{str(key).rpartition('/')[2]}", metadata={"annotations": {str(key): deep}})
        yield _pod(f"deep-object-{str(key).rpartition('/')[2]}", metadata={"annotations": {str(key): '{"a":' * 20_000}})
        wide = '{"hardware_requirements": [' + ",".join(['{"type": "can"}'] * 8000) + "]}"
        yield _pod(f"wide-{str(key).rpartition('/')[2]}", metadata={"annotations": {str(key): wide}})
        yield _pod(
            f"number-{str(key).rpartition('/')[2]}",
            metadata={"annotations": {str(key): '{"deadline": 1e400, "latency_budget": ' + "9" * 5000 + "}"}},
        )


def _invalid() -> Iterator[Poison]:
    bad_operator = {"matchExpressions": [{"key": "a", "operator": "Within", "values": ["b"]}]}
    no_values = {"matchExpressions": [{"key": "a", "operator": "In"}]}
    for name, wrong in (("operator", bad_operator), ("no-values", no_values), ("text", {"matchLabels": "everything"})):
        yield _pod(f"spread-{name}", live=False, topologySpreadConstraints=[spread(HOST, labelSelector=wrong)])
        term = {"topologyKey": HOST, "labelSelector": wrong}
        for kind in ("podAffinity", "podAntiAffinity"):
            terms = {"requiredDuringSchedulingIgnoredDuringExecution": [term]}
            yield _pod(f"{kind}-{name}", live=False, affinity={kind: terms})
    gt = [{"matchExpressions": [{"key": HOST, "operator": "Gt", "values": ["9" * 5000]}]}]
    terms = {"nodeAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": gt}}}
    yield _pod("gt-long", live=False, affinity=terms)
    yield _pod("no-containers", live=False, containers=[])
    yield _pod("port-beyond", live=False, containers=[{"name": "c", "ports": [{"hostPort": 2**70}]}])
    yield _pod("key-empty", live=False, topologySpreadConstraints=[spread("")])
    deep: Json = {}
    for _ in range(500):
        deep = {"matchLabels": deep}
    yield _pod("selector-deep", live=False, topologySpreadConstraints=[spread(HOST, labelSelector=deep)])
