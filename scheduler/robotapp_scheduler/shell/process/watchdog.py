"""Logs what blocks the event loop, and interrupts a third-party plugin that does not return.

While the loop turns, an alarm signal is postponed once a second. When it fires, its handler runs in the main thread, in the
middle of what blocks the loop. The caller of a plugin has noted the hook and the pod (core.framework.plugin_calls), so the handler
knows them and may raise Overdue there. It raises only while a line of the plugin runs: code of ours is never interrupted.

A hook that catches even that, again and again, can only be ended with the process, which logs the reason and exits.
A call that never returns to Python (an endless regular expression) runs no signal handler. Then faulthandler writes the stack,
and the kubelet ends the process, because the liveness probe fails.
"""

import asyncio
import faulthandler
import logging
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from types import FrameType
from typing import Final

from robotapp_scheduler.core.framework.plugin_calls import Overdue, PluginCall, running_call
from robotapp_scheduler.core.pods.pod_info import PodInfo

log = logging.getLogger(__name__)

BEAT_S: Final = 1.0
PATIENCE_S: Final = 4.0
"""Shorter than the renew deadline of the lease (10 s), so that the process still leads after such a call."""
AGAIN_S: Final = 1.0
"""Interval of further alarms. The first one alone reports nothing, because the process itself may have been stopped."""
MOST_SWALLOWED: Final = 3
"""How often a hook is interrupted in vain before the process ends."""
DUMP_S: Final = 30.0
DUMP_BEATS: Final = 5
OURS: Final = frozenset({"robotapp_scheduler", "robotapp_api", "robotapp_client", "robotapp_claims"})


LastWords = Callable[[str, str, PodInfo], None]
"""Called with plugin, hook and pod; must return quickly."""


class Watchdog:
    """`run` it in the event loop that is to be watched, in the main thread: signal handlers run nowhere else."""

    def __init__(
        self,
        *,
        patience_s: float = PATIENCE_S,
        again_s: float = AGAIN_S,
        end: Callable[[int], object] = os._exit,
        last_words: LastWords | None = None,
        deciding: Callable[[], PodInfo | None] = lambda: None,
    ) -> None:
        """`last_words` is called before the process ends. `deciding` returns the pod that is being scheduled, if any."""
        self._patience_s = patience_s
        self._again_s = again_s
        self._end = end
        self._last_words = last_words
        self._deciding = deciding
        self._raised = 0
        """How often in the call that `_held` is."""
        self._held: PluginCall | None = None
        """The call of a plugin that ran when the alarm rang last."""
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
        call = _running(frame)
        same = call is not None and call is self._held
        self._rung += 1
        self._held = call
        if self._rung < 2 or frame is None:
            return
        waited_s = self._patience_s + self._again_s * (self._rung - 1)
        if self._rung == 2:
            log.error("%s\n%s", self._told(call, waited_s), "".join(traceback.format_stack(frame)))
        self._raised = self._raised if same else 0
        if same and call is not None:
            if self._raised == MOST_SWALLOWED:
                self._give_up(call)
            self._raised += 1
            raise Overdue(f"did not answer within {waited_s:g} s and was broken off")

    def _told(self, call: PluginCall | None, waited_s: float) -> str:
        if call is not None:
            return (
                f"{call.hook} of plugin {call.plugin} has not answered for {waited_s:g} s{call.about}: it is broken off"
            )
        pod = self._deciding()
        about = f" with pod {pod.key}" if pod is not None else ""
        return f"nothing was decided for {waited_s:g} s{about}: the event loop is held here"

    def _give_up(self, call: PluginCall) -> None:
        """`sys.exit` would be swallowed too. The next leader meets the same pod; what `last_words` records may spare it that."""
        log.critical(
            "%s of plugin %s cannot be broken off%s, it catches BaseException: the process ends. Take the plugin out of the "
            "configuration%s",
            *(call.hook, call.plugin, call.about, ", or delete the pod" if call.pod is not None else ""),
        )
        if self._last_words is not None and call.pod is not None:
            self._last_words(call.plugin, call.hook, call.pod)
        self._end(os.EX_SOFTWARE)


def _running(frame: FrameType | None) -> PluginCall | None:
    """The call of a plugin under way, when the line that runs is the plugin's or of code that it called, and not ours."""
    call, inner = running_call(), frame
    if call is None:
        return None
    while frame is not None and not _ours(frame):
        frame = frame.f_back
    return call if frame is not inner and frame is call.frame else None


def _ours(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__", "")).partition(".")[0] in OURS
