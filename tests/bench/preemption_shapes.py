"""Random full clusters and a pod that has to push its way in: a pure function of the seed."""

from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

from tests.bench.parity_shapes import IMAGE

Json = dict[str, Any]
CLASSES = {"p-5": -5, "p-0": 0, "p-1": 1, "p-2": 2, "p-3": 3, "p-polite": 3}
APPS = ("a", "b")


@dataclass(frozen=True, slots=True)
class Placed:
    """One running pod. `start` is a time of day in seconds."""

    name: str
    node: str
    klass: str
    app: str
    start: int
    cpu_milli: int
    port: bool

    @property
    def priority(self) -> int:
        return CLASSES[self.klass]

    def body(self) -> Json:
        spec = {**_spec(self.cpu_milli, self.klass, port=self.port), "nodeName": self.node}
        return {"metadata": {"name": self.name, "labels": {"app": self.app}}, "spec": spec}

    def status(self) -> Json:
        return {"phase": "Running", "startTime": f"2026-01-01T00:00:{self.start:02d}Z"}


@dataclass(frozen=True, slots=True)
class Scene:
    """Nodes by cpu (milli) and allowed pods, pods on them, disruptions allowed per app, and who wants to get in."""

    nodes: tuple[tuple[str, int, int], ...]
    placed: tuple[Placed, ...]
    budgets: tuple[tuple[str, int], ...]
    pod: Json

    def node_bodies(self) -> list[Json]:
        return [
            {
                "metadata": {"name": name, "labels": {"kubernetes.io/hostname": name}},
                "spec": {"taints": []},
                "status": {"allocatable": _amounts(cpu, pods), "capacity": _amounts(cpu, pods)},
            }
            for name, cpu, pods in self.nodes
        ]


def scene(random: Random) -> Scene:
    """One to five nodes with up to four pods each; distinct start times, so that upstream's order is determined."""
    nodes = tuple(
        (f"n{i}", random.choice((1000, 2000)), random.choice((3, 4, 110, 110))) for i in range(random.randint(1, 5))
    )
    starts = random.sample(range(60), 20)
    placed: list[Placed] = []
    for name, _, pods in nodes:
        for _ in range(random.randint(2, min(4, pods))):
            placed.append(
                Placed(
                    name=f"p{len(placed)}",
                    node=name,
                    klass=random.choice(("p-5", "p-0", "p-0", "p-1", "p-2")),
                    app=random.choice(APPS),
                    start=starts[len(placed)],
                    cpu_milli=random.choice((100, 400, 700, 900)),
                    # Only one per node: kube-scheduler forgets that a second one uses the port too.
                    port=random.random() < 0.3 and not any(other.port for other in placed if other.node == name),
                )
            )
    budgets = tuple((app, random.randint(0, 2)) for app in APPS if random.random() < 0.5)
    klass = random.choice(("p-1", "p-2", "p-2", "p-3", "p-3", "p-3", "p-3", "p-polite"))
    wanted = _spec(random.choice((600, 900, 1000, 1500)), klass, port=random.random() < 0.25)
    return Scene(nodes, tuple(placed), budgets, {"metadata": {"labels": {"app": "vip"}}, "spec": wanted})


def cost(scene: Scene, victims: Sequence[str]) -> tuple[int, ...]:
    """What upstream compares between nodes: smaller is better. The victims of one node, by name."""
    chosen = [pod for pod in scene.placed if pod.name in victims]
    top = max(pod.priority for pod in chosen)
    earliest = min(pod.start for pod in chosen if pod.priority == top)
    total = sum(pod.priority + 2**31 for pod in chosen)
    return _violations(scene, chosen), top, total, len(chosen), -earliest


def _violations(scene: Scene, chosen: Sequence[Placed]) -> int:
    priority = CLASSES[scene.pod["spec"]["priorityClassName"]]
    lower = [pod for pod in scene.placed if pod.node == chosen[0].node and pod.priority < priority]
    left = dict(scene.budgets)
    broken = 0
    for pod in sorted(lower, key=lambda pod: (-pod.priority, pod.start)):
        if pod.app in left:
            left[pod.app] -= 1
            broken += left[pod.app] < 0 and pod in chosen
    return broken


def _spec(cpu_milli: int, klass: str, *, port: bool) -> Json:
    container: Json = {"name": "main", "image": IMAGE, "resources": {"requests": {"cpu": f"{cpu_milli}m"}}}
    if port:
        container["ports"] = [{"containerPort": 8080, "hostPort": 8080}]
    return {"priorityClassName": klass, "terminationGracePeriodSeconds": 0, "containers": [container]}


def _amounts(cpu_milli: int, pods: int) -> Json:
    return {"cpu": f"{cpu_milli}m", "memory": "8Gi", "pods": str(pods)}
