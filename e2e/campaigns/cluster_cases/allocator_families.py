"""Families about situations that the tests of kube-scheduler's own allocator look at: searches that have to go back, limits, parts of pools.

The first families about devices are in device_families; these differ from them in that one choice decides about another.
"""

from typing import Final

from campaigns.cluster_cases.choices import Choices
from campaigns.cluster_cases.device_families import (
    API,
    DRIVERS,
    add_claim,
    add_class,
    add_classes,
    add_held_claim,
    make_request,
    take,
)
from campaigns.cluster_cases.scene import ZONE, Json, Scene

DRIVER: Final = DRIVERS[0]
LARGE: Final = f'device.capacity["{DRIVER}"].memory.compareTo(quantity("2Gi")) >= 0'
SMALL: Final = f'device.capacity["{DRIVER}"].memory.compareTo(quantity("1Gi")) >= 0'
BROKEN: Final = "device.attributes.nothing.of == 1"
"""Fails on every device on which it is evaluated."""
MOST_DEVICES: Final = 32
"""The API server takes so many devices in an allocation."""
ATTRIBUTES: Final = (
    ("number", {"int": 1}, {"int": 2}),
    ("text", {"string": "a"}, {"string": "b"}),
    ("truth", {"bool": True}, {"bool": False}),
    ("release", {"version": "1.0.0"}, {"version": "1.0.1"}),
    ("mixed", {"string": "1.0.0"}, {"version": "1.0.0"}),
)
"""Name and two values of an attribute. A version is never equal to a string."""


def draw_backtracking(choices: Choices, scene: Scene) -> None:
    """Requests for small and for large devices, where a small request that takes a large device leaves none for a later one."""
    add_classes(scene)
    for node in scene.names():
        sizes = [choices.pick(("1Gi", "2Gi")) for _ in range(choices.pick((2, 3, 4)))]
        devices = [_make_device(f"gpu{index}", memory=size) for index, size in enumerate(sizes)]
        _add_slice(scene, f"{node}-gpu", devices, pool=node, nodeName=node)
    take(choices, scene)
    wishes = [choices.pick((SMALL, LARGE)) for _ in range(choices.pick((2, 3)))]
    requests = [_select(make_request(choices, "gpus", name=f"r{index}"), text) for index, text in enumerate(wishes)]
    if choices.chance(50):
        add_claim(scene, requests)
        return
    for index, request in enumerate(requests):
        add_claim(scene, [request], name=f"claim{index}")


def draw_attributes(choices: Choices, scene: Scene) -> None:
    """Constraints on attributes of all types, equal or different, of all requests, of some, or of one subrequest."""
    name, *values = choices.pick(ATTRIBUTES)
    add_classes(scene)
    for node in scene.names():
        devices = []
        for index in range(choices.pick((2, 3, 4))):
            attributes = {} if choices.chance(15) else {name: choices.pick(values)}
            devices.append(_make_device(f"gpu{index}", attributes=attributes))
        _add_slice(scene, f"{node}-gpu", devices, pool=node, nodeName=node)
    take(choices, scene)
    requests = [make_request(choices, "gpus", name=f"r{index}") for index in range(choices.pick((2, 1, 3)))]
    requests[0]["exactly"] |= choices.pick(({}, {"count": 2}))
    names = [request["name"] for request in requests]
    if choices.chance(35):
        subs = [{"name": f"s{index}", "deviceClassName": "gpus", "count": count} for index, count in enumerate((2, 1))]
        requests.append({"name": "listed", "firstAvailable": subs})
        names += choices.pick((["listed"], ["listed/s0"], ["listed/s1"]))
    constraint: Json = {choices.pick(("matchAttribute", "distinctAttribute")): f"{DRIVER}/{name}"}
    concerned = choices.some(names, least=1)
    add_claim(scene, requests, constraints=[constraint | choices.pick(({}, {"requests": concerned}))])


def draw_slices(choices: Choices, scene: Scene) -> None:
    """Pools of several slices: without devices, of an older generation, with a slice missing, or with one name twice."""
    add_classes(scene)
    for node in scene.names():
        count = choices.pick((2, 1, 3))
        first_name = 0
        for index in range(count if choices.chance(80) else count - 1):
            amount = choices.pick((1, 2, 0))
            devices = [_make_device(f"gpu{first_name + offset}") for offset in range(amount)]
            first_name += amount if choices.chance(90) else 0
            generation = 2 if choices.chance(85) else 1
            pool = {"name": node, "generation": generation, "resourceSliceCount": count}
            spec = {"driver": DRIVER, "nodeName": node, "pool": pool, "devices": devices}
            scene.add("ResourceSlice", f"{node}-{index}", api=API, spec=spec)
    request = make_request(choices, "gpus")
    request["exactly"] |= choices.pick(({}, {"count": 2}, {"allocationMode": "All"}))
    add_claim(scene, [request] + ([make_request(choices, "gpus", name="more")] if choices.chance(30) else []))


def draw_limit(choices: Choices, scene: Scene) -> None:
    """Claims for about as many devices as an allocation may have, alone, together, all, or as one of several alternatives."""
    add_classes(scene)
    for node in scene.names():
        # With 20 devices kube-scheduler tries all combinations for 10 s, and fails the pod with an error.
        amount = choices.pick((MOST_DEVICES, MOST_DEVICES + 2, 6))
        _add_slice(scene, f"{node}-gpu", [_make_device(f"gpu{index:02}") for index in range(amount)], pool=node, nodeName=node)  # fmt: skip
    counts = choices.pick(((MOST_DEVICES,), (MOST_DEVICES + 1,), (30, 2), (30, 3), (2, 30)))
    requests = []
    for index, count in enumerate(counts):
        request = make_request(choices, "gpus", name=f"r{index}")
        request["exactly"] |= {"count": count}
        requests.append(request)
    kind = choices.pick(("counts", "all", "alternatives"))
    if kind == "all":
        requests[0]["exactly"] = {"deviceClassName": "gpus", "allocationMode": "All"}
    if kind == "alternatives":
        subs = [
            {"name": f"s{index}", "deviceClassName": "gpus", "count": count} for index, count in enumerate((33, 4, 1))
        ]
        requests[-1] = {"name": "listed", "firstAvailable": subs}
    add_claim(scene, requests)


