"""The narrator of the demo: says what happens in one line per step and stops at the first claim that is false."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from rich.cells import cell_len
from rich.console import Console

T = TypeVar("T")


class FalseClaimError(AssertionError):
    """Something the demo says is not true on this run."""


@dataclass
class Stage:
    """Where the story is told; counts its steps, and what was claimed so that the last line can say so."""

    console: Console = field(default_factory=lambda: Console(highlight=False, soft_wrap=True, record=True))
    held: int = 0
    told: int = 0
    started_s: float = field(default_factory=time.monotonic)

    def save_svg(self, path: Path) -> None:
        """Everything said so far, as the picture that the README shows: wide enough for the longest line."""
        said = self.console.export_text(clear=False).splitlines()
        self.console.width = max(map(cell_len, said), default=self.console.width)
        path.write_text(self.console.export_svg(title="scripts/demo --once", unique_id="demo"))

    def step(self, title: str) -> None:
        self.told += 1
        self.console.print()
        self.console.rule(f"[bold]{self.told}  {title}", align="left")

    def say(self, text: str) -> None:
        self.console.print(text)

    def shell(self, command: str, output: str = "") -> None:
        """Show a command a user can repeat, and what it printed."""
        self.console.print(f"[cyan]$ {command}[/cyan]")
        if output.strip():
            self.console.print(output.rstrip(), markup=False)

    def claim(self, text: str, holds: bool, detail: str = "") -> None:
        """Print a checked statement; raise FalseClaimError with `detail` when it does not hold."""
        if not holds:
            self.console.print(f"[red]✗ {text}[/red]")
            raise FalseClaimError(f"{text}\n{detail}".rstrip())
        self.held += 1
        self.console.print(f"[green]✓[/green] {text}")

    def close(self) -> None:
        self.console.print()
        took_s = time.monotonic() - self.started_s
        self.console.rule(f"[bold green]The story holds: {self.held} claims checked in {took_s:.0f} s", align="left")

    @contextmanager
    def working(self, what: str) -> Iterator[None]:
        """Say what takes time, and how long it took when it was more than a moment."""
        began_s = time.monotonic()
        with self.console.status(what):
            yield
        took_s = time.monotonic() - began_s
        self.console.print(f"[dim]{what}: {took_s:.1f} s[/dim]")

    @contextmanager
    def waiting(self, what: str) -> Iterator[Callable[[str], None]]:
        """On a terminal say what is waited for, in a line that goes when it is over; it may be told how far it is."""
        with self.console.status(what) as line:
            yield line.update


def wait_for(what: str, probe: Callable[[], T | None], *, within_s: float, every_s: float = 0.02) -> tuple[T, float]:
    """Poll until `probe` returns something true; the value and the seconds it took. Raise FalseClaimError at the deadline."""
    began_s = time.monotonic()
    while True:
        value = probe()
        now_s = time.monotonic()
        if value:
            return value, now_s - began_s
        if now_s - began_s > within_s:
            raise FalseClaimError(f"{what}: not within {within_s:g} s")
        time.sleep(every_s)
