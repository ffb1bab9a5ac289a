"""Shadow plugins: called as any other, without effect on decisions, and harmless when they fail."""

import logging
from collections.abc import Callable
from typing import Any, Final

from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin

log = logging.getLogger(__name__)

_SILENT: Final[dict[str, Any]] = {"filter": None, "score": None, "score_among": None, "relevant": False}
"""Hooks that are asked, and what stands for "no opinion"."""
_UNUSED: Final = ("narrows", "score_row", "filter_row", "minds", "confined", "touched_by", "beside")
"""Short cuts that would have to be guarded one by one; without them the vector form is asked."""


def silenced(loaded: RegisteredPlugin) -> RegisteredPlugin:
    """A `guarded` plugin whose PluginErrors become "no opinion": an experiment must not hold a pod back."""
    for name, otherwise in _SILENT.items():
        hook = getattr(loaded, name)
        if hook is not None:
            setattr(loaded, name, _silent(loaded.name, hook, otherwise))
    for name in _UNUSED:
        setattr(loaded, name, None)
    return loaded


def _silent(plugin: str, hook: Callable[..., Any], otherwise: Any) -> Callable[..., Any]:
    def asked(*args: Any) -> Any:
        try:
            return hook(*args)
        except PluginError as error:
            log.warning("shadow plugin %s has no opinion: %s", plugin, error)
            return otherwise

    return asked
