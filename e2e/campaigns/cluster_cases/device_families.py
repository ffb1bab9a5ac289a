"""Families about devices of resource.k8s.io: pools, requests, selectors, alternatives, constraints, taints, what is taken.

They are compared live only: the scalar reference has no allocator. No claim is missing or on its way out, since such a pod
is held before the queue, where neither scheduler says a word.
"""

from typing import Final

from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.scene import ZONE, Json, Scene

API: Final = "resource.k8s.io/v1"
DRIVERS: Final = ("gpu.example.com", "cam.example.com")
MODELS: Final = ("a100", "h100")
LONG_AGO: Final = "2026-01-01T00:00:00Z"
"""Without a time kube-scheduler would write one, which the API server refuses: the pod would fail for ever."""
OTHER_USER: Final = {"resource": "pods", "name": "other", "uid": "uid-other"}
ADMIN_LABEL: Final = "resource.kubernetes.io/admin-access"
SELECTORS: Final = (
    'device.driver == "gpu.example.com"',
    'device.attributes["gpu.example.com"].model == "a100"',
    'device.attributes["gpu.example.com"].rank > 1',
    '"gpu.example.com" in device.attributes && device.attributes["gpu.example.com"].healthy',
    'device.attributes["gpu.example.com"].?model.orValue("none") == "h100"',
    'device.capacity["gpu.example.com"].memory.compareTo(quantity("16Gi")) >= 0',
    'device.attributes["gpu.example.com"].version.isGreaterThan(semver("1.0.0"))',
    'device.attributes["gpu.example.com"].model.startsWith("a")',
    "true",
    "false",
)
"""Some end with an error on devices of the other driver: then the attempt is one, on both sides."""


def draw_counts(choices: Choices, scene: Scene) -> None:
    """Some devices per node, some of them taken, and a claim of one, several or all."""
    offer(choices, scene)
    take(choices, scene)
    request = make_request(choices)
    request["exactly"] |= choices.pick(({}, {"count": 2}, {"count": 3}, {"allocationMode": "All"}))
    add_claim(scene, [request])


def draw_selectors(choices: Choices, scene: Scene) -> None:
    """CEL expressions of the class and of the request."""
    offer(choices, scene)
    take(choices, scene)
    if choices.chance(40):
        add_class(scene, "picky", choices.pick(SELECTORS))
    request = make_request(choices, choices.pick(("all", "gpus", "picky" if has_class(scene, "picky") else "gpus")))
    texts = choices.some(SELECTORS, least=1, most=2)
    request["exactly"] |= {"selectors": [{"cel": {"expression": text}} for text in texts]}
    request["exactly"] |= choices.pick(({}, {"count": 2}))
    add_claim(scene, [request])


def draw_constraints(choices: Choices, scene: Scene) -> None:
    """Several requests whose devices must have an attribute in common."""
    offer(choices, scene)
    take(choices, scene)
    requests = [
        make_request(choices, name=name) for name in choices.pick((("one", "two"), ("one",), ("one", "two", "three")))
    ]
    requests[0]["exactly"] |= choices.pick(({}, {"count": 2}))
    request_names = choices.pick(([], [request["name"] for request in requests]))
    attribute = choices.pick(("gpu.example.com/model", "gpu.example.com/rank", "example.com/rack"))
    constraint: Json = {"matchAttribute": attribute} | ({"requests": request_names} if request_names else {})
    add_claim(scene, requests, constraints=[constraint])


def draw_alternatives(choices: Choices, scene: Scene) -> None:
    """Requests with a list, of which the first that fits is taken and counts in the score."""
    offer(choices, scene)
    take(choices, scene)
    requests = []
    for name in choices.pick((("one",), ("one", "two"))):
        subs = [_draw_alternative(choices, f"sub{index}") for index in range(choices.pick((2, 3, 1)))]
        requests.append({"name": name, "firstAvailable": subs})
    if choices.chance(30):
        requests.append(make_request(choices, name="plain"))
    add_claim(scene, requests)


def draw_taints(choices: Choices, scene: Scene) -> None:
    """Devices with taints of their own or of a rule, and requests that tolerate some."""
    offer(choices, scene)
    for resource_slice in scene.of_kind("ResourceSlice"):
        for device in resource_slice["spec"]["devices"]:
            if choices.chance(50):
                device["taints"] = [_draw_taint(choices)]
    if choices.chance(50):
        selector = choices.pick(({"driver": DRIVERS[0]}, {"pool": choices.pick(scene.names())}, {"device": "gpu0"}))
        spec = {"deviceSelector": selector, "taint": _draw_taint(choices)}
        scene.add("DeviceTaintRule", "rule", api=API, spec=spec)
    request = make_request(choices)
    if choices.chance(60):
        toleration: Json = choices.pick(({"operator": "Exists"}, {"key": "broken", "operator": "Exists"}))
        toleration = {**toleration, **choices.pick(({}, {"effect": "NoSchedule"}, {"effect": "NoExecute"}))}
        request["exactly"]["tolerations"] = [toleration]
    add_claim(scene, [request])


