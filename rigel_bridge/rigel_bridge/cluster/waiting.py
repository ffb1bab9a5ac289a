"""Wait for what a cluster does, by looking at growing intervals. Clock and sleep are passed in."""

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from rigel_bridge.cluster import apps
from rigel_bridge.cluster.kubectl import ClusterError, Kubectl
from rigel_bridge.document.failures import Exit

_FIRST_S: Final = 0.2
_LONGEST_S: Final = 2.0
_DURATION: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]{1,3})?)(ms|s|m|h)?")
_UNITS_S: Final = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, None: 1.0}
_DAY_S: Final = 24 * 3600.0


def duration_s(text: str) -> float | None:
    """Seconds of 120s, 2m, 500ms or a bare number; None for anything else, and for more than a day."""
    found = _DURATION.fullmatch(text)
    seconds = float(found[1]) * _UNITS_S[found[2]] if found else _DAY_S + 1
    return seconds if seconds <= _DAY_S else None


@dataclass(frozen=True, slots=True)
class Clock:
    """Monotonic seconds, and sleeping."""

    now_s: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep

    def until(self, look: Callable[[], bool], *, timeout_s: float) -> bool:
        """Whether `look` came true in time; it is called at least once."""
        deadline_s, pause_s = self.now_s() + timeout_s, _FIRST_S
        while not look():
            left_s = deadline_s - self.now_s()
            if left_s <= 0:
                return False
            self.sleep(min(pause_s, left_s))
            pause_s = min(pause_s * 1.5, _LONGEST_S)
        return True


def condition(app: Mapping[str, Any], kind: str) -> Mapping[str, Any]:
    """A condition as it is for the present generation; status Unknown while it is about an earlier one, or absent."""
    for found in app.get("status", {}).get("conditions", ()):
        if found["type"] == kind and found.get("observedGeneration", 0) >= app["metadata"]["generation"]:
            current: Mapping[str, Any] = found
            return current
    return {"type": kind, "status": "Unknown", "reason": "Pending", "message": "the operator has not looked yet"}


def wait_ready(
    kubectl: Kubectl, name: str, *, timeout_s: float, clock: Clock, tell: Callable[[str], None]
) -> dict[str, Any]:
    """The app once it is Ready. ClusterError (NOT_READY) with its words when it is refused, or not ready in time."""
    said = ""
    app: dict[str, Any] = {}

    def ready() -> bool:
        nonlocal app, said
        app = apps.existing(kubectl, name)
        accepted, state = condition(app, "Accepted"), condition(app, "Ready")
        if accepted["status"] == "False":
            raise ClusterError(f"RobotApp {name} is not accepted: {_words(accepted)}", code=Exit.NOT_READY)
        if (now := _words(state)) != said and state["status"] != "True":
            said = now
            tell(f"{name}: {now}")
        return bool(state["status"] == "True")

    if not clock.until(ready, timeout_s=timeout_s):
        raise ClusterError(
            f"RobotApp {name} is not Ready within {timeout_s:g} s: {said}; `kubectl robotapp explain {name}` shows why",
            code=Exit.NOT_READY,
        )
    return app


def _words(condition: Mapping[str, Any]) -> str:
    return ": ".join(text for text in (condition.get("reason", ""), condition.get("message", "")) if text)
