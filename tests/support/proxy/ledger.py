"""Every write that passed the proxy, in order."""

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

from tests.support.proxy.calls import Call


class Moment(StrEnum):
    BEFORE = "before"
    AFTER = "after"


@dataclass(slots=True)
class Write:
    """One write. `index` counts a component's writes from 1 without events and leases, which have 0.

    `status` is the server's own answer: 0 until there is one, and for ever when the request never reached it.
    `answered` is what the client was told: 0 for nothing.
    """

    call: Call
    index: int
    at_s: float
    fault: str = ""
    status: int = 0
    answered: int = 0

    @property
    def applied(self) -> bool:
        return 200 <= self.status < 300

    def __str__(self) -> str:
        return f"#{self.index} {self.call} -> {self.status or 'not sent'}{f' ({self.fault})' if self.fault else ''}"


@dataclass(slots=True)
class Ledger:
    """Append-only; safe to read from any thread."""

    _writes: list[Write] = field(default_factory=list)
    _indices: Counter[str] = field(default_factory=Counter)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def enter(self, call: Call) -> Write:
        with self._lock:
            if not call.is_routine:
                self._indices[call.component] += 1
            index = 0 if call.is_routine else self._indices[call.component]
            write = Write(call, index, time.monotonic())
            self._writes.append(write)
            return write

    def writes(
        self,
        *,
        component: str = "",
        verb: str = "",
        resource: str = "",
        applied: bool | None = None,
        routine: bool = False,
        when: Callable[[Write], bool] | None = None,
    ) -> list[Write]:
        """Those that match; events and leases only with `routine`."""
        with self._lock:
            writes = list(self._writes)
        return [
            write
            for write in writes
            if (not component or write.call.component == component)
            and (not verb or write.call.verb == verb)
            and (not resource or write.call.resource == resource)
            and (applied is None or write.applied == applied)
            and (routine or not write.call.is_routine)
            and (when is None or when(write))
        ]

    def reset(self) -> None:
        """Forget everything and count from 1 again: between two runs of a campaign on one proxy."""
        with self._lock:
            self._writes.clear()
            self._indices.clear()
