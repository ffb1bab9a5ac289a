"""Say what is being done and how long it will still take: a bar on a terminal, plain lines elsewhere."""

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

from robotapp_testbed import estimate

_BAR_CELLS = 24
_REDRAW_S = 0.25
_LINE_EVERY_S = 20.0
_NOTE_CHARACTERS = 40


class Progress:
    """Steps with an expected duration. What finished steps really took corrects the expectation of the rest."""

    def __init__(
        self,
        stream: TextIO | None = None,
        *,
        interactive: bool | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._stream = stream or sys.stderr
        self._interactive = self._stream.isatty() if interactive is None else interactive
        self._clock = clock
        self._plan: list[tuple[str, float]] = []
        self._index = 0
        self._finished_expected_s = 0.0
        self._finished_took_s = 0.0
        self._started_s = 0.0
        self._said_s = 0.0
        self._note = ""
        self._write_lock = threading.Lock()

    def say(self, text: str) -> None:
        with self._write_lock:
            self._stream.write(f"{self._erase()}{text}\n")
            self._stream.flush()

    def plan(self, steps: Sequence[tuple[str, float]]) -> None:
        """The steps to come, each with the seconds it should take on this machine."""
        self._plan, self._index = list(steps), 0
        self._finished_expected_s = self._finished_took_s = 0.0

    @contextmanager
    def step(self, title: str) -> Iterator[Callable[[str], None]]:
        """Run the planned step `title` (steps before it that did not run are passed over).

        Yields a function that takes a note on what is happening just now. A step that raises leaves it to the caller
        to say what happened.
        """
        self._index = [planned for planned, _ in self._plan].index(title)
        self._started_s = self._said_s = self._clock()
        self._note = ""
        if not self._interactive:
            self.say(f"{self._prefix()} {title}: {estimate.describe_remaining(self._standing())}")
        with self._ticking():
            yield self._take_note
        took_s = self._elapsed_s()
        self._finished_took_s += took_s
        self._finished_expected_s += self._plan[self._index][1]
        self.say(f"{self._prefix()} {title}: done in {took_s:.0f} s")

    @contextmanager
    def _ticking(self) -> Iterator[None]:
        finished = threading.Event()
        ticker = threading.Thread(target=self._tick, args=(finished,), name="testbed-progress", daemon=True)
        ticker.start()
        try:
            yield
        finally:
            finished.set()
            ticker.join()

    def remaining_s(self) -> float:
        """Expected seconds until the last planned step ends."""
        return estimate.predict_remaining_s(self._standing())

    def _standing(self) -> estimate.Standing:
        return estimate.Standing(
            finished_expected_s=self._finished_expected_s,
            finished_took_s=self._finished_took_s,
            running_expected_s=self._plan[self._index][1],
            running_s=self._elapsed_s(),
            ahead_expected_s=sum(expected_s for _, expected_s in self._plan[self._index + 1 :]),
        )

    def _elapsed_s(self) -> float:
        return self._clock() - self._started_s

    def _take_note(self, text: str) -> None:
        self._note = text

    def _tick(self, finished: threading.Event) -> None:
        while not finished.wait(_REDRAW_S):
            self.redraw()

    def redraw(self) -> None:
        if self._interactive:
            with self._write_lock:
                self._stream.write(f"{self._erase()}{self._bar()}")
                self._stream.flush()
        elif self._clock() - self._said_s >= _LINE_EVERY_S:
            self._said_s = self._clock()
            self.say(self._line())

    def _prefix(self) -> str:
        return f"[{self._index + 1}/{len(self._plan)}]"

    def _line(self) -> str:
        """Names the running step and what it works on, so that a long one explains itself."""
        standing = self._standing()
        running_text = "" if estimate.is_late(standing) else f"{standing.running_s:.0f} s, "
        note = f" ({self._note})" if self._note else ""
        return f"{self._prefix()} {self._plan[self._index][0]}: {running_text}{estimate.describe_remaining(standing)}{note}"

    def _bar(self) -> str:
        title, standing = self._plan[self._index][0], self._standing()
        expected_s = estimate.predict_running_s(standing)
        share = min(standing.running_s / expected_s, 1.0) if expected_s else 1.0
        cells = "█" * round(share * _BAR_CELLS)
        remaining = estimate.describe_remaining(standing)
        return f"{self._prefix()} {title} {cells:░<{_BAR_CELLS}} {remaining} {self._note[:_NOTE_CHARACTERS]}"

    def _erase(self) -> str:
        return "\r\x1b[2K" if self._interactive else ""
