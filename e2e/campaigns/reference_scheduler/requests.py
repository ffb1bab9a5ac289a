"""How much a pod asks for and how much a placed pod holds (cpu in milli, all else in whole units).

A container sum is max(containers + sidecars, every plain init step + the sidecars started before it); the pod's
overhead comes on top. Pod-level requests replace the sum for cpu, memory and hugepages.
"""

from collections.abc import Callable, Mapping

from campaigns.reference_scheduler.model import Json
from campaigns.reference_scheduler.quantities import amount

DEFAULTS = {"cpu": 100, "memory": 200 * 1024 * 1024}
"""What the scorer of NodeResourcesFit takes a container without the request for."""
ASSIGNED = "allocatedResources"


def names_of(pod: Json) -> list[str]:
    """Every resource the pod mentions anywhere, sorted."""
    found: set[str] = set(_overhead(pod))
    for container in [*_steps(pod), *pod["spec"]["containers"]]:
        found.update(_requests(container))
    found.update(name for name in _pod_level(pod) if level_counts(name))
    return sorted(found)


def level_counts(name: str) -> bool:
    """Whether a pod-level request for this resource is honoured."""
    return name in {"cpu", "memory"} or name.startswith("hugepages-")


def held(pod: Json, name: str, *, compat_version: str = "1.37", defaults: Mapping[str, int] | None = None) -> int:
    """What the pod really takes. With `defaults`, a container without the request counts as that much."""
    default = (defaults or {}).get(name, 0)
    if level := _level_of(pod, name):
        return level[0] + _overhead(pod).get(name, 0)
    if compat_version == "1.35":
        total = _container_sum(pod, lambda c: _largest(pod, c, name, default))
    else:
        total = max(_totals(pod, name, default))
    return total + _overhead(pod).get(name, 0)


def scored_placed(pod: Json, name: str, *, compat_version: str = "1.37") -> int:
    """What a placed pod counts for in the score of NodeResourcesFit.

    A pod with pod-level requests gets a default only for a resource that neither level names.
    """
    named = name in names_of(pod)
    defaults = {} if _has_pod_level(pod) and named else DEFAULTS
    return held(pod, name, compat_version=compat_version, defaults=defaults)


def scored_incoming(pod: Json, name: str) -> int:
    """What the pod to place counts for there: container sums only, the scorer knows no pod-level requests."""
    default = DEFAULTS.get(name, 0)
    total = _container_sum(pod, lambda c: _requests(c).get(name, default))
    return total + _overhead(pod).get(name, 0)


def _container_sum(pod: Json, of: Callable[[Json], int]) -> int:
    sidecars = 0
    peak = 0
    for step in _steps(pod):
        if step.get("restartPolicy") == "Always":
            sidecars += of(step)
        else:
            peak = max(peak, sidecars + of(step))
    return max(peak, sidecars + sum(of(container) for container in pod["spec"]["containers"]))


def _totals(pod: Json, name: str, default: int) -> list[int]:
    """The totals by spec, by what is allocated and by what runs; a resize in progress makes them differ.

    What cannot be had is left out altogether, also where nothing else is known of a container.
    """
    found = []
    wish = _requests
    if _infeasible(pod):
        wish = _nothing
    else:
        found.append(_container_sum(pod, lambda c: _requests(c).get(name, default)))
    status = pod.get("status") or {}
    if ASSIGNED in status and "requests" in (status.get("resources") or {}):
        found += [_of(status[ASSIGNED]).get(name, 0), _of(status["resources"]["requests"]).get(name, 0)]
    else:
        found.append(_container_sum(pod, lambda c: _allocated(pod, c, wish).get(name, default)))
        found.append(_container_sum(pod, lambda c: _actual(pod, c, wish).get(name, default)))
    return found


def _largest(pod: Json, container: Json, name: str, default: int) -> int:
    """1.35: the largest of the three per container, before anything is summed."""
    sources = [_allocated(pod, container, _requests), _actual(pod, container, _requests)]
    if not _infeasible(pod):
        sources.append(_requests(container))
    return max(source.get(name, default) for source in sources)


def _allocated(pod: Json, container: Json, otherwise: Callable[[Json], dict[str, int]]) -> dict[str, int]:
    status = _status_of(pod, container)
    return _of(status[ASSIGNED]) if ASSIGNED in status else otherwise(container)


def _actual(pod: Json, container: Json, otherwise: Callable[[Json], dict[str, int]]) -> dict[str, int]:
    requests = (_status_of(pod, container).get("resources") or {}).get("requests")
    return _allocated(pod, container, otherwise) if requests is None else _of(requests)


def _nothing(_: Json) -> dict[str, int]:
    return {}


def _status_of(pod: Json, container: Json) -> Json:
    status = pod.get("status") or {}
    for each in [*(status.get("containerStatuses") or []), *(status.get("initContainerStatuses") or [])]:
        if each["name"] == container["name"]:
            found: Json = each
            return found
    return {}


def _infeasible(pod: Json) -> bool:
    return any(
        condition["type"] == "PodResizePending" and condition.get("reason") == "Infeasible"
        for condition in (pod.get("status") or {}).get("conditions") or []
    )


def _level_of(pod: Json, name: str) -> list[int]:
    """The pod-level amount as a list of one; empty when the pod has none for this resource."""
    if not level_counts(name) or name not in _pod_level(pod):
        return []
    status = pod.get("status") or {}
    sources = [_pod_level(pod), _of(status.get(ASSIGNED)), _of((status.get("resources") or {}).get("requests"))]
    return [max(source.get(name, 0) for source in sources)]


def _has_pod_level(pod: Json) -> bool:
    return any(level_counts(name) for name in _pod_level(pod))


def _pod_level(pod: Json) -> dict[str, int]:
    return _requests(pod["spec"])


def _steps(pod: Json) -> list[Json]:
    return pod["spec"].get("initContainers") or []


def _overhead(pod: Json) -> dict[str, int]:
    return _of(pod["spec"].get("overhead"))


def _requests(holder: Json) -> dict[str, int]:
    return _of((holder.get("resources") or {}).get("requests"))


def _of(quantities: Json | None) -> dict[str, int]:
    return {name: amount(name, text) for name, text in (quantities or {}).items()}
