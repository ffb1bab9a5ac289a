"""Families about amounts: requests, extended resources, pod level, init steps, overhead, resize, full nodes."""

from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.scene import IMAGE, Json, Scene, container, requests

_CPU = ("100m", "0", "1m", "250m", "0.5", "1", "1.5", "2", "3900m", "4", "0.0001")
_MEMORY = ("64Mi", "0", "1", "128Mi", "1Gi", "3Gi", "1500M", "7.5Gi", "1e9", "900m")
_BIG = ("64", "1Ei")
_GPU, _HUGE = "example.com/gpu", "hugepages-2Mi"


def amounts(choices: Choices, scene: Scene) -> None:
    """Requests of all sizes, missing ones included."""
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(40):
            own = requests(container(pod))
            own.clear()
            own.update(_draw(choices, huge=pod is scene.pod))
            if choices.chance(30):
                more = {"name": "c1", "image": IMAGE, "resources": {"requests": _draw(choices)}}
                pod["spec"]["containers"].append(more)
    for node in scene.nodes:
        _resize_node(choices, node)


def _draw(choices: Choices, *, huge: bool = False) -> dict[str, str]:
    found = {}
    if choices.chance(80):
        found["cpu"] = choices.pick(_CPU)
    if choices.chance(80):
        found["memory"] = choices.pick(_MEMORY)
    if choices.chance(20):
        found["ephemeral-storage"] = choices.pick(("1Gi", "0", "11Gi", "100M"))
    if huge and choices.chance(4):
        found["cpu"], found["memory"] = _BIG
    return found


def _resize_node(choices: Choices, node: Json) -> None:
    room = node["status"]["allocatable"]
    if choices.chance(25):
        room["cpu"] = choices.pick(("0", "1", "3950m", "64", "500m"))
    if choices.chance(25):
        room["memory"] = choices.pick(("0", "1Gi", "9000000001", "64Ti", "500M"))
    if choices.chance(10):
        del room[choices.pick(("cpu", "memory", "ephemeral-storage"))]
    node["status"]["capacity"] = dict(room)


def full_nodes(choices: Choices, scene: Scene) -> None:
    """The pods limit: 0, exactly reached, missing."""
    for node in scene.nodes:
        here = sum(1 for pod in scene.placed if pod["spec"]["nodeName"] == node["metadata"]["name"])
        limit = choices.pick((here + 1, here, 0, 110))
        node["status"]["allocatable"]["pods"] = node["status"]["capacity"]["pods"] = str(limit)


def extended(choices: Choices, scene: Scene) -> None:
    """GPUs and huge pages."""
    for node in scene.nodes:
        for name, options in ((_GPU, ("4", "1", "0", "2")), (_HUGE, ("8Mi", "2Mi", "0"))):
            if choices.chance(70):
                node["status"]["allocatable"][name] = node["status"]["capacity"][name] = choices.pick(options)
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(40):
            _limit(container(pod), _GPU, choices.pick(("1", "0", "2", "5")))
            if choices.chance(30):
                _limit(container(pod), _HUGE, choices.pick(("2Mi", "4Mi")))


def _limit(holder: Json, name: str, amount: str) -> None:
    requests(holder)[name] = amount
    holder["resources"].setdefault("limits", {})[name] = amount


def pod_level(choices: Choices, scene: Scene) -> None:
    """Requests of the pod as a whole, never less than its containers' sum."""
    for pod in scene.pods():
        if len(pod["spec"]["containers"]) == 1 and (pod is scene.pod or choices.chance(40)):
            own = requests(container(pod))
            own.clear()
            if choices.chance(60):
                own["cpu"] = choices.pick(("100m", "0", "1"))
            if choices.chance(60):
                own["memory"] = choices.pick(("64Mi", "0", "1Gi"))
            pod["spec"].pop("initContainers", None)
            pod["spec"]["resources"] = {"requests": _level(choices)}


def _level(choices: Choices) -> dict[str, str]:
    found = {"cpu": choices.pick(("1", "2", "4"))}
    if choices.chance(60):
        found["memory"] = choices.pick(("1Gi", "2Gi", "8Gi"))
    return {"memory": "1Gi"} if choices.chance(15) else found


def init_steps(choices: Choices, scene: Scene) -> None:
    """Init containers and sidecars in any order."""
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(30):
            steps = pod["spec"].setdefault("initContainers", [])
            for index in range(choices.integer(1, 3)):
                step: Json = {"name": f"init{index}", "image": IMAGE, "resources": {"requests": _draw(choices)}}
                if choices.chance(50):
                    step["restartPolicy"] = "Always"
                steps.append(step)


def overhead(choices: Choices, scene: Scene) -> None:
    """The API server takes an overhead only together with the RuntimeClass that has it; equal names mean equal classes."""
    fixed = {"cpu": choices.pick(("250m", "1", "10m")), "memory": choices.pick(("120Mi", "1Gi"))}
    name = f"boxed-{fixed['cpu']}-{fixed['memory']}".lower()
    scene.add("RuntimeClass", name, api="node.k8s.io/v1", handler="boxed", overhead={"podFixed": fixed})
    for pod in scene.pods():
        if pod is scene.pod or choices.chance(40):
            pod["spec"] |= {"runtimeClassName": name, "overhead": dict(fixed)}


def boxed_level(choices: Choices, scene: Scene) -> None:
    """Pod-level requests with an overhead: what only the overhead names gets no default in the score."""
    pod_level(choices, scene)
    overhead(choices, scene)


def resize(choices: Choices, scene: Scene) -> None:
    """Placed pods whose requests are being changed; the statuses name all resources the spec names."""
    for pod in scene.placed:
        if not choices.chance(60):
            continue
        requests(container(pod)).update(cpu=choices.pick(("100m", "1", "2")), memory=choices.pick(("64Mi", "1Gi")))
        steps = [step for step in pod["spec"].get("initContainers") or [] if step.get("restartPolicy") == "Always"]
        pod["status"]["containerStatuses"] = [_status(choices, each) for each in pod["spec"]["containers"]]
        pod["status"]["initContainerStatuses"] = [_status(choices, each) for each in steps]
        if choices.chance(25):
            reason = choices.pick(("Infeasible", "Deferred"))
            condition = {"type": "PodResizePending", "status": "True", "reason": reason}
            pod["status"].setdefault("conditions", []).append(condition)
    requests(container(scene.pod))["cpu"] = choices.pick(("1", "2", "100m"))


def _status(choices: Choices, each: Json) -> Json:
    named = (each.get("resources") or {}).get("requests") or {}
    status: Json = {"name": each["name"]}
    if choices.chance(70):
        status["allocatedResources"] = {name: _other(choices, name, text) for name, text in named.items()}
    if choices.chance(70):
        status["resources"] = {"requests": {name: _other(choices, name, text) for name, text in named.items()}}
    return status


def _other(choices: Choices, name: str, text: str) -> str:
    return choices.pick((text, *{"cpu": ("500m", "3"), "memory": ("32Mi", "2Gi")}.get(name, (text,))))
