"""Logs what blocks the event loop, and interrupts a third-party plugin that does not return.

While the loop turns an alarm is put off once a second, so it never rings. When it rings, its handler runs in the one
thread there is, in the middle of what holds the loop: it sees which hook is asked about which pod, and may raise there.
It does so only between two lines of the plugin: what is ours is never left half done.

A hook that swallows even that, again and again, cannot be ended without the process: that ends, and says why.
What never returns to Python (a regular expression without end) hears no alarm. Then the interpreter writes the stack on
its own, and the process is ended from outside: nobody answers the liveness probe any more.
"""

import asyncio
import faulthandler
import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any, Final, NamedTuple

from robotapp_scheduler.core.framework.plugin_calls import Overdue
from robotapp_scheduler.core.pods.pod_info import PodInfo

log = logging.getLogger(__name__)

BEAT_S: Final = 1.0
PATIENCE_S: Final = 4.0
"""Shorter than a lease is renewed in (10 s): a leader that asked such a plugin still leads."""
AGAIN_S: Final = 1.0
"""The alarm rings on. Only what holds the loop for that long more is told: we may have been stopped ourselves."""
MOST_SWALLOWED: Final = 3
"""How often a hook is broken off in vain before the process ends."""
DUMP_S: Final = 30.0
DUMP_BEATS: Final = 5
OURS: Final = frozenset({"robotapp_scheduler", "robotapp_api"})


class PluginCall(NamedTuple):
    """A hook of a plugin that has not answered yet."""

    plugin: str
    hook: str
    pod: PodInfo | None

    @property
    def about(self) -> str:
        """Which pod, for a sentence."""
        return f" about pod {self.pod.key}" if self.pod is not None else ""


ASKING: Final[Mapping[tuple[str, str], Callable[[Mapping[str, Any]], PluginCall]]] = {
    ("robotapp_scheduler.core.framework.third_party", "asked"): lambda known: PluginCall(
        known["plugin"], known["hook"], next((each for each in known["args"] if isinstance(each, PodInfo)), None)
    ),
    ("robotapp_scheduler.core.framework.queueing_hint", "wants"): lambda known: PluginCall(
        known["self"].plugin, "hint", known["pod"]
    ),
    ("robotapp_scheduler.shell.binding.extension_points", "_ask"): lambda known: PluginCall(
        known["loaded"].name, known["hook"], known["pod"]
    ),
}
"""Functions that ask a plugin and bear whatever it raises, with whom they ask about what."""

LastWords = Callable[[str, str, PodInfo], None]
"""Told plugin, hook and pod, quickly."""


class Watchdog:
    """`run` it in the loop that is to be watched, in the main thread: nowhere else are alarms heard."""

    def __init__(
        self,
        *,
        patience_s: float = PATIENCE_S,
        again_s: float = AGAIN_S,
        end: Callable[[int], object] = os._exit,
        last_words: LastWords | None = None,
    ) -> None:
        """`last_words` is told why, before the process ends."""
        self._patience_s = patience_s
        self._again_s = again_s
        self._end = end
        self._last_words = last_words
        self._raised = 0
        """How often in the call that `_held` is."""
        self._held: FrameType | None = None
        """Who asked the plugin when the alarm rang last."""
        self._rung = 0

    def __repr__(self) -> str:
        return f"<Watchdog, {self._rung} alarms since the loop turned>"

    async def run(self) -> None:
        """Watch until cancelled."""
        if threading.current_thread() is not threading.main_thread():
            return
        former = signal.signal(signal.SIGALRM, self._rang)
        before = signal.getitimer(signal.ITIMER_REAL)
        beats = 0
        try:
            while True:
                self._rung, self._raised, self._held = 0, 0, None
                signal.setitimer(signal.ITIMER_REAL, self._patience_s, self._again_s)
                if beats % DUMP_BEATS == 0 and sys.__stderr__ is not None:
                    faulthandler.dump_traceback_later(DUMP_S, file=sys.__stderr__)
                beats += 1
                await asyncio.sleep(BEAT_S)
        finally:
            faulthandler.cancel_dump_traceback_later()
            signal.setitimer(signal.ITIMER_REAL, *before)
            signal.signal(signal.SIGALRM, former)

    def _rang(self, _signal: int, frame: FrameType | None) -> None:
        asking = _asking(frame)
        same = asking is not None and asking is self._held
        self._rung += 1
        self._held = asking
        if self._rung < 2 or frame is None:
            return
        waited_s = self._patience_s + self._again_s * (self._rung - 1)
        asked = _asked(asking)
        if self._rung == 2:
            log.error("%s\n%s", _told(asked, frame, waited_s), "".join(traceback.format_stack(frame)))
        self._raised = self._raised if same else 0
        if same and asked is not None:
            if self._raised == MOST_SWALLOWED:
                self._give_up(asked)
            self._raised += 1
            raise Overdue(f"did not answer within {waited_s:g} s and was broken off")

    def _give_up(self, asked: PluginCall) -> None:
        """`sys.exit` would be swallowed too. Whoever leads next meets the same pod; `last_words` may spare us that."""
        log.critical(
            "%s of plugin %s cannot be broken off%s, it catches BaseException: the process ends. Take the plugin out of the "
            "configuration%s",
            *(asked.hook, asked.plugin, asked.about, ", or delete the pod" if asked.pod is not None else ""),
        )
        if self._last_words is not None and asked.pod is not None:
            self._last_words(asked.plugin, asked.hook, asked.pod)
        self._end(os.EX_SOFTWARE)


def _asking(frame: FrameType | None) -> FrameType | None:
    """The call that waits for a plugin, when the line being run is the plugin's or of what it called, and none of ours."""
    inner = frame
    while frame is not None and not _ours(frame):
        frame = frame.f_back
    return frame if frame is not inner and frame is not None and _place(frame) in ASKING else None


def _asked(asking: FrameType | None) -> PluginCall | None:
    return None if asking is None else ASKING[_place(asking)](asking.f_locals)


def _told(asked: PluginCall | None, frame: FrameType, waited_s: float) -> str:
    if asked is not None:
        return (
            f"{asked.hook} of plugin {asked.plugin} has not answered for {waited_s:g} s{asked.about}: it is broken off"
        )
    pod = _pod(frame)
    about = f" with pod {pod}" if pod else ""
    return f"nothing was decided for {waited_s:g} s{about}: the event loop is held here"


def _pod(frame: FrameType | None) -> str:
    """The pod somebody on the stack is at work with."""
    while frame is not None:
        pod = frame.f_locals.get("pod")
        if isinstance(pod, PodInfo):
            return pod.key
        frame = frame.f_back
    return ""


def _ours(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__", "")).partition(".")[0] in OURS


def _place(frame: FrameType) -> tuple[str, str]:
    return str(frame.f_globals.get("__name__", "")), frame.f_code.co_name
