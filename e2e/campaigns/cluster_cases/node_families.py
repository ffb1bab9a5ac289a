"""Families about nodes: cordons, taints, selectors, affinity, ports, images, declared features."""

from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.scene import HOSTNAME, NODE_LABELS, ZONE, ZONES, Json, Scene, container

_REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
_PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"
_CORDON = "node.kubernetes.io/unschedulable"
_TAINT_KEYS = ("dedicated", "maintenance", _CORDON)
_EFFECTS = ("NoSchedule", "PreferNoSchedule", "NoExecute")
_MIB = 1024 * 1024
_SIZES = {
    "registry.k8s.io/pause:3.10": 700_000,
    "example.com/ros/base:latest": 900 * _MIB,
    "example.com/ros/nav:2": 2100 * _MIB + 1,
    "localhost:5000/cam": 23 * _MIB,
    "example.com/big@sha256:" + "a" * 64: 5000 * _MIB,
    "tiny:1": 0,
}


def cordons(choices: Choices, scene: Scene) -> None:
    for node in scene.nodes:
        if choices.chance(50):
            node["spec"]["unschedulable"] = True
    if choices.chance(40):
        toleration = {"key": _CORDON, "operator": "Exists", "effect": choices.pick(("NoSchedule", "NoExecute"))}
        tolerations(scene.pod).append(toleration)


def taints(choices: Choices, scene: Scene) -> None:
    for node in scene.nodes:
        found = {}
        for _ in range(choices.pick((0, 1, 2, 3))):
            taint = {"key": choices.pick(_TAINT_KEYS), "effect": choices.pick(_EFFECTS)}
            if choices.chance(60):
                taint["value"] = choices.pick(("x", "y"))
            found[taint["key"], taint["effect"]] = taint
        if found:
            node["spec"]["taints"] = list(found.values())
    for _ in range(choices.pick((1, 0, 2, 3))):
        tolerations(scene.pod).append(_toleration(choices))


def _toleration(choices: Choices) -> Json:
    if choices.chance(12):
        return {"operator": "Exists"}
    found: Json = {"key": choices.pick(_TAINT_KEYS)}
    if choices.chance(50):
        found["operator"] = "Exists"
    else:
        found["value"] = choices.pick(("x", "y", ""))
        if choices.chance(50):
            found["operator"] = "Equal"
    if choices.chance(70):
        found["effect"] = choices.pick(_EFFECTS)
    return found


def tolerations(pod: Json) -> list[Json]:
    found: list[Json] = pod["spec"].setdefault("tolerations", [])
    return found


def node_selector(choices: Choices, scene: Scene) -> None:
    scene.pod["spec"]["nodeSelector"] = choices.pick(
        (
            {"disk": "ssd"},
            {ZONE: choices.pick(ZONES)},
            {"rack": "r0", "disk": "hdd"},
            {"disk": "tape"},
            {"nowhere": "1"},
        )
    )


def required_affinity(choices: Choices, scene: Scene) -> None:
    terms = [_term(choices, scene) for _ in range(choices.integer(1, 3))]
    affinity(scene.pod, "nodeAffinity")[_REQUIRED] = {"nodeSelectorTerms": terms}


def preferred_affinity(choices: Choices, scene: Scene) -> None:
    affinity(scene.pod, "nodeAffinity")[_PREFERRED] = [
        {"weight": choices.pick((1, 100, 2, 33)), "preference": _term(choices, scene)}
        for _ in range(choices.integer(1, 3))
    ]


def named_nodes(choices: Choices, scene: Scene) -> None:
    """The way of DaemonSets, and what becomes of it with several terms."""
    terms = []
    for _ in range(choices.pick((1, 1, 2))):
        fields = [_field(choices, scene) for _ in range(choices.pick((1, 1, 2)))]
        term: Json = {"matchFields": fields}
        if choices.chance(25):
            term["matchExpressions"] = [_expression(choices)]
        terms.append(term)
    if choices.chance(10):
        terms.append(_term(choices, scene))
    affinity(scene.pod, "nodeAffinity")[_REQUIRED] = {"nodeSelectorTerms": terms}


def _field(choices: Choices, scene: Scene) -> Json:
    operator = choices.pick(("In", "In", "In", "NotIn"))
    return {"key": "metadata.name", "operator": operator, "values": [choices.pick((*scene.names(), "elsewhere"))]}


