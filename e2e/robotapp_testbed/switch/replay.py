"""Replay a trace: apply its steps to a switch when their time has come."""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from robotapp_testbed.switch.control import Control
from robotapp_testbed.switch.traces import Step, Trace, TraceError


class Replay:
    """`with Replay(trace, switch) as replay:` replays in a thread until the trace or the block ends.

    `applied` is the number of steps done, `latest_s` how late the latest-applied of them was at worst.
    `told` is called after each step. `wait(seconds)` tells whether the replay was stopped meanwhile; it and `clock` are replaced
    in tests. A trace with nodes the switch does not know is a TraceError at the beginning of the block; an error of the switch ends
    the replay and is raised at the end of the block.
    """

    def __init__(
        self,
        trace: Trace,
        control: Control,
        *,
        told: Callable[[Step], None] = lambda _: None,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], bool] | None = None,
    ) -> None:
        self.applied = 0
        self.latest_s = 0.0
        self._trace = trace
        self._control = control
        self._told = told
        self._clock = clock
        self._stopped = threading.Event()
        self._wait = wait or self._stopped.wait
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._keep, name="switch-replay", daemon=True)

    def __repr__(self) -> str:
        return f"<Replay {self.applied} steps applied, at most {self.latest_s * 1000:.1f} ms late>"

    def __enter__(self) -> Self:
        known = self._control.known()
        unknown = sorted(self._trace.nodes() - set(known))
        if unknown:
            raise TraceError("steps", f"there is no node {' or '.join(unknown)}; the switch knows {', '.join(known)}")
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self.join()

    def join(self) -> None:
        """Wait for the end of the trace, or of the block."""
        self._thread.join()
        if self._error:
            raise self._error

    def run(self) -> None:
        """All steps, in this thread."""
        began_s = self._clock()
        while step := self._trace.step(self.applied):
            ahead_s = began_s + step.at_s - self._clock()
            if ahead_s > 0 and self._wait(ahead_s):
                return
            self._control.apply(step.changes)
            self.latest_s = max(self.latest_s, self._clock() - began_s - step.at_s)
            self.applied += 1
            self._told(step)

    def _keep(self) -> None:
        try:
            self.run()
        except Exception as error:  # noqa: BLE001 - raised again in the thread that asked (join)
            self._error = error
