"""Nodes and pods of the scheduler bench: the sizes kube-scheduler's own benchmarks use."""

from collections.abc import Callable, Mapping
from typing import Any

Json = dict[str, Any]
PAUSE = "registry.k8s.io/pause:3.10"
ZONES = 10


def node(index: int) -> Json:
    """32 CPUs, 256 GiB, 110 pods; ten zones in turn."""
    capacity = {"cpu": "32", "memory": "256Gi", "pods": "110", "ephemeral-storage": "500Gi"}
    name = f"node-{index:05}"
    return {
        "metadata": {
            "name": name,
            "labels": {
                "kubernetes.io/hostname": name,
                "topology.kubernetes.io/zone": f"zone-{index % ZONES}",
                "bench/kind": "blue" if index % 2 else "green",
            },
        },
        "status": {
            "capacity": capacity,
            "allocatable": capacity,
            "conditions": [{"type": "Ready", "status": "True", "reason": "KubeletReady"}],
        },
    }


def _pod(name: str, scheduler: str, **spec: Any) -> Json:
    requests = {"cpu": "100m", "memory": "100Mi"}
    container = {"name": "main", "image": PAUSE, "resources": {"requests": requests}}
    return {
        "metadata": {"name": name, "labels": {"app": "bench"}},
        "spec": {"schedulerName": scheduler, "terminationGracePeriodSeconds": 0, "containers": [container], **spec},
    }


def basic(name: str, scheduler: str) -> Json:
    return _pod(name, scheduler)


def selector(name: str, scheduler: str) -> Json:
    """Half of the nodes are eligible by a node selector."""
    return _pod(name, scheduler, nodeSelector={"bench/kind": "blue"})


def affinity(name: str, scheduler: str) -> Json:
    """Required and preferred node affinity by zone."""
    zone = "topology.kubernetes.io/zone"

    def term(*zones: str) -> Json:
        return {"matchExpressions": [{"key": zone, "operator": "In", "values": list(zones)}]}

    node_affinity = {
        "requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": [term("zone-1", "zone-2", "zone-3")]},
        "preferredDuringSchedulingIgnoredDuringExecution": [{"weight": 5, "preference": term("zone-2")}],
    }
    return _pod(name, scheduler, affinity={"nodeAffinity": node_affinity})


WORKLOADS: Mapping[str, Callable[[str, str], Json]] = {"basic": basic, "selector": selector, "affinity": affinity}