def draw_per_device(choices: Choices, scene: Scene) -> None:
    """Slices in which each device says which nodes reach it."""
    add_classes(scene)
    for name in ("near", "far")[: choices.pick((1, 2))]:
        devices = []
        for index in range(choices.pick((2, 4, 6))):
            term = {"matchExpressions": [choices.pick(_EXPRESSIONS)]}
            reach: Json = choices.pick(
                (
                    {"nodeName": choices.pick(scene.names())},
                    {"allNodes": True},
                    {"nodeSelector": {"nodeSelectorTerms": [term]}},
                )
            )
            devices.append(_make_device(f"{name}{index}") | reach)
        _add_slice(scene, name, devices, pool=name, perDeviceNodeSelection=True)
    if choices.chance(40):
        add_held_claim("near0", scene, {"request": "r", "driver": DRIVER, "pool": "near", "device": "near0"})
    request = make_request(choices, "gpus")
    request["exactly"] |= choices.pick(({}, {"count": 2}, {"allocationMode": "All"}))
    add_claim(scene, [request])


def draw_reach(choices: Choices, scene: Scene) -> None:
    """Devices of the node beside devices that several nodes reach, in one claim or in several: the allocation joins both."""
    add_classes(scene)
    for node in scene.names():
        if choices.chance(70):
            _add_slice(scene, f"{node}-cam", [_make_device("cam0", driver=DRIVERS[1])], pool=node, nodeName=node, driver=DRIVERS[1])  # fmt: skip
    terms = [{"matchExpressions": choices.some(_EXPRESSIONS, least=1, most=2)}]
    for index in range(choices.pick((1, 2))):
        reach = choices.pick(({"nodeSelector": {"nodeSelectorTerms": terms}}, {"allNodes": True}))
        devices = [_make_device(f"net{index}{number}") for number in range(choices.pick((1, 2)))]
        _add_slice(scene, f"net{index}", devices, pool=f"net{index}", **reach)
    requests = [make_request(choices, name, name=f"r{index}") for index, name in enumerate(("gpus", "cams", "gpus"))]
    requests = requests[: choices.pick((2, 1, 3))]
    if choices.chance(60):
        add_claim(scene, requests)
        return
    for index, request in enumerate(requests):
        add_claim(scene, [request], name=f"claim{index}")


def draw_subrequests(choices: Choices, scene: Scene) -> None:
    """Alternatives with all devices, tolerations, parameters and selectors of their own, some of which cannot be evaluated."""
    add_classes(scene)
    add_class(scene, "broken", BROKEN)
    for node in scene.names():
        devices = [_make_device(f"gpu{index}", memory=choices.pick(("1Gi", "2Gi"))) for index in range(choices.pick((1, 2, 3)))]  # fmt: skip
        if choices.chance(40):
            devices[0]["taints"] = [{"key": "slow", "effect": "NoSchedule", "timeAdded": "2026-01-01T00:00:00Z"}]
        _add_slice(scene, f"{node}-gpu", devices, pool=node, nodeName=node)
    take(choices, scene)
    subs: list[Json] = []
    for index in range(choices.pick((2, 3))):
        of_class = "broken" if choices.chance(10) else "gpus"
        sub: Json = {"name": f"s{index}", "deviceClassName": of_class}
        sub |= choices.pick(({}, {"count": 2}, {"allocationMode": "All"}))
        sub |= choices.pick(({}, {"tolerations": [{"key": "slow", "operator": "Exists"}]}))
        sub |= choices.pick(({}, {"selectors": [{"cel": {"expression": LARGE}}]}))
        subs.append(sub)
    config = [
        {"requests": [f"listed/{sub['name']}"], "opaque": {"driver": DRIVER, "parameters": {"of": sub["name"]}}}
        for sub in subs
        if choices.chance(50)
    ]
    requests: list[Json] = [{"name": "listed", "firstAvailable": subs}]
    if choices.chance(40):
        requests.insert(choices.pick((0, 1)), make_request(choices, "gpus", name="plain"))
    add_claim(scene, requests, config=config)


_EXPRESSIONS: Final[tuple[Json, ...]] = (
    {"key": ZONE, "operator": "In", "values": ["z0", "z1"]},
    {"key": "disk", "operator": "In", "values": ["ssd"]},
    {"key": "rack", "operator": "Exists"},
    {"key": ZONE, "operator": "NotIn", "values": ["z2"]},
)


def _make_device(name: str, *, driver: str = DRIVER, memory: str = "", attributes: Json | None = None) -> Json:
    device: Json = {"name": name, "attributes": {"model": {"string": driver}, **(attributes or {})}}
    if memory:
        device["capacity"] = {"memory": {"value": memory}}
    return device


def _add_slice(
    scene: Scene, name: str, devices: list[Json], *, pool: str, driver: str = DRIVER, **reach: object
) -> None:
    spec = {"driver": driver, "pool": {"name": pool, "generation": 1, "resourceSliceCount": 1}, "devices": devices}
    scene.add("ResourceSlice", name, api=API, spec=spec | reach)


def _select(request: Json, text: str) -> Json:
    request["exactly"]["selectors"] = [{"cel": {"expression": text}}]
    return request
