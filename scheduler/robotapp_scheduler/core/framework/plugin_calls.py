"""The context in which a third-party plugin is called, and the exception that ends a call without return."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Final

from robotapp_scheduler.core.pods.pod_info import PodInfo

Asking = Callable[[str, str, PodInfo], AbstractContextManager[object]]
"""(plugin, hook, pod): held while the plugin is asked. Raises PluginError instead when it must not be."""
_UNWATCHED: Final = nullcontext()


def asking(vigil: Asking | None, plugin: str, hook: str, pod: PodInfo) -> AbstractContextManager[object]:
    """To be held while the plugin is asked. Raises PluginError when it must not be."""
    return _UNWATCHED if vigil is None else vigil(plugin, hook, pod)


class Overdue(BaseException):
    """Raised inside a hook that does not come back (shell.process.watchdog). No `except Exception` of the plugin's stops it."""