def draw_pools(choices: Choices, scene: Scene) -> None:
    """Pools that several or all nodes reach, of older generations, or not complete yet."""
    if choices.chance(50):
        offer(choices, scene)
    add_classes(scene)
    devices = [_draw_device(choices, DRIVERS[0], f"net{index}") for index in range(choices.pick((1, 2, 3)))]
    expression = choices.pick(
        (
            {"key": ZONE, "operator": "In", "values": ["z0", "z1"]},
            {"key": "disk", "operator": "In", "values": ["ssd"]},
            {"key": "rack", "operator": "Exists"},
        )
    )
    reach: Json = choices.pick(
        ({"allNodes": True}, {"nodeSelector": {"nodeSelectorTerms": [{"matchExpressions": [expression]}]}})
    )
    count = choices.pick((1, 1, 2))
    pool = {"name": "shared", "generation": choices.pick((1, 2)), "resourceSliceCount": count}
    spec = {"driver": DRIVERS[0], "pool": pool, **reach, "devices": devices}
    scene.add("ResourceSlice", "shared-0", api=API, spec=spec)
    if choices.chance(50):
        older = {**pool, "generation": choices.pick((1, 2)), "resourceSliceCount": count}
        more = [_draw_device(choices, DRIVERS[0], f"more{index}") for index in range(2)]
        scene.add("ResourceSlice", "shared-1", api=API, spec={**spec, "pool": older, "devices": more})
    if choices.chance(30):
        add_held_claim("net0", scene, {"request": "r", "driver": DRIVERS[0], "pool": "shared", "device": "net0"})
    request = make_request(choices, choices.pick(("gpus", "all")))
    request["exactly"] |= choices.pick(({}, {"count": 2}, {"allocationMode": "All"}))
    add_claim(scene, [request])


def draw_admin(choices: Choices, scene: Scene) -> None:
    """Admin access, which takes no device from anybody."""
    offer(choices, scene)
    take(choices, scene)
    for namespace in scene.of_kind("Namespace"):
        namespace["metadata"]["labels"][ADMIN_LABEL] = "true"
    request = make_request(choices)
    request["exactly"] |= {"adminAccess": True} | choices.pick(({}, {"allocationMode": "All"}))
    add_claim(scene, [request] + ([make_request(choices, name="plain")] if choices.chance(40) else []))


def draw_several(choices: Choices, scene: Scene) -> None:
    """Several claims of one pod, some of them allocated already."""
    offer(choices, scene)
    take(choices, scene)
    for name in choices.pick((("left", "right"), ("left",), ("left", "middle", "right"))):
        status: Json = {}
        if choices.chance(35):
            status = {"allocation": draw_allocation(choices, scene), "reservedFor": [OTHER_USER]}
        add_claim(scene, [make_request(choices)], name=name, status=status)


def draw_configs(choices: Choices, scene: Scene) -> None:
    """Parameters of class and claim that go with the allocation."""
    offer(choices, scene)
    for device_class in scene.of_kind("DeviceClass"):
        if choices.chance(60):
            device_class["spec"]["config"] = [_draw_config(choices, "class")]
    requests = [make_request(choices, name=name) for name in choices.pick((("one",), ("one", "two")))]
    config = [_draw_config(choices, "claim")]
    if choices.chance(60):
        config[0]["requests"] = [requests[0]["name"]]
    add_claim(scene, requests, config=config if choices.chance(80) else None)


def draw_unused(choices: Choices, scene: Scene) -> None:
    """An allocation that nobody uses, and that may be given up where no node reaches it."""
    offer(choices, scene)
    node_names = choices.pick((["gone"], [choices.pick(scene.names())], None))
    status: Json = {"allocation": _make_allocation(node_names, "gpu0")}
    if choices.chance(30):
        status["reservedFor"] = [OTHER_USER]
    add_claim(scene, [make_request(choices)], status=status)


def draw_no_class(choices: Choices, scene: Scene) -> None:
    """A class that does not exist, of an exact request or of an alternative."""
    offer(choices, scene)
    request = make_request(choices, "unheard-of")
    if choices.chance(50):
        subs = [
            _draw_alternative(choices, "sub0"),
            {**_draw_alternative(choices, "sub1"), "deviceClassName": "unheard-of"},
        ]
        request = {"name": "one", "firstAvailable": subs}
    add_claim(scene, [request])


# --- Parts --------------------------------------------------------------------------------------------------------


def add_classes(scene: Scene) -> None:
    """A class of everything, and one of each driver."""
    add_class(scene, "all", "true")
    add_class(scene, "gpus", f'device.driver == "{DRIVERS[0]}"')
    add_class(scene, "cams", f'device.driver == "{DRIVERS[1]}"')


def add_class(scene: Scene, name: str, expression: str) -> None:
    scene.add("DeviceClass", name, api=API, spec={"selectors": [{"cel": {"expression": expression}}]})


