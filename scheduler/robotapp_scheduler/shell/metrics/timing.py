"""How long plugins and extension points take: one call in ten is timed, as kube-scheduler samples its plugins.

Timing every call would cost a tenth of a decision. So the counts of these histograms are a tenth of the calls; sums and
buckets show the distribution.
"""

import time
from collections.abc import Callable, Mapping
from itertools import cycle
from typing import Any, Final, TypeVar

from robotapp_scheduler.core.framework.interface import Code
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.shell.metrics.histogram import Histogram
from robotapp_scheduler.shell.metrics.metrics import Metrics

ONE_IN: Final = 10
HOOKS: Final = {
    "pre_enqueue": "PreEnqueue",
    "pre_filter": "PreFilter",
    "filter": "Filter",
    "score": "Score",
    "score_among": "Score",
}
"""Hooks that are timed and upstream's names of their points. The row forms take less than a timer does."""

# Converted once: str() of an enum member takes longer than the observation.
ERROR: Final = str(Code.ERROR)
SUCCESS: Final = str(Code.SUCCESS)
UNSCHEDULABLE: Final = str(Code.UNSCHEDULABLE)

Clock = Callable[[], float]
_T = TypeVar("_T")


def time_plugins(profiles: Mapping[str, Profile], metrics: Metrics) -> None:
    """Put a timer around the hooks of every plugin of these profiles; call once, before they are used."""
    for profile in profiles.values():
        chains = (profile.pre_enqueue, profile.pre_filters, profile.filters, profile.scores)
        for loaded in {id(loaded): loaded for chain in chains for loaded in chain}.values():
            _time(loaded, metrics.plugin_s)


def _time(loaded: RegisteredPlugin, histogram: Histogram) -> None:
    for hook, point in HOOKS.items():
        function = getattr(loaded, hook)
        if function is not None:
            setattr(loaded, hook, sampled(function, histogram, (loaded.name, point), time.perf_counter))


def one_in_ten() -> Callable[[], bool]:
    """True for one call in ten, the first one included."""
    return cycle((True, *[False] * (ONE_IN - 1))).__next__


def sampled(function: Callable[..., Any], histogram: Histogram, labels: tuple[str, ...], clock: Clock) -> Any:
    """The function, with one call in ten observed under these labels and the status of its answer."""
    due = one_in_ten()

    def timed(*args: Any) -> Any:
        if not due():
            return function(*args)
        started_s = clock()
        status = str(Code.ERROR)
        try:
            answer = function(*args)
            status = status_of(answer)
        finally:
            histogram.labels(*labels, status).observe(clock() - started_s)
        return answer

    return timed


def status_of(answer: object) -> str:
    """The label `status` for a hook's result, in upstream's words. A mask or score is Success, whatever nodes it rejects."""
    status = getattr(answer, "status", answer)
    code = getattr(status, "code", None)
    if isinstance(code, Code):
        return str(code)
    return str(Code.SKIP if answer is None else Code.SUCCESS)


class Stopwatch:
    """Times extension points of whole decisions. The core gets it, and calls it around those that are due."""

    def __init__(self, metrics: Metrics) -> None:
        self._histogram = metrics.extension_point_s

    def __repr__(self) -> str:
        return "<Stopwatch>"

    def due(self) -> Callable[[], bool]:
        """A function that returns, for each call to come, whether it is to be timed."""
        return one_in_ten()

    def __call__(self, point: str, profile: str, work: Callable[[], _T]) -> _T:
        """Call `work` and record how long it takes."""
        started_s = time.perf_counter()
        status = ERROR
        try:
            answer = work()
            if answer is None:
                status = SUCCESS
            else:
                status = UNSCHEDULABLE if getattr(answer, "feasible", None) == 0 else _narrowed(answer)
        finally:
            self._histogram.labels(point, status, profile).observe(time.perf_counter() - started_s)
        return answer


class PointTimer:
    """Times the binding cycle: every call of a third-party hook, and one in ten of the steps of built-in plugins."""

    def __init__(self, metrics: Metrics) -> None:
        self.clock: Clock = time.perf_counter
        self._metrics = metrics
        self._calls: dict[str, int] = {}

    def __repr__(self) -> str:
        return f"<PointTimer of {len(self._calls)} points>"

    def plugin(self, plugin: str, point: str, code: Code, started_s: float) -> None:
        """A third-party hook has returned."""
        self._metrics.plugin_s.labels(plugin, point, str(code)).observe(self.clock() - started_s)

    def begin(self, point: str) -> float | None:
        """The time now, for one step in ten; None for the others, which are not timed."""
        calls = self._calls[point] = self._calls.get(point, 0) + 1
        return self.clock() if calls % ONE_IN == 1 else None

    def end(self, point: str, profile: str, started_s: float | None, *, code: Code = Code.SUCCESS) -> None:
        """A step that `begin` timed has ended; None: it is not timed."""
        if started_s is not None:
            self._metrics.extension_point_s.labels(point, str(code), profile).observe(self.clock() - started_s)


def _narrowed(answer: object) -> str:
    """The label `status` for the result of PreFilter: node names, or a status."""
    status = getattr(answer, "status", None)
    code = getattr(status, "code", None)
    return str(code) if isinstance(code, Code) else SUCCESS
