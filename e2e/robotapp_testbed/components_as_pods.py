"""Operator and scheduler as pods on real nodes: the chart's own workloads, ServiceAccounts and security settings."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from robotapp_api.model.names import SYSTEM_NAMESPACE
from robotapp_testbed import images, product
from robotapp_testbed.controlplane import ControlPlane

IMAGES: Final = ("operator", "scheduler")
"""What RealNodes needs in `images` for them."""

_ROLLED_OUT_S = 90
_RESTRICTED = {
    f"pod-security.kubernetes.io/{mode}{kind}": value
    for mode in ("enforce", "warn")
    for kind, value in (("", "restricted"), ("-version", "latest"))
}


@dataclass(frozen=True, slots=True)
class Usage:
    """What the kubelet says a pod uses."""

    node: str
    memory_bytes: int
    """Working set: what counts against the pod's limit."""
    rss_bytes: int
    cpu_milli: float
    """Of one core, averaged over the kubelet's last window."""
    cpu_s: float
    """Since the pod's start."""


def run(cp: ControlPlane, *, values: Mapping[str, Any] | None = None) -> None:
    """Install everything the chart has and wait until both programs are ready. The namespace enforces `restricted`."""
    own = _values()
    merged = {
        key: {**own.get(key, {}), **given} if isinstance(given, Mapping) else given
        for key, given in (values or {}).items()
    }
    product.install(cp, values={**own, **merged})
    cp.kubectl("label", "--overwrite", "namespace", SYSTEM_NAMESPACE, *(f"{k}={v}" for k, v in _RESTRICTED.items()))
    product.apply_workloads(cp, values={**own, **merged})
    for name in IMAGES:
        arguments = ("rollout", "status", f"deployment/robotapp-{name}", f"--timeout={_ROLLED_OUT_S}s")
        cp.kubectl(*arguments, f"--namespace={SYSTEM_NAMESPACE}")


def _values() -> dict[str, Any]:
    own = {}
    for name in IMAGES:
        repository, _, tag = images.reference(name).rpartition(":")
        own[name] = {"image": {"repository": repository, "tag": tag, "pullPolicy": "Never"}}
    return own


def usage(cp: ControlPlane, namespace: str = SYSTEM_NAMESPACE) -> dict[str, Usage]:
    """By pod name, from every kubelet's stats/summary."""
    found = {}
    for item in cp.api.get("/api/v1/nodes")["items"]:
        node = item["metadata"]["name"]
        summary = cp.api.get(f"/api/v1/nodes/{node}/proxy/stats/summary")
        for pod in summary["pods"]:
            if pod["podRef"]["namespace"] == namespace and pod.get("memory"):
                found[pod["podRef"]["name"]] = _usage(node, pod)
    return found


def _usage(node: str, pod: Mapping[str, Any]) -> Usage:
    containers = pod["containers"]
    return Usage(
        node=node,
        memory_bytes=sum(each.get("memory", {}).get("workingSetBytes", 0) for each in containers),
        rss_bytes=sum(each.get("memory", {}).get("rssBytes", 0) for each in containers),
        cpu_milli=sum(each.get("cpu", {}).get("usageNanoCores", 0) for each in containers) / 1e6,
        cpu_s=sum(each.get("cpu", {}).get("usageCoreNanoSeconds", 0) for each in containers) / 1e9,
    )
