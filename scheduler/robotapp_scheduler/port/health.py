"""Liveness and readiness, as the process that places pods sees them; everybody may ask.

`/livez` says the event loop turns and leadership is renewed; `/readyz` names what is still missing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(slots=True)
class Checks:
    """Every one is asked at request time."""

    ready: dict[str, Callable[[], bool]] = field(default_factory=dict)
    live: dict[str, Callable[[], bool]] = field(default_factory=dict)

    def livez(self) -> tuple[int, bytes]:
        """HTTP status and text."""
        return _checked(self.live)

    def readyz(self) -> tuple[int, bytes]:
        return _checked(self.ready | self.live)


def _checked(checks: Mapping[str, Callable[[], bool]]) -> tuple[int, bytes]:
    missing = sorted(name for name, check in checks.items() if not check())
    return (503, "".join(f"[-]{name} failed\n" for name in missing).encode()) if missing else (200, b"ok")
