"""How far a simulation is: one line on a terminal, written over and gone in the end."""

import time
from collections.abc import Callable
from typing import Final, TextIO

EVERY_S: Final = 0.5
CLEAR: Final = "\r\x1b[K"


def replace_line(stream: TextIO, text: str = "") -> None:
    """Show on a terminal what is being done now, in place of the text before; nothing removes the line."""
    if stream.isatty():
        stream.write(f"{CLEAR}{text}")
        stream.flush()


class Progress:
    """Call it with (pods decided, pods that waited) as often as you like; a file or a pipe gets nothing."""

    def __init__(self, stream: TextIO, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._next_s = clock() + EVERY_S if stream.isatty() else float("inf")
        self._shown = False

    def __repr__(self) -> str:
        return f"Progress(shown={self._shown})"

    def __call__(self, decided: int, waiting: int) -> None:
        now_s = self._clock()
        if now_s < self._next_s:
            return
        self._next_s, self._shown = now_s + EVERY_S, True
        again = f", trying {decided - waiting} refused ones again" if decided > waiting else ""
        self._stream.write(f"{CLEAR}{min(decided, waiting)} of {waiting} pods decided{again}")
        self._stream.flush()

    def end(self) -> None:
        """Take the line away."""
        if self._shown:
            self._stream.write(CLEAR)
            self._stream.flush()
