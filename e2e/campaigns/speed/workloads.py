"""The rows of the speed bench: what the pods ask for, what stands in the cluster before them, what must hold.

Sizes are those of kube-scheduler's own benchmarks. Labels: `bench/role` says what a pod is for (placed, seed, filler,
waiting, measured, churn); `color` and `group` are what the pods' own selectors look at.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robotapp_api.model.names import Label

Json = dict[str, Any]
PAUSE = "registry.k8s.io/pause:3.10"
HOSTNAME = "kubernetes.io/hostname"
ZONES = 10
APPS = 200
ROLE = "bench/role"
SCHEDULER = "bench/scheduler"
"""The label that repeats schedulerName, for watches."""
LOW, HIGH = "bench-low", "bench-high"
PRIORITIES = {LOW: -10, HIGH: 1000}
SEEDS = 500


@dataclass(frozen=True, slots=True)
class Targets:
    """`rate` times kube-scheduler's pods/s; its CPU per pod divided by `cpu`; ms of p99 above the bare client. 0: none."""

    rate: float
    cpu: float = 0.0
    p99_above_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class Workload:
    """One row. `slow_pods`: how many kube-scheduler gets when it is an order of magnitude slower.

    `pod` is merged into the plain pod. `waiting`: that many pods of this shape that cannot be placed wait meanwhile.
    `seeds`: pods of the load's group stand in zone-0 only. `fillers`: low-priority pods on each node. `victims`: how
    many of them each pod takes the place of. `devices`: how many each node has; then each pod names a claim of one of its own.
    """

    name: str
    text: str
    pod: Json
    targets: Targets
    pods: int = 2000
    slow_pods: int = 3000
    service: bool = False
    waiting: int = 0
    waiting_pod: Json | None = None
    seeds: int = 0
    fillers: int = 0
    victims: int = 0
    devices: int = 0
    churn: bool = False
    latency: bool = True


def node(index: int) -> Json:
    """32 CPUs, 256 GiB, 110 pods; ten zones in turn."""
    capacity = {"cpu": "32", "memory": "256Gi", "pods": "110", "ephemeral-storage": "500Gi"}
    name = node_name(index)
    labels = {HOSTNAME: name, str(Label.ZONE): f"zone-{index % ZONES}", "bench/kind": "blue" if index % 2 else "green"}
    ready = {"type": "Ready", "status": "True", "reason": "KubeletReady"}
    return {
        "metadata": {"name": name, "labels": labels},
        "status": {"capacity": capacity, "allocatable": capacity, "conditions": [ready]},
    }


def node_name(index: int) -> str:
    return f"node-{index:05}"


def pod(name: str, role: str, scheduler: str, shape: Json | None = None) -> Json:
    """A small pod with `shape` (labels, cpu and fields of its spec) on top."""
    shape = dict(shape or {})
    requests = {"cpu": shape.pop("cpu", "100m"), "memory": "100Mi"}
    labels = {"app": "bench", **shape.pop("labels", {}), ROLE: role, SCHEDULER: scheduler}
    container = {"name": "main", "image": PAUSE, "resources": {"requests": requests}}
    basis = {"schedulerName": scheduler, "terminationGracePeriodSeconds": 0, "containers": [container]}
    return {"metadata": {"name": name, "labels": labels}, "spec": basis | shape}


def placed(index: int, nodes: int) -> Json:
    """One of the pods that run already: 200 apps, a third of them green, over all nodes."""
    labels = {"app": f"app-{index % APPS}", **({"color": "green"} if index % 3 == 0 else {})}
    return pod(f"placed-{index:06}", "placed", "nobody", {"labels": labels, "nodeName": node_name(index * 7 % nodes)})


def filler(node_index: int, number: int) -> Json:
    """One of four pods of low priority that leave too little of their node to the next one."""
    name = node_name(node_index)
    shape = {"cpu": "7", "priorityClassName": LOW, "nodeName": name}
    return pod(filler_name(name, number), "filler", "nobody", shape)


def filler_name(node: str, number: int) -> str:
    return f"filler-{node}-{number}"


