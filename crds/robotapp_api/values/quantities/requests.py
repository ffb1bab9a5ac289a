"""How much a pod asks for: sums over containers, sidecars and init steps as kube-scheduler 1.37 does them.

Units: cpu in milli, everything else in whole units, rounded up.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, Protocol

from robotapp_api.values.quantities.quantity import parse_bytes, parse_milli

Amounts = dict[str, int]
DEFAULT_CPU_MILLI: Final = 100
DEFAULT_MEMORY_BYTES: Final = 200 * 1024 * 1024
DEFAULTS: Final = {"cpu": DEFAULT_CPU_MILLI, "memory": DEFAULT_MEMORY_BYTES}
POD_LEVEL: Final = ("cpu", "memory")
POD_LEVEL_PREFIX: Final = "hugepages-"

Raw = Mapping[str, str | int | float]


class RequirementsLike(Protocol):
    """resources of a container or pod."""

    @property
    def requests(self) -> Raw | None: ...


class ContainerLike(Protocol):
    """What is read of a container."""

    @property
    def name(self) -> str: ...
    @property
    def resources(self) -> RequirementsLike: ...
    @property
    def restart_policy(self) -> str: ...


class PodSpecLike(Protocol):
    """What is read of a pod's spec."""

    @property
    def containers(self) -> Sequence[ContainerLike]: ...
    @property
    def init_containers(self) -> Sequence[ContainerLike] | None: ...
    @property
    def overhead(self) -> Raw | None: ...
    @property
    def resources(self) -> RequirementsLike | None: ...


class ContainerStatusLike(Protocol):
    """What a kubelet says about a container: what it granted, and what is in force."""

    @property
    def name(self) -> str: ...
    @property
    def allocated_resources(self) -> Raw | None: ...
    @property
    def resources(self) -> RequirementsLike | None: ...


class PodStatusLike(Protocol):
    """What is read of a running pod's status while it is resized in place."""

    @property
    def container_statuses(self) -> Sequence[ContainerStatusLike]: ...
    @property
    def allocated_resources(self) -> Raw | None: ...
    @property
    def resources(self) -> RequirementsLike | None: ...
    @property
    def resize_infeasible(self) -> bool: ...


class PodRequests(NamedTuple):
    """The three sums the scheduler needs.

    exact: what the pod occupies (the filter and BalancedAllocation read it).
    scored: what the Fit scorer assumes of an *incoming* pod: container sums with defaults for containers that name no
        cpu or memory; it knows no pod-level resources (upstream's quirk, kept for equal decisions).
    placed: what the Fit scorer counts once the pod is placed: as `scored`, but pod-level values win, and a pod that has
        any gets a default only for what neither containers, pod level nor overhead name.
    """

    exact: Amounts
    scored: Amounts
    placed: Amounts


def amount(name: str, value: str | float) -> int:
    """One quantity as an integer. Raises ValueError for what is not a quantity."""
    text = value if isinstance(value, str | int) else repr(value)
    return parse_milli(text) if name == "cpu" else parse_bytes(text)


def amounts(raw: Raw | None) -> Amounts:
    """A whole resource list as integers."""
    return {name: amount(name, value) for name, value in raw.items()} if raw else {}


def pod_requests(spec: PodSpecLike, status: PodStatusLike | None = None) -> PodRequests:
    """All three sums of a pod. Raises ValueError when a quantity cannot be read.

    While a running pod is resized in place it holds the most of what its spec asks for, what its kubelet has granted
    and what is in force; a resize that the kubelet calls infeasible does not count.
    """
    overhead = amounts(spec.overhead)
    level = _pod_level(spec, status)
    exact = _plus({**_held(spec, status, {}), **level}, overhead)
    if not level and status is None and _all_named(spec):
        return PodRequests(exact, exact, exact)
    scored = _plus(_aggregate(spec, _with(DEFAULTS)), overhead)
    if not level and status is None:
        return PodRequests(exact, scored, scored)
    lacking = {name: value for name, value in DEFAULTS.items() if not level or name not in exact}
    placed = _plus({**_held(spec, status, lacking), **level}, overhead)
    return PodRequests(exact, scored, placed)


