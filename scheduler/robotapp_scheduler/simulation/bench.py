"""What one plugin costs: its own hooks are timed inside whole cycles, and the cycle is timed with and without it.

Rounds with and without the plugin alternate, and medians are taken: on a busy machine single rounds differ by a factor.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from statistics import median
from typing import Any, Final

from msgspec.structs import replace

from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.profiles import POINTS, Catalogue, ProfileSpec, build_profiles
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner

ROUNDS: Final = 3
HOOKS: Final = (*POINTS.values(), "filter_row", "score_row")
"""What of a plugin is timed."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One thing to measure: these pods on these nodes, where these pods run."""

    nodes: Sequence[Node]
    bound: Sequence[Pod]
    waiting: Sequence[Pod]
    reuse: bool
    """Results are kept per pod class, as in the scheduler; False computes every pod from nothing."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Microseconds per pod, medians over the rounds."""

    nodes: int
    pods: int
    reuse: bool
    plugin_us: float
    """Inside the plugin's own hooks."""
    cycle_us: float
    """The whole decision, with the plugin."""
    without_us: float
    """The whole decision under the same profile without it."""
    unplaced: int
    """Pods that found no node with the plugin."""
    error: str = ""
    """The first decision that failed because of the plugin, if any did."""

    @property
    def share(self) -> float:
        """Part of the cycle spent in the plugin, 0…1."""
        return self.plugin_us / self.cycle_us if self.cycle_us else 0.0


class Meter:
    """Adds up the time spent in a plugin's hooks. `clock` gives seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.spent_s = 0.0
        self._depth = 0

    def __repr__(self) -> str:
        return f"Meter({self.spent_s:.6f} s)"

    def of(self, cls: type) -> type:
        """The class with every hook timed; a hook that calls another counts once."""
        hooks = {name: self._timed(getattr(cls, name)) for name in HOOKS if callable(getattr(cls, name, None))}
        return type(cls.__name__, (cls,), {"__module__": cls.__module__, **hooks})

    def _timed(self, hook: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(hook)
        def timed(*args: Any, **named: Any) -> Any:
            if self._depth:
                return hook(*args, **named)
            self._depth += 1
            start_s = self.clock()
            try:
                return hook(*args, **named)
            finally:
                self.spent_s += self.clock() - start_s
                self._depth -= 1

        return timed


def measure(
    name: str,
    setting: Setting,
    *,
    catalogue: Catalogue,
    with_plugin: ProfileSpec,
    without: ProfileSpec,
    clock: Callable[[], float],
    rounds: int = ROUNDS,
) -> Cost:
    """Rounds with and without the plugin in turn; the first pair warms up and does not count."""
    meter = Meter(clock)
    timed = replace(catalogue, classes={**catalogue.classes, name: meter.of(catalogue.classes[name])})
    own, whole, bare, last = [], [], [], _Round(0.0, 0, "")
    for number in range(rounds + 1):
        meter.spent_s = 0.0
        last = _round(setting, with_plugin, timed, clock)
        other = _round(setting, without, catalogue, clock)
        if number:
            own.append(meter.spent_s)
            whole.append(last.took_s)
            bare.append(other.took_s)
    per_pod = 1e6 / max(len(setting.waiting), 1)
    return Cost(
        nodes=len(setting.nodes),
        pods=len(setting.waiting),
        reuse=setting.reuse,
        plugin_us=median(own) * per_pod,
        cycle_us=median(whole) * per_pod,
        without_us=median(bare) * per_pod,
        unplaced=last.unplaced,
        error=last.error,
    )


@dataclass(frozen=True, slots=True)
class _Round:
    took_s: float
    unplaced: int
    error: str


def _round(setting: Setting, spec: ProfileSpec, catalogue: Catalogue, clock: Callable[[], float]) -> _Round:
    cluster = Cache(clock=lambda: 0.0)
    for node in setting.nodes:
        cluster.apply_node(node)
    for pod in setting.bound:
        cluster.apply_pod(pod)
    profiles = build_profiles([spec], catalogue)
    core = SchedulerCore(cluster, profiles, clock=lambda: 0.0)
    runner = ProfileRunner(profiles[spec.scheduler_name], cluster, caching=setting.reuse)
    infos = [cluster.pod_info(pod) for pod in setting.waiting]
    unplaced, error = 0, ""
    start_s = clock()
    for info in infos:
        record, _ = core.consider(info, runner)
        if record.node is None:
            unplaced += 1
            error = error or (record.message if record.message.startswith("plugin ") else "")
        else:
            cluster.assume(info, record.node)
    return _Round(clock() - start_s, unplaced, error)
