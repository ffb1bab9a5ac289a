"""Our programs as pods on real nodes: the chart's own workloads, ServiceAccounts and security settings.

components_as_pods.run(cp)  # operator, scheduler and an agent on every node
with components_as_pods.agents(cp, interval_s=2):  # the agents alone
    components_as_pods.wait_measured(cp)
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

from robotapp_api.model.names import API_VERSION, SYSTEM_NAMESPACE
from robotapp_testbed import images
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes.process import wait_until

IMAGES: Final = ("operator", "scheduler", "agent")
"""What RealNodes needs in `images` for them."""
AGENTS: Final = "robotapp-agent"
"""DaemonSet of the agents, and its namespace."""
TELEMETRY: Final = f"/apis/{API_VERSION}/nodetelemetries"

_ROLLED_OUT_S = 90
_MEASURED_S = 90.0
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
    """Install everything the chart has and wait until all programs run. The release's namespace enforces `restricted`."""
    merged = _values(values or {})
    product.install(cp, values=merged)
    cp.kubectl("label", "--overwrite", "namespace", SYSTEM_NAMESPACE, *(f"{k}={v}" for k, v in _RESTRICTED.items()))
    product.apply_workloads(cp, values=merged)
    for name in ("operator", "scheduler"):
        _wait_rolled_out(cp, f"deployment/robotapp-{name}", SYSTEM_NAMESPACE)
    _wait_rolled_out(cp, f"daemonset/{AGENTS}", AGENTS)


@contextmanager
def agents(cp: ControlPlane, *, interval_s: int = 2, values: Mapping[str, Any] | None = None) -> Iterator[None]:
    """The chart's agent on every node, measuring each `interval_s`; at the end both go, the agents and what they wrote."""
    try:
        start_agents(cp, interval_s=interval_s, values=values)
        yield
    finally:
        # In the foreground: an agent that still runs would write its telemetry again.
        cp.kubectl("delete", "daemonset", AGENTS, "-n", AGENTS, "--cascade=foreground", f"--timeout={_ROLLED_OUT_S}s")
        cp.api.delete(TELEMETRY)


def start_agents(cp: ControlPlane, *, interval_s: int = 2, values: Mapping[str, Any] | None = None) -> None:
    """Installs the chart with its agents and waits until they run; for a cluster that is thrown away with them."""
    merged = _values({"agent": {"intervalSeconds": interval_s, **(values or {})}})
    product.install(cp, values=merged)
    product.apply_workloads(cp, values=merged, kinds={"DaemonSet"})
    _wait_rolled_out(cp, f"daemonset/{AGENTS}", AGENTS)


def wait_measured(cp: ControlPlane, *, timeout_s: float = _MEASURED_S) -> None:
    """Until every node's agent has measured a round trip to every other node."""
    if not wait_until(lambda: not _unmeasured(cp), timeout_s=timeout_s, poll_s=0.2):
        missing = "; ".join(f"{one} to {', '.join(others)}" for one, others in _unmeasured(cp).items())
        raise TestbedError(f"not measured after {timeout_s:.0f} s: {missing}. See kubectl logs -n {AGENTS} ds/{AGENTS}")


def round_trip(cp: ControlPlane, one: str, other: str) -> dict[str, Any]:
    """The entry of one node's telemetry about another one; empty without one."""
    for item in cp.api.get(TELEMETRY)["items"]:
        if item["metadata"]["name"] == one:
            return next((each for each in item.get("status", {}).get("rtt", []) if each["peer"] == other), {})
    return {}


def _unmeasured(cp: ControlPlane) -> dict[str, list[str]]:
    names = {item["metadata"]["name"] for item in cp.api.get("/api/v1/nodes")["items"]}
    found = {
        item["metadata"]["name"]: {each["peer"] for each in item.get("status", {}).get("rtt", []) if "p50Us" in each}
        for item in cp.api.get(TELEMETRY)["items"]
    }
    missing = {name: sorted(names - {name} - found.get(name, set())) for name in sorted(names)}
    return {name: others for name, others in missing.items() if others}


def _wait_rolled_out(cp: ControlPlane, workload: str, namespace: str) -> None:
    cp.kubectl("rollout", "status", workload, f"--timeout={_ROLLED_OUT_S}s", f"--namespace={namespace}")


def _values(given: Mapping[str, Any]) -> dict[str, Any]:
    """The caller's values on top of our images, which have a registry of their own: the nodes' own store."""
    own: dict[str, Any] = {}
    for name in IMAGES:
        own["imageRegistry"], _, path = images.reference(name).partition("/")
        repository, _, tag = path.rpartition(":")
        own[name] = {"image": {"repository": repository, "tag": tag, "pullPolicy": "Never"}}
    merged = {
        key: {**own.get(key, {}), **value} if isinstance(value, Mapping) else value for key, value in given.items()
    }
    return {**own, **merged}


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
