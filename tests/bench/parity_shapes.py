"""Random small clusters and pods for the comparison with kube-scheduler: a pure function of the seed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any

from tests.bench import parity_profiles, parity_topology, parity_volumes

from robotapp_api.client.resources import Resource

Json = dict[str, Any]
IMAGE = "registry.k8s.io/pause:3.10"
GPU = "example.com/gpu"
ZONES = ("a", "b", "c")
DISKS = ("ssd", "hdd")
TAINT_KEYS = ("dedicated", "maintenance", "node.kubernetes.io/unschedulable")
EFFECTS = ("NoSchedule", "NoExecute", "PreferNoSchedule")
PORTS = (8080, 8081, 9090)


@dataclass(frozen=True, slots=True)
class Scene:
    """A cluster: nodes, and pods that already sit on them."""

    nodes: tuple[Json, ...]
    placed: tuple[Json, ...]
    owners: tuple[Json, ...] = ()
    """Services and ReplicaSets."""
    others: tuple[tuple[Resource, Json, str | None], ...] = ()
    """What else describes the nodes: (resource, object, namespace)."""


def scene(random: Random) -> Scene:
    """One to eight nodes n0, n1, …, up to six pods that take room and up to eight that pods look at."""
    nodes = tuple(_node(random, f"n{index}") for index in range(random.choice((1, 2, 3, 4, 5, 6, 7, 8, 8))))
    names = [node["metadata"]["name"] for node in nodes]
    placed = [_placed(random, f"p{index}", random.choice(names)) for index in range(random.randint(0, 6))]
    placed += [parity_topology.company(random, f"c{i}", random.choice(names)) for i in range(random.randint(0, 8))]
    return Scene(
        nodes, tuple(placed), parity_topology.services(random), tuple(parity_volumes.scene_objects(random, nodes))
    )


def pod(random: Random, name: str, scheduler: str) -> Json:
    """A pod with one to three of the families below; `random` in the same state gives the same shape."""
    spec: Json = {
        "schedulerName": scheduler,
        "terminationGracePeriodSeconds": 0,
        "containers": [{"name": "main", "image": IMAGE}],
    }
    for family in random.sample(sorted(FAMILIES), random.randint(1, 3)):
        FAMILIES[family](random, spec)
    storage = spec.pop(parity_volumes.KEY, None)
    meta: Json = {"name": name, "labels": parity_topology.labels(random)}
    if random.random() < 0.2:
        meta["ownerReferences"] = [parity_topology.owner()]
    shape: Json = {"metadata": meta, "spec": spec, "profile": parity_profiles.suffix(random)}
    return shape if storage is None else {**shape, parity_volumes.KEY: storage}


def _node(random: Random, name: str) -> Json:
    labels = {"kubernetes.io/hostname": name}
    if random.random() < 0.8:
        labels["zone"] = random.choice(ZONES)
    if random.random() < 0.6:
        labels["disk"] = random.choice(DISKS)
    if random.random() < 0.6:
        labels["rank"] = random.choice(("1", "5", "10", "x1"))
    spec: Json = {"taints": [_taint(random) for _ in range(random.choice((0, 0, 0, 0, 1, 2)))]}
    keys = {(taint["key"], taint["effect"]): taint for taint in spec["taints"]}
    spec["taints"] = list(keys.values())
    if random.random() < 0.1:
        spec["unschedulable"] = True
    capacity = {
        "cpu": random.choice(("500m", "1", "2", "4", "3950m")),
        "memory": random.choice(("512Mi", "1Gi", "2Gi", "4G", "3.5Gi")),
        "pods": random.choice(("0", "1", "2", "110", "110", "110")),
        "ephemeral-storage": random.choice(("1Gi", "10Gi")),
    }
    if random.random() < 0.4:
        capacity[GPU] = random.choice(("1", "2", "4"))
    status = {"capacity": capacity, "allocatable": capacity, "conditions": [{"type": "Ready", "status": "True"}]}
    node = {"metadata": {"name": name, "labels": labels}, "spec": spec, "status": status}
    parity_topology.place(random, node)
    return node


def _taint(random: Random) -> Json:
    taint: Json = {"key": random.choice(TAINT_KEYS), "effect": random.choice(EFFECTS)}
    if random.random() < 0.6:
        taint["value"] = random.choice(("x", "y"))
    return taint


def _placed(random: Random, name: str, node: str) -> Json:
    spec: Json = {
        "nodeName": node,
        "containers": [{"name": "main", "image": IMAGE}],
        "terminationGracePeriodSeconds": 0,
    }
    _small_requests(random, spec)
    if random.random() < 0.5:
        _host_ports(random, spec)
    found: Json = {"metadata": {"name": name}, "spec": spec}
    return {**found, "status": _resizing(random)} if random.random() < 0.3 else found


def _resizing(random: Random) -> Json:
    """What a kubelet says of a pod that is resized in place, or that it cannot be."""
    told: Json = {"name": "main", "image": IMAGE, "imageID": "", "ready": True, "restartCount": 0}
    if random.random() < 0.8:
        told["allocatedResources"] = _amounts(random, big=False)
    if random.random() < 0.8:
        told["resources"] = {"requests": _amounts(random, big=False)}
    status: Json = {"containerStatuses": [told]}
    if random.random() < 0.4:
        reason = random.choice(("Infeasible", "Deferred"))
        status["conditions"] = [{"type": "PodResizePending", "status": "True", "reason": reason}]
    return status


def _amounts(random: Random, *, big: bool) -> Json:
    found: Json = {}
    if random.random() < 0.8:
        found["cpu"] = random.choice(("0", "100m", "250m", "1", "1500m", *(("3", "8") if big else ())))
    if random.random() < 0.8:
        found["memory"] = random.choice(("0", "100Mi", "300M", "1Gi", "1.5Gi", *(("3Gi", "16Gi") if big else ())))
    if random.random() < 0.2:
        found["ephemeral-storage"] = random.choice(("100Mi", "2Gi", "20Gi"))
    return found


def _requests(random: Random, spec: Json) -> None:
    spec["containers"][0]["resources"] = {"requests": _amounts(random, big=True)}
    if random.random() < 0.3:
        spec["containers"].append(
            {"name": "side", "image": IMAGE, "resources": {"requests": _amounts(random, big=False)}}
        )


def _small_requests(random: Random, spec: Json) -> None:
    spec["containers"][0]["resources"] = {"requests": _amounts(random, big=False)}


def _init_containers(random: Random, spec: Json) -> None:
    spec["initContainers"] = [
        {
            "name": f"init-{index}",
            "image": IMAGE,
            "resources": {"requests": _amounts(random, big=True)},
            **({"restartPolicy": "Always"} if random.random() < 0.4 else {}),
        }
        for index in range(random.randint(1, 3))
    ]


def _extended(random: Random, spec: Json) -> None:
    amount = random.choice(("1", "2", "3", "5"))
    resources = spec["containers"][0].setdefault("resources", {})
    resources["requests"] = {**resources.get("requests", {}), GPU: amount}
    resources["limits"] = {GPU: amount}


def _pod_level(random: Random, spec: Json) -> None:
    spec["containers"][0]["resources"] = {"requests": {"cpu": "100m", "memory": "64Mi"}}
    spec["resources"] = {
        "requests": {"cpu": random.choice(("200m", "1", "3")), "memory": random.choice(("128Mi", "1Gi", "8Gi"))}
    }
    spec.pop("initContainers", None)
    del spec["containers"][1:]


def _node_selector(random: Random, spec: Json) -> None:
    spec["nodeSelector"] = random.choice(
        ({"zone": random.choice(ZONES)}, {"disk": "ssd"}, {"zone": "a", "disk": "hdd"}, {"zone": "nowhere"})
    )


def _expression(random: Random) -> Json:
    operator = random.choice(("In", "NotIn", "Exists", "DoesNotExist", "Gt", "Lt"))
    key = random.choice(("zone", "disk", "rank"))
    if operator in ("Gt", "Lt"):
        return {"key": "rank", "operator": operator, "values": [random.choice(("0", "3", "7"))]}
    if operator in ("Exists", "DoesNotExist"):
        return {"key": key, "operator": operator}
    return {"key": key, "operator": operator, "values": random.sample(("a", "b", "ssd", "1", "5"), 2)}


def _term(random: Random) -> Json:
    return {"matchExpressions": [_expression(random) for _ in range(random.randint(1, 2))]}


def _required_affinity(random: Random, spec: Json) -> None:
    terms = [_term(random) for _ in range(random.randint(1, 2))]
    _node_affinity(spec)["requiredDuringSchedulingIgnoredDuringExecution"] = {"nodeSelectorTerms": terms}


def _preferred_affinity(random: Random, spec: Json) -> None:
    terms = [{"weight": random.randint(1, 100), "preference": _term(random)} for _ in range(random.randint(1, 3))]
    _node_affinity(spec)["preferredDuringSchedulingIgnoredDuringExecution"] = terms


def _named_node(random: Random, spec: Json) -> None:
    """The way of DaemonSets: a required term on metadata.name."""
    name = random.choice(("n0", "n1", "n9"))
    term = {"matchFields": [{"key": "metadata.name", "operator": "In", "values": [name]}]}
    _node_affinity(spec)["requiredDuringSchedulingIgnoredDuringExecution"] = {"nodeSelectorTerms": [term]}


def _node_affinity(spec: Json) -> Json:
    affinity: Json = spec.setdefault("affinity", {}).setdefault("nodeAffinity", {})
    return affinity


def _tolerations(random: Random, spec: Json) -> None:
    spec["tolerations"] = [_toleration(random) for _ in range(random.randint(1, 3))]


def _toleration(random: Random) -> Json:
    if random.random() < 0.15:
        return {"operator": "Exists"}
    toleration: Json = {"key": random.choice(TAINT_KEYS)}
    if random.random() < 0.5:
        toleration["operator"] = "Exists"
    else:
        toleration["value"] = random.choice(("x", "y"))
    if random.random() < 0.7:
        toleration["effect"] = random.choice(EFFECTS)
    return toleration


def _host_ports(random: Random, spec: Json) -> None:
    chosen = random.sample(PORTS, random.randint(1, 2))
    spec["containers"][0]["ports"] = [
        {
            "containerPort": port,
            "hostPort": port,
            "protocol": random.choice(("TCP", "TCP", "UDP")),
            **random.choice(({}, {}, {"hostIP": "0.0.0.0"}, {"hostIP": "127.0.0.1"}, {"hostIP": "10.0.0.1"})),  # noqa: S104 - a case of the rule under test
        }
        for port in chosen
    ]


FAMILIES: Mapping[str, Callable[[Random, Json], None]] = {
    "extended": _extended,
    "host-ports": _host_ports,
    "init-containers": _init_containers,
    "named-node": _named_node,
    "node-selector": _node_selector,
    "pod-level": _pod_level,
    "preferred-affinity": _preferred_affinity,
    "requests": _requests,
    "required-affinity": _required_affinity,
    "tolerations": _tolerations,
    **parity_topology.FAMILIES,
    **parity_volumes.FAMILIES,
}
