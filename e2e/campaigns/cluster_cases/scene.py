"""A cluster under construction: nodes, pods on them, the pod to place, and whatever objects its families add."""

from dataclasses import dataclass, field
from typing import Any

from campaigns.cluster_cases.choices import Choices

Json = dict[str, Any]

HOSTNAME = "kubernetes.io/hostname"
ZONE = "topology.kubernetes.io/zone"
REGION = "topology.kubernetes.io/region"
OLD_ZONE = "failure-domain.beta.kubernetes.io/zone"
OLD_REGION = "failure-domain.beta.kubernetes.io/region"
ZONES = ("z0", "z1", "z2")
NAMESPACES = {"default": {"team": "red"}, "other": {"team": "blue"}, "third": {"team": "blue", "env": "test"}}
IMAGE = "registry.k8s.io/pause:3.10"
SCHEDULER = "ros-aware-scheduler"
APPS, TIERS, REVISIONS = ("a", "b"), ("x", "y"), ("1", "2")
NODE_LABELS = {"disk": ("ssd", "hdd"), "rank": ("1", "2", "10", "x7"), "rack": ("r0", "r1")}


@dataclass
class Scene:
    """`objects` are those that are neither nodes nor pods, classes and namespaces included."""

    nodes: list[Json] = field(default_factory=list)
    placed: list[Json] = field(default_factory=list)
    pod: Json = field(default_factory=dict)
    objects: list[Json] = field(default_factory=list)

    def add(self, kind: str, name: str, *, namespace: str = "", api: str = "v1", **body: Any) -> Json:
        """A further object; one that is there already under that name stays as it is."""
        for each in self.objects:
            meta = each["metadata"]
            if (each["kind"], meta["name"], meta.get("namespace", "")) == (kind, name, namespace):
                return each
        meta = {"name": name, "uid": f"uid-{kind.lower()}-{namespace}-{name}".replace("--", "-")}
        if namespace:
            meta["namespace"] = namespace
        made = {"apiVersion": api, "kind": kind, "metadata": meta | body.pop("metadata", {}), **body}
        self.objects.append(made)
        return made

    def of_kind(self, kind: str) -> list[Json]:
        return [each for each in self.objects if each["kind"] == kind]

    def names(self) -> list[str]:
        return [node["metadata"]["name"] for node in self.nodes]

    def pods(self) -> list[Json]:
        return [*self.placed, self.pod]


def make_node(name: str, *, cpu: str = "4", memory: str = "8Gi", pods: str = "110") -> Json:
    room = {"cpu": cpu, "memory": memory, "pods": pods, "ephemeral-storage": "10Gi"}
    return {
        "apiVersion": "v1",
        "kind": "Node",
        "metadata": {"name": name, "uid": f"uid-{name}", "labels": {HOSTNAME: name}},
        "spec": {},
        "status": {
            "capacity": dict(room),
            "allocatable": room,
            "images": [],
            "conditions": [{"type": "Ready", "status": "True"}],
        },
    }


def make_pod(name: str, *, namespace: str = "default", node: str = "", cpu: str = "100m", memory: str = "64Mi") -> Json:
    """A container that asks for something small; `node` places it."""
    container = {"name": "c0", "image": IMAGE, "resources": {"requests": {"cpu": cpu, "memory": memory}}}
    spec: Json = {"schedulerName": SCHEDULER, "terminationGracePeriodSeconds": 0, "containers": [container]}
    status: Json = {"phase": "Pending"}
    if node:
        spec["nodeName"] = node
        status = {"phase": "Running"}
    meta: Json = {"name": name, "namespace": namespace, "uid": f"uid-{namespace}-{name}", "labels": {}}
    return {"apiVersion": "v1", "kind": "Pod", "metadata": meta, "spec": spec, "status": status}


