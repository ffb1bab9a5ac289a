"""Step 3: the same application placed by kube-scheduler, with the round-trip time of every edge from the telemetry."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from journeys.demo_cluster import NAMESPACE, ROOT, DemoCluster
from journeys.stage import Stage, wait_for
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.network import Topology

_COPIES = 3
"""As many as fit on the edge servers beside the first one."""


@dataclass(frozen=True)
class Leg:
    """One edge of a placed application."""

    app: str
    topic: str
    from_node: str
    to_node: str
    rtt_ms: float
    budget_ms: float

    @property
    def met(self) -> bool:
        return self.rtt_ms <= self.budget_ms


def compare_with_kube_scheduler(stage: Stage, demo: DemoCluster) -> None:
    stage.step(f"The same application {_COPIES} times under each scheduler")
    counts = {}
    for scheduler in ("default-scheduler", "ros-aware-scheduler"):
        with (
            created(demo.cluster, f"{NAMESPACE}-{scheduler.partition('-')[0]}") as namespace,
            stage.waiting(f"{scheduler} places {_COPIES} copies"),
        ):
            legs = _placed_legs(demo, namespace, scheduler)
        counts[scheduler] = sum(not leg.met for leg in legs)
        stage.say(f"[bold]{scheduler}[/bold]: {counts[scheduler]} of {len(legs)} edges miss their budget")
        for leg in sorted(legs, key=lambda leg: -leg.rtt_ms)[:3]:
            mark = "[green]met[/green]" if leg.met else "[red]missed[/red]"
            route = f"{leg.from_node} → {leg.to_node}"
            stage.say(f"  {leg.topic:12} {route:22} {leg.rtt_ms:6.1f} ms of {leg.budget_ms:g} ms  {mark}")
    stage.say("[dim]Nodes and round-trip times are simulated; both schedulers saw the same cluster.[/dim]")
    stage.claim("no edge placed by ros-aware-scheduler misses its budget", counts["ros-aware-scheduler"] == 0)


def _placed_legs(demo: DemoCluster, namespace: str, scheduler: str) -> list[Leg]:
    """Create the copies, wait until every pod has a node, and look up the round trip of every edge."""
    app = yaml.safe_load((ROOT / "examples/teleop.yaml").read_text())
    copies = [
        app | {"metadata": {"name": f"copy-{number}"}, "spec": app["spec"] | {"schedulerName": scheduler}}
        for number in range(_COPIES)
    ]
    demo.apply(*copies, namespace=namespace)
    wanted = _COPIES * len(app["spec"]["components"])
    nodes, _ = wait_for("all copies placed", lambda: _nodes_of(demo, namespace, wanted), within_s=60, every_s=0.1)
    legs = list(_legs(copies, nodes, demo.topology))
    demo.cluster.kubectl("-n", namespace, "delete", "robotapps", "--all")
    wait_for("the copies' end", lambda: not demo.items("pods", namespace=namespace), within_s=60, every_s=0.1)
    return legs


def _nodes_of(demo: DemoCluster, namespace: str, wanted: int) -> dict[tuple[str, str], str] | None:
    """(app, component) → node, once `wanted` pods have one."""
    pods = [pod for pod in demo.items("pods", namespace=namespace) if pod["spec"].get("nodeName")]
    nodes = {
        _component(pod): pod["spec"]["nodeName"] for pod in pods if "robotics.io/component" in pod["metadata"]["labels"]
    }
    return nodes if len(nodes) >= wanted else None


def _component(pod: dict[str, Any]) -> tuple[str, str]:
    labels = pod["metadata"]["labels"]
    return labels["robotics.io/app"], labels["robotics.io/component"]


def _legs(apps: list[dict[str, Any]], nodes: dict[tuple[str, str], str], topology: Topology) -> Iterator[Leg]:
    for app in apps:
        name = app["metadata"]["name"]
        for edge in app["spec"]["edges"]:
            ends = [nodes[name, end] for end in (edge["from"], edge["to"])]
            yield Leg(
                app=name,
                topic=edge["topic"],
                from_node=ends[0],
                to_node=ends[1],
                rtt_ms=topology.rtt_ms(*ends),
                budget_ms=float(edge["latency"]["budget"].removesuffix("ms")),
            )
