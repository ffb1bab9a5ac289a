"""Where a program of ours spends its CPU: `python -m campaigns.scheduler.cpu_samples FILE MODULE ARGUMENTS…` runs MODULE and writes FILE.

Every few milliseconds of the process's CPU time the stack of its main thread is noted. That costs a hundredth of it, where
cProfile costs as much again as it measures and blames small functions most.
"""

import atexit
import importlib
import json
import runpy
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final

PERIOD_S: Final = 0.004
OTHER: Final = "other"
COUNTED: Final = (
    "robotapp_client.informer.reflector:Reflector._on_line",
    "robotapp_operator.reconcile.instance_reconciler:Children.reconcile",
    "robotapp_operator.reconcile.instance_reconciler:Children._turn",
    "robotapp_operator.reconcile.instance_objects:InstanceObjects.publish",
    "robotapp_operator.reconcile.status_reporter:Reporter.report",
)
"""Functions whose calls are counted, so that a cost can be told per call."""


class Samples:
    """`stacks`: how often each stack was met, outermost function first. Functions are `module:qualified name`."""

    def __init__(self) -> None:
        self.stacks: Counter[tuple[str, ...]] = Counter()
        self.calls: Counter[str] = Counter()

    def start(self) -> None:
        signal.signal(signal.SIGPROF, lambda _, frame: self._note(frame))
        signal.setitimer(signal.ITIMER_PROF, PERIOD_S, PERIOD_S)

    def _note(self, frame: FrameType | None) -> None:
        stack = []
        while frame is not None:
            stack.append(f"{frame.f_globals.get('__name__', '')}:{frame.f_code.co_qualname}")
            frame = frame.f_back
        self.stacks[tuple(reversed(stack))] += 1

    def count(self, place: str) -> None:
        """Count the calls of a method from now on."""
        module, _, path = place.partition(":")
        owner, _, name = path.partition(".")
        kind = getattr(importlib.import_module(module), owner)
        setattr(kind, name, self._counted(place, getattr(kind, name)))

    def _counted(self, place: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*args: Any, **kwargs: Any) -> Any:
            self.calls[place] += 1
            return call(*args, **kwargs)

        return counted

    def write(self, path: Path) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0)
        stacks = [[count, *stack] for stack, count in self.stacks.most_common()]
        path.write_text(json.dumps({"cpu_s": time.process_time(), "calls": self.calls, "stacks": stacks}))


class Profile:
    """What was sampled, read back. Seconds are the process's whole CPU time, shared out by the samples."""

    def __init__(self, found: Mapping[str, Any]) -> None:
        self.cpu_s: float = found["cpu_s"]
        self.calls: Mapping[str, int] = found["calls"]
        self.stacks: Sequence[tuple[int, Sequence[str]]] = [(each[0], each[1:]) for each in found["stacks"]]
        self._each_s = self.cpu_s / max(1, sum(count for count, _ in self.stacks))

    @classmethod
    def read(cls, path: Path) -> "Profile":
        return cls(json.loads(path.read_text()))

    def by_part(self, parts: Mapping[str, Sequence[str]]) -> dict[str, float]:
        """CPU seconds by the first of the parts of which a function on the stack begins so."""
        found = dict.fromkeys([*parts, OTHER], 0.0)
        for count, stack in self.stacks:
            found[self._part(stack, parts)] += count * self._each_s
        return found

    def inclusive(self, most: int) -> dict[str, float]:
        """CPU seconds of the functions that were on the stack most often, what they call included."""
        found: Counter[str] = Counter()
        for count, stack in self.stacks:
            found.update(dict.fromkeys(set(stack), count))
        return {name: count * self._each_s for name, count in found.most_common(most)}

    def own(self, most: int) -> dict[str, float]:
        """CPU seconds of the functions that were innermost most often."""
        found: Counter[str] = Counter()
        for count, stack in self.stacks:
            found[stack[-1]] += count
        return {name: count * self._each_s for name, count in found.most_common(most)}

    @staticmethod
    def _part(stack: Sequence[str], parts: Mapping[str, Sequence[str]]) -> str:
        for part, beginnings in parts.items():
            if any(function.startswith(tuple(beginnings)) for function in stack):
                return part
        return OTHER


def run_sampled(argv: Sequence[str]) -> None:
    path, module = Path(argv[0]), argv[1]
    samples = Samples()
    for place in COUNTED:
        samples.count(place)
    atexit.register(samples.write, path)
    samples.start()
    sys.argv = [module, *argv[2:]]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    run_sampled(sys.argv[1:])