def _all_named(spec: PodSpecLike) -> bool:
    """Does every container say what it asks for of all that has a default?"""
    asked = [container.resources.requests for container in (*spec.containers, *(spec.init_containers or ()))]
    return all(raw is not None and DEFAULTS.keys() <= raw.keys() for raw in asked)


def _pod_level(spec: PodSpecLike, status: PodStatusLike | None) -> Amounts:
    """What spec.resources says in place of the containers' sums; only cpu, memory and huge pages can be said there."""
    wanted = _supported(spec.resources.requests if spec.resources is not None else None)
    if not wanted or status is None or status.resources is None:
        return wanted
    level = {} if status.resize_infeasible else wanted
    _raise_to(level, _supported(status.resources.requests))
    _raise_to(level, _supported(status.allocated_resources))
    return level


def _supported(raw: Raw | None) -> Amounts:
    return {
        name: value for name, value in amounts(raw).items() if name in POD_LEVEL or name.startswith(POD_LEVEL_PREFIX)
    }


def _held(spec: PodSpecLike, status: PodStatusLike | None, defaults: Amounts) -> Amounts:
    """Container sums of a pod, the largest of its three sides while it is resized."""
    wanted = _aggregate(spec, _with(defaults))
    if status is None:
        return wanted
    if (
        status.allocated_resources is not None
        and status.resources is not None
        and status.resources.requests is not None
    ):
        granted, in_force = amounts(status.allocated_resources), amounts(status.resources.requests)
    elif status.container_statuses:
        granted, in_force = _by_containers(spec, status, defaults)
    else:
        return wanted
    held = {} if status.resize_infeasible else wanted
    _raise_to(held, granted)
    _raise_to(held, in_force)
    return held


def _by_containers(spec: PodSpecLike, status: PodStatusLike, defaults: Amounts) -> tuple[Amounts, Amounts]:
    """(granted, in force), from the status of each container; the spec stands in where it says nothing."""
    told = {each.name: each for each in reversed(status.container_statuses)}

    def granted(container: ContainerLike) -> Raw | None:
        said = told.get(container.name)
        if said is not None and said.allocated_resources is not None:
            return said.allocated_resources
        return None if status.resize_infeasible else container.resources.requests

    def in_force(container: ContainerLike) -> Raw | None:
        said = told.get(container.name)
        if said is not None and said.resources is not None and said.resources.requests is not None:
            return said.resources.requests
        return granted(container)

    return (
        _aggregate(spec, lambda container: {**defaults, **amounts(granted(container))}),
        _aggregate(spec, lambda container: {**defaults, **amounts(in_force(container))}),
    )


def _with(defaults: Amounts) -> Callable[[ContainerLike], Amounts]:
    """A container's requests. Only an absent one is replaced: an explicit zero stays zero."""
    if not defaults:
        return lambda container: amounts(container.resources.requests)
    return lambda container: {**defaults, **amounts(container.resources.requests)}


def _aggregate(spec: PodSpecLike, of: Callable[[ContainerLike], Amounts]) -> Amounts:
    running: Amounts = {}
    for container in spec.containers:
        _add(running, of(container))
    sidecars: Amounts = {}
    peak: Amounts = {}
    for container in spec.init_containers or ():
        wanted = of(container)
        if container.restart_policy == "Always":
            _add(sidecars, wanted)
            _raise_to(peak, sidecars)
        else:
            _raise_to(peak, _plus(wanted, sidecars))
    _add(running, sidecars)
    _raise_to(running, peak)
    return running


def _add(total: Amounts, more: Amounts) -> None:
    for name, value in more.items():
        total[name] = total.get(name, 0) + value


def _raise_to(total: Amounts, floor: Amounts) -> None:
    for name, value in floor.items():
        if value > total.get(name, 0):
            total[name] = value


def _plus(left: Amounts, right: Amounts) -> Amounts:
    total = dict(left)
    _add(total, right)
    return total
