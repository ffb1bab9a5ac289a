"""How long a process takes to answer, without the time in which it, or the one that asks, could not run."""

import threading
import time
from collections import deque
from types import TracebackType
from typing import Final, Self

from campaigns.rigs.process_use import queued_s, tree
from robotapp_testbed import Process
from robotapp_testbed.control_plane.servers import answers

PULSE_S: Final = 0.05


class Pulse:
    """A thread that does nothing: while it comes late, this process or the whole machine stood still."""

    def __init__(self) -> None:
        self._late: deque[tuple[float, float]] = deque(maxlen=100_000)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pulse", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()

    def late_s(self, since_s: float) -> float:
        """Seconds by which it came too late since then (monotonic), all together."""
        return sum(late_s for at_s, late_s in list(self._late) if at_s >= since_s)

    def _run(self) -> None:
        before_s = time.monotonic()
        while not self._stop.wait(PULSE_S):
            now_s = time.monotonic()
            self._late.append((now_s, max(0.0, now_s - before_s - PULSE_S)))
            before_s = now_s


def ask(process: Process, pulse: Pulse) -> tuple[float, float]:
    """Seconds until /livez was answered (or refused, or given up), and for how many of them the process itself held it up."""
    pids = tree(process.pid)
    queued_before_s, began_s = queued_s(pids), time.monotonic()
    answers(f"{process.health_url}/livez")
    took_s = time.monotonic() - began_s
    return took_s, max(0.0, took_s - (queued_s(pids) - queued_before_s) - pulse.late_s(began_s))