def seed(index: int, nodes: int) -> Json:
    """A pod of the load's group in zone-0."""
    in_zone = max(1, nodes // ZONES)
    shape = {"labels": {"group": "load"}, "nodeName": node_name(index % in_zone * ZONES)}
    return pod(f"seed-{index:05}", "seed", "nobody", shape)


DRIVER, DEVICE_CLASS = "bench.example.com", "bench"
DEVICE_CLASS_OBJECT: Json = {
    "metadata": {"name": DEVICE_CLASS},
    "spec": {"selectors": [{"cel": {"expression": f'device.driver == "{DRIVER}"'}}]},
}


def resource_slice(node_index: int, devices: int) -> Json:
    """The devices of a node, of two models in turn."""
    name = node_name(node_index)
    offered = [
        {"name": f"device-{number}", "attributes": {"model": {"string": "ab"[number % 2]}}} for number in range(devices)
    ]
    pool = {"name": name, "generation": 1, "resourceSliceCount": 1}
    spec = {"driver": DRIVER, "nodeName": name, "pool": pool, "devices": offered}
    return {"metadata": {"name": name}, "spec": spec}


def device_claim(name: str) -> Json:
    """A claim of one device of either model, by a selector that looks at an attribute."""
    expression = f'device.attributes["{DRIVER}"].model in ["a", "b"]'
    exactly = {"deviceClassName": DEVICE_CLASS, "selectors": [{"cel": {"expression": expression}}]}
    spec = {"devices": {"requests": [{"name": "device", "exactly": exactly}]}}
    return {"metadata": {"name": name, "labels": {ROLE: "measured"}}, "spec": spec}


def _term(color: str, key: str) -> Json:
    return {"topologyKey": key, "labelSelector": {"matchLabels": {"color": color}}}


def _spread(key: str, labels: Json, **more: Any) -> list[Json]:
    rule = {"topologyKey": key, "labelSelector": {"matchLabels": labels}, "whenUnsatisfiable": "DoNotSchedule"}
    return [rule | more]


def _zones(*zones: str) -> Json:
    return {"matchExpressions": [{"key": str(Label.ZONE), "operator": "In", "values": list(zones)}]}


_REQUIRED, _PREFERRED = (f"{word}DuringSchedulingIgnoredDuringExecution" for word in ("required", "preferred"))
GREEN, BLUE = {"color": "green"}, {"color": "blue"}
ANTI_AFFINITY: Json = {
    "labels": BLUE,
    "affinity": {"podAntiAffinity": {_REQUIRED: [_term("blue", HOSTNAME)]}},
}
ZONE_AFFINITY: Json = {
    "labels": GREEN,
    "affinity": {
        "podAffinity": {_PREFERRED: [{"weight": 10, "podAffinityTerm": _term("green", str(Label.ZONE))}]},
    },
}
ZONE_SPREAD: Json = {"labels": GREEN, "topologySpreadConstraints": _spread(str(Label.ZONE), GREEN, maxSkew=5)}
NODE_AFFINITY: Json = {
    "affinity": {
        "nodeAffinity": {
            _REQUIRED: {"nodeSelectorTerms": [_zones("zone-1", "zone-2", "zone-3")]},
            _PREFERRED: [{"weight": 5, "preference": _zones("zone-2")}],
        }
    }
}
WAITING_SPREAD: Json = {
    "labels": {"group": "waiting"},
    "nodeSelector": {str(Label.ZONE): "zone-0"},
    "topologySpreadConstraints": _spread(str(Label.ZONE), {"group": "load"}, maxSkew=1, nodeAffinityPolicy="Ignore"),
}
"""Zone-0 has the seeds: it is too full by hundreds as long as the others have none. Each pod of the load that is bound
matches the selector, so it may wake them all."""
WAITING_LARGE: Json = {"labels": {"group": "waiting"}, "cpu": "64"}


def _of_group(shape: Json) -> Json:
    return shape | {"labels": {**shape["labels"], "group": "load"}}


_ROWS = (
    Workload("basic", "pods that ask for CPU and memory", {}, Targets(2.5, 10, 10)),
    Workload("anti-affinity", "required anti-affinity on hostname", ANTI_AFFINITY, Targets(12, 50)),
    Workload("zone-affinity", "preferred pod affinity by zone", ZONE_AFFINITY, Targets(12, 50)),
    Workload("zone-spread", "zone spread, DoNotSchedule", ZONE_SPREAD, Targets(12, 50)),
    Workload("default-spread", "a Service over the pods, system default spreading", {"labels": GREEN}, Targets(8),
             service=True),
    Workload("node-affinity", "required and preferred node affinity by zone", NODE_AFFINITY, Targets(2)),
    Workload("preemption", "all nodes full of low-priority pods: each pod takes the place of three",
             {"cpu": "22", "priorityClassName": HIGH}, Targets(2), pods=500, fillers=4, victims=3, latency=False),
    Workload("churn", "basic pods while a node, a Service, an impossible pod and running pods come and go", {}, Targets(2),
             churn=True),
    Workload("anti-affinity-waiting", "required anti-affinity while 2000 unschedulable spread pods wait",
             _of_group(ANTI_AFFINITY), Targets(30), slow_pods=400, waiting=2000, waiting_pod=WAITING_SPREAD, seeds=SEEDS),
    Workload("zone-affinity-waiting", "preferred zone affinity while 2000 unschedulable spread pods wait",
             _of_group(ZONE_AFFINITY), Targets(30), slow_pods=400, waiting=2000, waiting_pod=WAITING_SPREAD, seeds=SEEDS),
    Workload("unschedulable-waiting", "basic pods while 5000 pods that fit nowhere wait", {}, Targets(2), pods=3000,
             waiting=5000, waiting_pod=WAITING_LARGE),
    Workload("devices", "each pod names a ResourceClaim of one device of its own; eight devices on each node", {},
             Targets(3, 5), pods=500, devices=8, latency=False),
)  # fmt: skip
WORKLOADS: Mapping[str, Workload] = {each.name: each for each in _ROWS}
