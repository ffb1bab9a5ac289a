"""Quantities and request sums."""

from decimal import ROUND_CEILING, Decimal
from typing import Any

Json = dict[str, Any]

_SUFFIX = {
    "": Decimal(1), "n": Decimal("1e-9"), "u": Decimal("1e-6"), "m": Decimal("1e-3"), "k": Decimal(10**3),
    "M": Decimal(10**6), "G": Decimal(10**9), "T": Decimal(10**12), "Ki": Decimal(2**10), "Mi": Decimal(2**20),
    "Gi": Decimal(2**30), "Ti": Decimal(2**40),
}  # fmt: skip
DEFAULTS = {"cpu": 100, "memory": 200 * 1024 * 1024}


def whole(name: str, text: str) -> int:
    """cpu in milli, all else in whole units, rounded up."""
    number = text.rstrip("numkMGTKi")
    value = Decimal(number) * _SUFFIX[text[len(number) :]]
    return int((value * 1000 if name == "cpu" else value).to_integral_value(rounding=ROUND_CEILING))


def requests_of(holder: Json | None) -> dict[str, int]:
    requests = ((holder or {}).get("resources") or {}).get("requests") or {}
    return {name: whole(name, text) for name, text in requests.items()}


def container_sum(pod: Json, name: str, *, defaults: bool) -> int:
    """max(sum(containers) + sum(sidecars), max over plain init steps of (step + sidecars before it))."""

    def one(container: Json) -> int:
        requests = requests_of(container)
        if name in requests:
            return requests[name]
        return DEFAULTS.get(name, 0) if defaults else 0

    running = sum(one(container) for container in pod["spec"]["containers"])
    sidecars = 0
    peak = 0
    for step in pod["spec"].get("initContainers") or []:
        if step.get("restartPolicy") == "Always":
            sidecars += one(step)
            peak = max(peak, sidecars)
        else:
            peak = max(peak, one(step) + sidecars)
    return max(running + sidecars, peak)


def overhead(pod: Json, name: str) -> int:
    texts = pod["spec"].get("overhead") or {}
    return whole(name, texts[name]) if name in texts else 0


def pod_level(pod: Json, name: str) -> int | None:
    """spec.resources counts for cpu, memory and hugepages only."""
    if name not in {"cpu", "memory"} and not name.startswith("hugepages-"):
        return None
    return requests_of(pod["spec"]).get(name)


def occupied(pod: Json, name: str) -> int:
    """What the pod really takes."""
    level = pod_level(pod, name)
    return (container_sum(pod, name, defaults=False) if level is None else level) + overhead(pod, name)


def scored_incoming(pod: Json, name: str) -> int:
    """The Fit scorer's view of the pod to place: container sums with defaults, pod-level values unknown to it."""
    return container_sum(pod, name, defaults=True) + overhead(pod, name)


def scored_placed(pod: Json, name: str) -> int:
    """The Fit scorer's view of a pod on a node."""
    level = pod_level(pod, name)
    return (container_sum(pod, name, defaults=True) if level is None else level) + overhead(pod, name)


def named(pod: Json) -> list[str]:
    """Resources the pod mentions, in no order that matters."""
    holders = [pod["spec"], *pod["spec"]["containers"], *(pod["spec"].get("initContainers") or [])]
    names = {name for holder in holders for name in requests_of(holder)}
    return sorted(names | set(pod["spec"].get("overhead") or {}))


def allocatable(node: Json, name: str) -> int:
    texts = node["status"].get("allocatable") or {}
    return whole(name, texts[name]) if name in texts else 0
