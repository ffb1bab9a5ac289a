"""The call of a third-party plugin that is running, noted by the caller, and the exception that ends a call without return."""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from contextvars import ContextVar, Token
from types import FrameType, TracebackType
from typing import Final, Self

from robotapp_scheduler.core.pods.pod_info import PodInfo

CallJournal = Callable[[str, str, PodInfo], AbstractContextManager[object]]
"""(plugin, hook, pod): held during the call. Raises PluginError instead when the call must not be made."""


class PluginCall:
    """One call of a hook: `with PluginCall(…): result = hook(…)`. Until it ends, `running_call` returns it in the same task or thread.

    `journal` is entered around the call and may refuse it with a PluginError.
    """

    __slots__ = ("_before", "_journal", "frame", "hook", "plugin", "pod")

    def __init__(self, plugin: str, hook: str, pod: PodInfo | None, journal: CallJournal | None = None) -> None:
        self.plugin = plugin
        self.hook = hook
        self.pod = pod
        self.frame: FrameType | None = None
        """The frame of the function that calls the hook."""
        self._journal = None if journal is None or pod is None else journal(plugin, hook, pod)
        self._before: Token[PluginCall | None] | None = None

    def __repr__(self) -> str:
        return f"<PluginCall {self.hook} of {self.plugin}{self.about}>"

    @property
    def about(self) -> str:
        """The pod, for a sentence; empty for a function that gets none."""
        return f" about pod {self.pod.key}" if self.pod is not None else ""

    def __enter__(self) -> Self:
        if self._journal is not None:
            self._journal.__enter__()
        self.frame = sys._getframe(1)  # noqa: SLF001 - documented; a stack walk by `inspect` takes a hundred times as long
        self._before = _RUNNING.set(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._before is not None:
            _RUNNING.reset(self._before)
        self.frame = None  # its locals refer to this object
        if self._journal is not None:
            self._journal.__exit__(kind, error, trace)


_RUNNING: Final[ContextVar[PluginCall | None]] = ContextVar("running plugin call", default=None)
"""A context variable, because `async` hooks of several pods are awaited at the same time."""


def running_call() -> PluginCall | None:
    """The innermost call of a plugin in this task or thread that has not ended."""
    return _RUNNING.get()


class Overdue(BaseException):
    """Raised inside a hook that does not return (shell.process.watchdog). `except Exception` in the plugin does not catch it."""