def _term(choices: Choices, scene: Scene) -> Json:
    if choices.chance(5):
        return {}
    term: Json = {"matchExpressions": [_expression(choices) for _ in range(choices.integer(1, 2))]}
    if choices.chance(8):
        term["matchFields"] = [_field(choices, scene)]
    return term


def _expression(choices: Choices) -> Json:
    operator = choices.pick(("In", "NotIn", "Exists", "DoesNotExist", "Gt", "Lt"))
    if operator in {"Gt", "Lt"}:
        return {
            "key": choices.pick(("rank", "rank", "disk")),
            "operator": operator,
            "values": [choices.pick(("1", "0", "9", "007"))],
        }
    key = choices.pick(("disk", "rank", "rack", ZONE, HOSTNAME, "nowhere"))
    if operator in {"Exists", "DoesNotExist"}:
        return {"key": key, "operator": operator}
    values = NODE_LABELS.get(key) or {ZONE: ZONES, HOSTNAME: ("n0", "n1", "n2")}.get(key, ("1",))
    return {"key": key, "operator": operator, "values": choices.some(values, least=1)}


def affinity(pod: Json, kind: str) -> Json:
    found: Json = pod["spec"].setdefault("affinity", {}).setdefault(kind, {})
    return found


def host_ports(choices: Choices, scene: Scene) -> None:
    """DDS with host networking makes every port a host port; sidecars' ports count, those of init steps do not.

    No port is open twice on a node: when one of two such pods goes, upstream takes the port for free.
    """
    taken: set[tuple[str, ...]] = set()
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(60):
            _open(choices, pod, container(pod), taken)
        if choices.chance(15):
            step = {"name": "side", "image": container(pod)["image"]}
            if choices.chance(60):
                step["restartPolicy"] = "Always"
            _open(choices, pod, step, taken, among=(7402,))
            pod["spec"].setdefault("initContainers", []).append(step)


def _open(
    choices: Choices, pod: Json, holder: Json, taken: set[tuple[str, ...]], among: tuple[int, ...] = (7400, 7401)
) -> None:
    holder["ports"] = []
    for port in choices.some(among, least=1):
        protocol = choices.pick(("TCP", "TCP", "UDP"))
        where: Json = choices.pick(({}, {"hostIP": "10.0.0.1"}, {"hostIP": "10.0.0.2"}, {"hostIP": "0.0.0.0"}))  # noqa: S104
        address = where.get("hostIP", "0.0.0.0")  # noqa: S104
        key = (pod["spec"].get("nodeName", ""), address, protocol, str(port))
        opened: Json = {"containerPort": port, "protocol": protocol, **where}
        if not choices.chance(15) and key not in taken:
            taken.add(key)
            opened["hostPort"] = port
        holder["ports"].append(opened)


def images(choices: Choices, scene: Scene) -> None:
    """An image has one size wherever it is: upstream takes that of the node it saw first."""
    names = list(_SIZES)
    for node in scene.nodes:
        node["status"]["images"] = [
            {"names": [_tagged(name)], "sizeBytes": _SIZES[name]} for name in choices.some(names)
        ]
    spec = scene.pod["spec"]
    container(scene.pod)["image"] = choices.pick(("example.com/ros/base", *names))
    for index in range(choices.pick((0, 1, 2))):
        spec["containers"].append({"name": f"more{index}", "image": choices.pick(names)})
    if choices.chance(30):
        spec.setdefault("initContainers", []).append({"name": "pull", "image": choices.pick(names)})
    if choices.chance(25):
        volume = {"name": "rosbag", "image": {"reference": choices.pick(names), "pullPolicy": "IfNotPresent"}}
        spec.setdefault("volumes", []).append(volume)


def _tagged(image: str) -> str:
    return image if ":" in image.rsplit("/", 1)[-1] else f"{image}:latest"


def declared_features(choices: Choices, scene: Scene) -> None:
    """Restart rules, which an API server takes; user namespaces with host networking, which it takes behind a gate."""
    rule = {"action": "RestartAllContainers", "exitCodes": {"operator": "In", "values": [42]}}
    if choices.chance(80):
        container(scene.pod).update({"restartPolicy": "Never", "restartPolicyRules": [rule]})
    for node in scene.nodes:
        node["status"]["declaredFeatures"] = choices.some(("RestartAllContainersOnContainerExits", "SomethingElse"))
