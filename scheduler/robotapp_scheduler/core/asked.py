"""A question to a plugin of somebody else's, as whoever keeps watch over the process hears of it."""

from collections.abc import Callable
from contextlib import AbstractContextManager

from robotapp_scheduler.core.pods import PodInfo

Asking = Callable[[str, str, PodInfo], AbstractContextManager[object]]
"""(plugin, hook, pod): held while the plugin is asked. Raises PluginError instead when it must not be."""
