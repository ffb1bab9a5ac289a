"""How much a pod asks for: sums over containers, sidecars and init steps as kube-scheduler 1.37 does them.

Units: cpu in milli, everything else in whole units, rounded up.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, Protocol

from robotapp_api.values.quantity import parse_bytes, parse_milli

DEFAULT_CPU_MILLI: Final = 100
DEFAULT_MEMORY_BYTES: Final = 200 * 1024 * 1024
POD_LEVEL: Final = ("cpu", "memory")
POD_LEVEL_PREFIX: Final = "hugepages-"

Amounts = dict[str, int]
Raw = Mapping[str, str | int | float]


class RequirementsLike(Protocol):
    """resources of a container or pod."""

    @property
    def requests(self) -> Raw | None: ...


class ContainerLike(Protocol):
    """What is read of a container."""

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


class PodRequests(NamedTuple):
    """The three sums the scheduler needs.

    exact: what the pod occupies (the filter and BalancedAllocation read it).
    scored: what the Fit scorer assumes of an *incoming* pod: container sums with defaults for containers that name no
        cpu or memory; it knows no pod-level resources (upstream's quirk, kept for equal decisions).
    placed: what the Fit scorer counts once the pod is placed: as `scored`, but pod-level values win.
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


def pod_requests(spec: PodSpecLike) -> PodRequests:
    """All three sums of a pod. Raises ValueError when a quantity cannot be read."""
    overhead = amounts(spec.overhead)
    exact = _aggregate(spec, _requested)
    scored = _aggregate(spec, _with_defaults)
    pod_level = {
        name: value
        for name, value in amounts(spec.resources.requests if spec.resources else None).items()
        if name in POD_LEVEL or name.startswith(POD_LEVEL_PREFIX)
    }
    placed = {**scored, **pod_level}
    return PodRequests(_plus({**exact, **pod_level}, overhead), _plus(scored, overhead), _plus(placed, overhead))


def _requested(container: ContainerLike) -> Amounts:
    return amounts(container.resources.requests)


def _with_defaults(container: ContainerLike) -> Amounts:
    # Only an absent request is replaced: an explicit zero stays zero.
    return {"cpu": DEFAULT_CPU_MILLI, "memory": DEFAULT_MEMORY_BYTES, **amounts(container.resources.requests)}


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
