"""Families about pods that make room, and about what is refused: preemption, budgets, nominations, device claims."""

from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.scene import Json, Scene, container, make_pod, requests, terminate

_SCHEDULING = "scheduling.k8s.io/v1"
_OTHER_USER = {"resource": "pods", "name": "other", "uid": "uid-other"}
_PRIORITIES = (0, 0, 10, 10, 20, 100)


def set_priority(scene: Scene, pod: Json, value: int, *, policy: str = "PreemptLowerPriority") -> None:
    """The API server takes priority and policy only from a PriorityClass."""
    name = f"prio-{value}-{policy.lower()}"
    scene.add("PriorityClass", name, api=_SCHEDULING, value=value, preemptionPolicy=policy)
    pod["spec"] |= {"priorityClassName": name, "priority": value, "preemptionPolicy": policy}


def _start(pod: Json, index: int) -> None:
    """No two start together: upstream's order of such pods is random. 7 is coprime to 60, so the order is mixed."""
    pod["status"]["startTime"] = f"2026-01-01T0{index // 60}:{index * 7 % 60:02}:00Z"


def preemption(choices: Choices, scene: Scene) -> None:
    """Nodes full, or nearly, of pods of lower, equal and higher priority."""
    policy = "Never" if choices.chance(5) else "PreemptLowerPriority"
    set_priority(scene, scene.pod, choices.pick((100, 100, 20, 100, 10, 0)), policy=policy)
    requests(container(scene.pod)).update(cpu=choices.pick(("2", "3", "1", "2", "9")), memory="64Mi")
    for node in scene.nodes:
        room = node["status"]["allocatable"]
        room["cpu"] = node["status"]["capacity"]["cpu"] = choices.pick(("2", "3", "4"))
        for _ in range(choices.pick((2, 1, 3, 0))):
            name = node["metadata"]["name"]
            low = make_pod(
                f"low{len(scene.placed)}", node=name, namespace=choices.pick(("default", "default", "other"))
            )
            low["metadata"]["labels"] = {"app": choices.pick(("a", "b")), "tier": choices.pick(("x", "y"))}
            if choices.chance(8):
                terminate(low)
            scene.placed.append(low)
    held = dict.fromkeys(scene.names(), 0)
    for index, pod in enumerate(scene.placed):
        set_priority(scene, pod, choices.pick(_PRIORITIES))
        _start(pod, index)
        cpu_milli = choices.pick((1000, 500, 1500, 100))
        requests(container(pod))["cpu"] = f"{cpu_milli}m"
        held[pod["spec"]["nodeName"]] += cpu_milli
    for node in scene.nodes:
        if choices.chance(60):
            # Not a milli left, as long as the pod would fit on the empty node.
            full = f"{max(held[node['metadata']['name']], 2000)}m"
            node["status"]["allocatable"]["cpu"] = node["status"]["capacity"]["cpu"] = full


def disruption_budgets(choices: Choices, scene: Scene) -> None:
    """Preemption under budgets; a pod is in one budget at most: their order would be random."""
    preemption(choices, scene)
    for app in choices.some(("a", "b"), least=1):
        selector = {"matchLabels": {"app": app}}
        status = {
            "disruptionsAllowed": choices.pick((0, 1, 2)),
            "currentHealthy": 1,
            "desiredHealthy": 1,
            "expectedPods": 1,
        }
        if choices.chance(15):
            status["disruptedPods"] = {"old0": "2026-01-01T00:00:00Z"}
        spec = {"selector": selector, "maxUnavailable": 1}
        namespace = choices.pick(("default", "default", "other"))
        scene.add("PodDisruptionBudget", f"pdb-{app}", namespace=namespace, api="policy/v1", spec=spec, status=status)


def nominations(choices: Choices, scene: Scene) -> None:
    """Others wait for a node that was promised to them; the pod itself may have a promise, too."""
    preemption(choices, scene)
    for index in range(choices.pick((1, 2))):
        guest = make_pod(f"guest{index}", cpu=choices.pick(("1", "500m", "2")))
        guest["metadata"]["labels"] = {"app": choices.pick(("a", "b"))}
        set_priority(scene, guest, choices.pick(_PRIORITIES))
        guest["status"]["nominatedNodeName"] = choices.pick(scene.names())
        scene.placed.append(guest)
    if choices.chance(30):
        nominated = choices.pick(scene.names())
        scene.pod["status"]["nominatedNodeName"] = nominated
        victims = [pod for pod in scene.placed if pod["spec"].get("nodeName") == nominated]
        if victims and choices.chance(50):
            victim = choices.pick(victims)
            terminate(victim)
            gone = {"type": "DisruptionTarget", "status": "True", "reason": "PreemptionByScheduler"}
            victim["status"].setdefault("conditions", []).append(gone)


def resource_claims(choices: Choices, scene: Scene) -> None:
    """Claims for devices: not allocated and of no class, or allocated on some nodes."""
    trouble = choices.pick(("unallocated", "everywhere", "somewhere", "somewhere", "nowhere"))
    names = {"everywhere": None, "somewhere": [choices.pick(scene.names())], "nowhere": ["gone"]}
    status: Json = {}
    if trouble in names:
        status["allocation"] = _allocated(names[trouble])
    if choices.chance(30):
        status["reservedFor"] = [_OTHER_USER]
    _camera(scene, status)


def allocated_claims(choices: Choices, scene: Scene) -> None:
    """Claims whose devices somebody uses: kube-scheduler does not take those back, as it does unused ones."""
    names = choices.pick(([choices.pick(scene.names())], ["gone"], None))
    _camera(scene, {"allocation": _allocated(names), "reservedFor": [_OTHER_USER]})


def _wish(scene: Scene) -> None:
    scene.pod["spec"]["resourceClaims"] = [{"name": "camera", "resourceClaimName": "camera"}]


def _camera(scene: Scene, status: Json) -> None:
    """The claim the pod names."""
    _wish(scene)
    namespace = scene.pod["metadata"]["namespace"]
    request = {"name": "camera", "exactly": {"deviceClassName": "camera.example.com"}}
    spec = {"devices": {"requests": [request]}}
    scene.add("ResourceClaim", "camera", namespace=namespace, api="resource.k8s.io/v1", spec=spec, status=status)


def _allocated(names: list[str] | None) -> Json:
    """Devices that these nodes reach, or all."""
    if names is None:
        return {"devices": {}, "allocationTimestamp": "2026-01-01T00:00:00Z"}
    field = {"key": "metadata.name", "operator": "In", "values": names}
    return {
        "devices": {},
        "allocationTimestamp": "2026-01-01T00:00:00Z",
        "nodeSelector": {"nodeSelectorTerms": [{"matchFields": [field]}]},
    }