def draw_scene(choices: Choices, *, nodes: int = 12, placed: int = 30) -> Scene:
    """1 to `nodes` nodes with up to `placed` pods on them, and a plain pod to place."""
    scene = Scene()
    for name, labels in NAMESPACES.items():
        scene.add("Namespace", name, metadata={"labels": {**labels, "kubernetes.io/metadata.name": name}})
    count = choices.pick([n for n in (3, 1, 2, 4, 5, 6, 8, 12) if n <= nodes])
    scene.nodes = [_draw_node(choices, f"n{index}") for index in range(count)]
    count = choices.pick([n for n in (0, 1, 2, 3, 5, 8, 13, 30) if n <= placed])
    scene.placed = [_draw_placed(choices, scene, f"old{index}") for index in range(count)]
    scene.pod = make_pod("new", namespace=choices.pick(("default", "default", "other")))
    scene.pod["metadata"]["labels"] = _draw_labels(choices)
    return scene


def _draw_node(choices: Choices, name: str) -> Json:
    node = make_node(
        name, cpu=choices.pick(("4", "2", "1", "8")), memory=choices.pick(("8Gi", "2Gi", "1Gi", "9000000001"))
    )
    labels = node["metadata"]["labels"]
    if choices.chance(8):
        del labels[HOSTNAME]
    if choices.chance(80):
        labels[ZONE] = choices.pick(ZONES)
    for key, values in NODE_LABELS.items():
        if choices.chance(60):
            labels[key] = choices.pick(values)
    return node


def _draw_placed(choices: Choices, scene: Scene, name: str) -> Json:
    pod = make_pod(
        name,
        namespace=choices.pick(("default", "default", "default", "other", "third")),
        node=choices.pick(scene.names()),
        cpu=choices.pick(("100m", "50m", "0", "200m")),
    )
    pod["metadata"]["labels"] = _draw_labels(choices)
    if choices.chance(7):
        terminate(pod)
    if choices.chance(4):
        pod["status"]["phase"] = choices.pick(("Succeeded", "Failed"))
    return pod


def _draw_labels(choices: Choices) -> dict[str, str]:
    labels = {"app": choices.pick(APPS)}
    if choices.chance(70):
        labels["tier"] = choices.pick(TIERS)
    if choices.chance(50):
        labels["rev"] = choices.pick(REVISIONS)
    return {} if choices.chance(6) else labels


def terminate(pod: Json) -> None:
    """Deleted, but held by a finalizer."""
    pod["metadata"] |= {
        "deletionTimestamp": "2026-01-01T00:00:00Z",
        "deletionGracePeriodSeconds": 0,
        "finalizers": ["example.com/hold"],
    }


def draw_selector(choices: Choices) -> Json | None:
    """A LabelSelector over the labels of the scene's pods."""
    return choices.pick(
        (
            {"matchLabels": {"app": choices.pick(APPS)}},
            {"matchLabels": {"app": "a", "tier": choices.pick(TIERS)}},
            {"matchExpressions": [{"key": "tier", "operator": "Exists"}]},
            {"matchExpressions": [{"key": "tier", "operator": "NotIn", "values": ["x"]}]},
            {"matchExpressions": [{"key": "app", "operator": "In", "values": ["a", "b"]}]},
            {"matchExpressions": [{"key": "tier", "operator": "DoesNotExist"}], "matchLabels": {"app": "a"}},
            {"matchLabels": {"app": "nobody"}},
            {},
            None,
        )
    )


def draw_key(choices: Choices) -> str:
    """A topology key; the last is on no node."""
    return choices.pick((ZONE, HOSTNAME, "rack", "disk", "unheard-of"))


def container(pod: Json, at: int = 0) -> Json:
    found: Json = pod["spec"]["containers"][at]
    return found


def requests(holder: Json) -> dict[str, str]:
    """The requests of a container (or pod spec), to be changed in place."""
    found: dict[str, str] = holder.setdefault("resources", {}).setdefault("requests", {})
    return found
