"""Shadow plugins: asked like any other, believed never, and harmless when they break."""

import logging
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from robotapp_scheduler.core.framework import Loaded, PerDomain, Scores, checked_scores

log = logging.getLogger(__name__)

_SILENT: Final[dict[str, Any]] = {"filter": None, "score": None, "score_among": None, "relevant": False}
"""Hooks that are asked, and what stands for "no opinion"."""
_UNUSED: Final = ("narrows", "score_row", "filter_row", "minds", "confined", "touched_by", "beside")
"""Short cuts that would have to be guarded one by one; without them the vector form is asked."""


def guard(loaded: Loaded) -> Loaded:
    """An exception or an answer of the wrong shape becomes "no opinion": an experiment must not hold a pod back."""
    for name, otherwise in _SILENT.items():
        hook = getattr(loaded, name)
        if hook is not None:
            setattr(loaded, name, _guarded(loaded.name, name, hook, otherwise))
    for name in _UNUSED:
        setattr(loaded, name, None)
    return loaded


def _guarded(plugin: str, name: str, hook: Callable[..., Any], otherwise: Any) -> Callable[..., Any]:
    def asked(*args: Any) -> Any:
        try:
            answer = hook(*args)
            if name == "score" and isinstance(answer, PerDomain):
                checked_scores(plugin, answer.values, len(answer.label.vocabulary.values))
            elif name == "score" and isinstance(answer, np.ndarray | Scores):
                checked_scores(plugin, answer.raw if isinstance(answer, Scores) else answer, args[1].n)
        except Exception:  # somebody else's code, tried out on pods that must be placed; the log has the stack
            log.exception("shadow plugin %s failed", plugin)
            return otherwise
        return answer

    return asked