def has_class(scene: Scene, name: str) -> bool:
    return any(device_class["metadata"]["name"] == name for device_class in scene.of_kind("DeviceClass"))


def offer(choices: Choices, scene: Scene) -> None:
    """Give most nodes a pool of one driver, or of both."""
    add_classes(scene)
    for node in scene.names():
        for driver in DRIVERS[: choices.pick((1, 1, 2, 0))]:
            short = driver.partition(".")[0]
            devices = [_draw_device(choices, driver, f"{short}{index}") for index in range(choices.pick((1, 2, 3, 4)))]
            pool = {"name": node, "generation": 1, "resourceSliceCount": 1}
            spec = {"driver": driver, "nodeName": node, "pool": pool, "devices": devices}
            scene.add("ResourceSlice", f"{node}-{short}", api=API, spec=spec)


def take(choices: Choices, scene: Scene) -> None:
    """Let other claims have some of the devices."""
    for resource_slice in scene.of_kind("ResourceSlice"):
        spec = resource_slice["spec"]
        for device in spec["devices"]:
            if choices.chance(30):
                result = {
                    "request": "r",
                    "driver": spec["driver"],
                    "pool": spec["pool"]["name"],
                    "device": device["name"],
                }
                add_held_claim(f"{resource_slice['metadata']['name']}-{device['name']}", scene, result)


def add_held_claim(name: str, scene: Scene, result: Json) -> None:
    """A claim of somebody else that has a device."""
    spec = {"devices": {"requests": [{"name": "r", "exactly": {"deviceClassName": "all"}}]}}
    status = {
        "allocation": {"devices": {"results": [result]}, "allocationTimestamp": LONG_AGO},
        "reservedFor": [OTHER_USER],
    }
    scene.add("ResourceClaim", f"held-{name}", namespace="third", api=API, spec=spec, status=status)


def make_request(choices: Choices, of_class: str = "", name: str = "one") -> Json:
    """A request of one device."""
    return {"name": name, "exactly": {"deviceClassName": of_class or choices.pick(("gpus", "all", "cams"))}}


def add_claim(
    scene: Scene, requests: list[Json], *, name: str = "claim", status: Json | None = None, **more: object
) -> None:
    """A claim that the pod names."""
    namespace = scene.pod["metadata"]["namespace"]
    devices = {"requests": requests} | {key: value for key, value in more.items() if value}
    scene.add("ResourceClaim", name, namespace=namespace, api=API, spec={"devices": devices}, status=status or {})
    scene.pod["spec"].setdefault("resourceClaims", []).append({"name": name, "resourceClaimName": name})


def draw_allocation(choices: Choices, scene: Scene) -> Json:
    """status.allocation of a device that no slice of the scene has."""
    return _make_allocation(choices.pick(([choices.pick(scene.names())], scene.names(), None)), "elsewhere")


def _make_allocation(nodes: list[str] | None, device: str) -> Json:
    pool = nodes[0] if nodes else "shared"
    result = {"request": "one", "driver": DRIVERS[0], "pool": pool, "device": device}
    allocation: Json = {"devices": {"results": [result]}, "allocationTimestamp": LONG_AGO}
    if nodes is not None:
        terms = [{"matchFields": [{"key": "metadata.name", "operator": "In", "values": [node]}]} for node in nodes]
        allocation["nodeSelector"] = {"nodeSelectorTerms": terms}
    return allocation


def _draw_device(choices: Choices, driver: str, name: str) -> Json:
    attributes: Json = {"model": {"string": choices.pick(MODELS)}}
    if choices.chance(60):
        attributes["rank"] = {"int": choices.pick((1, 2, 3))}
    if choices.chance(50):
        attributes["healthy"] = {"bool": choices.pick((True, False))}
    if choices.chance(50):
        attributes["version"] = {"version": choices.pick(("1.0.0", "1.2.3", "2.0.0-rc.1"))}
    if choices.chance(50):
        attributes["example.com/rack"] = {"string": choices.pick(("r0", "r1"))}
    device: Json = {"name": name, "attributes": attributes}
    if driver == DRIVERS[0] and choices.chance(80):
        device["capacity"] = {"memory": {"value": choices.pick(("8Gi", "16Gi", "40Gi"))}}
    return device


def _draw_alternative(choices: Choices, name: str) -> Json:
    sub: Json = {"name": name, "deviceClassName": choices.pick(("gpus", "cams", "all"))}
    if choices.chance(30):
        sub["count"] = 2
    if choices.chance(30):
        sub["selectors"] = [{"cel": {"expression": choices.pick(SELECTORS)}}]
    return sub


def _draw_taint(choices: Choices) -> Json:
    return {
        "key": choices.pick(("broken", "slow")),
        "value": "yes",
        "effect": choices.pick(("NoSchedule", "NoExecute")),
        "timeAdded": LONG_AGO,
    }


def _draw_config(choices: Choices, what: str) -> Json:
    driver = choices.pick(DRIVERS)
    return {"opaque": {"driver": driver, "parameters": {"kind": what, "level": choices.pick((1, 2)), "none": None}}}
