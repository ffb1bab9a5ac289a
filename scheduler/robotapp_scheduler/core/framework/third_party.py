"""Guards the hooks of third-party plugins: an exception or an unusable result becomes a `PluginError` that names the plugin.

Built-in plugins are trusted and called directly. A PluginError fails the one pod (SchedulerError); it must never end the
event loop, a watch or a command of the user. The shape of every result is checked before it is used.

`silenced` is for shadow plugins: called as any other, without effect on decisions, and harmless when they fail.
"""

import logging
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.api.core_v1 import Node
from robotapp_scheduler.core.cache.snapshot import LabelColumn
from robotapp_scheduler.core.events.cluster_event import interest_of
from robotapp_scheduler.core.framework.incremental import Beside
from robotapp_scheduler.core.framework.interface import (
    MAX_SCORE,
    Code,
    PerDomain,
    PluginError,
    PreFilter,
    Scores,
    Status,
    Verdict,
)
from robotapp_scheduler.core.framework.plugin_calls import Overdue, PluginCall
from robotapp_scheduler.core.framework.plugin_results import NORMALIZERS, checked_scores
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.framework.validation import misread
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan

log = logging.getLogger(__name__)

OURS: Final = "robotapp_scheduler"
EXACT: Final = 1 << 56
"""Integers beyond are scored as floats: a hundred times as much must not overflow."""
_SHORT_CUTS: Final = ("filter_row", "score_row", "room")
"""Not called when a third-party plugin inherits them from a built-in one: its own `filter` or `score` may decide otherwise."""


def is_ours(plugin: object) -> bool:
    """Whether the plugin's class is part of this program."""
    return _made_here(type(plugin))


def _made_here(made: object) -> bool:
    """`is_ours` of a class or a function."""
    return str(getattr(made, "__module__", "")).partition(".")[0] == OURS


def guarded(loaded: RegisteredPlugin) -> RegisteredPlugin:
    """The same plugin, every hook of which is guarded."""
    problems = misread(loaded.plugin, _made_here)
    if problems:
        raise PluginError(loaded.name, "; ".join(problems))
    loaded.sound = False  # it may have inherited that from one of ours
    for hook in _SHORT_CUTS:
        if _made_here(getattr(loaded, hook)):
            setattr(loaded, hook, None)
    for fact in getattr(loaded.plugin, "node_reads", ()):
        if isinstance(fact, NodeFact) and not _made_here(fact.derive):
            fact.of = _derived(loaded.name, fact)
    for hook, check in _CHECKS.items():
        function = getattr(loaded, hook)
        if function is not None:
            strict = hook == "score_row" and loaded.normalize == "none"
            setattr(loaded, hook, _watched(loaded, hook, function, _row_percent if strict else check))
    if loaded.pre_enqueue is not None:
        loaded.pre_enqueue = _held_when_broken(loaded, loaded.pre_enqueue)
    if loaded.queue_key is not None:
        loaded.queue_key = _ordered(loaded, loaded.queue_key)
    if loaded.queueing_hint.hint is not None:
        loaded.queueing_hint = loaded.queueing_hint._replace(hint=_yes_when_broken(loaded, loaded.queueing_hint.hint))
    return loaded


def _watched(loaded: RegisteredPlugin, hook: str, function: Callable[..., Any], check: "_Check") -> Callable[..., Any]:
    plugin = loaded.name

    def guard(*args: Any) -> Any:
        try:
            with PluginCall(plugin, hook, args[0], loaded.journal):
                return check(plugin, hook, function(*args), *args)
        except (PluginError, KeyboardInterrupt):
            raise
        except Overdue as error:  # the watchdog has logged the line
            raise PluginError(plugin, f"{hook} {error}") from error
        except BaseException as error:  # third-party code, sys.exit included: only its pod fails, with the reason
            log.exception("%s of plugin %s failed", hook, plugin)
            raise PluginError(plugin, f"{hook} raised {type(error).__name__}: {error}") from error

    return guard


def _derived(plugin: str, fact: NodeFact) -> Callable[[Node], float]:
    """The function of a third-party NodeFact. An exception or a call without return is a PluginError: the node gets `absent`."""
    hook = f"the fact {fact.name!r}"

    def derived(node: Node) -> float:
        try:
            with PluginCall(plugin, hook, None):
                return fact.derive(node)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # as in `_watched`
            raise PluginError(plugin, f"{hook} raised {type(error).__name__}: {error}") from error

    return derived


def _held_when_broken(loaded: RegisteredPlugin, function: Callable[..., Any]) -> Callable[..., Status | None]:
    """`pre_enqueue` that keeps a pod out of the queue when it fails: the pod may be one that it is there to hold."""
    watched = _watched(loaded, "pre_enqueue", function, _status)

    def guard(*args: Any) -> Status | None:
        try:
            answer: Status | None = watched(*args)
        except PluginError as error:
            return Status(Code.ERROR, str(error))
        return answer

    return guard


def _yes_when_broken(loaded: RegisteredPlugin, function: Callable[..., Any]) -> Callable[..., bool]:
    """`hint` that returns True when it fails: the pod must not wait for ever."""
    watched = _watched(loaded, "hint", function, _truth)

    def guard(*args: Any) -> bool:
        try:
            return bool(watched(*args))
        except PluginError:
            return True

    return guard


def _ordered(loaded: RegisteredPlugin, function: Callable[..., Any]) -> Callable[..., tuple[Any, ...]]:
    """`queue_key` with keys that can always be compared; pods for which it fails come last, by priority and time."""
    plugin, watched = loaded.name, _watched(loaded, "queue_key", function, _untouched)

    def key(pod: Any, queued_s: float) -> tuple[Any, ...]:
        try:
            answer = watched(pod, queued_s)
            return (0, *(_comparable(plugin, part) for part in answer))
        except (PluginError, TypeError) as error:
            log.warning("queue_key of plugin %s for %s: %s", plugin, pod.key, error)
            return (1, (0, -pod.priority), (0, queued_s))

    return key


def _comparable(plugin: str, part: object) -> tuple[int, Any]:
    if isinstance(part, bool | int | float | np.integer | np.floating) and part == part:  # noqa: PLR0124 - NaN is not
        return 0, part
    if isinstance(part, str):
        return 1, part
    raise PluginError(plugin, f"queue_key must answer a tuple of numbers and texts, got {part!r} in it")


# --- Checks of results ------------------------------------------------------------------------------------------------

_Check = Callable[..., Any]


def _untouched(_plugin: str, _hook: str, answer: object, *_args: Any) -> object:
    return answer


def _truth(_plugin: str, _hook: str, answer: object, *_args: Any) -> bool:
    return bool(answer)


def _facts(plugin: str, hook: str, answer: Any, *_args: Any) -> object:
    try:
        interest_of(answer)
    except (KeyError, TypeError, AttributeError) as error:
        raise PluginError(plugin, f"{hook} must answer names of facts of nodes, got {answer!r}") from error
    return answer


def odd_status(answer: object) -> str:
    """Why a value cannot be used as a Status; "" when it can."""
    if not isinstance(answer, Status):
        return type(answer).__name__
    code: object = answer.code
    reason: object = answer.reason
    if not isinstance(code, Code):
        return f"one with code {code!r}, which is no Code"
    return "" if isinstance(reason, str) else f"one with reason {reason!r}, which is no text"


def _status(plugin: str, hook: str, answer: object, *_args: Any) -> object:
    odd = odd_status(answer) if answer is not None else ""
    if odd:
        raise PluginError(plugin, f"{hook} must answer a Status or None, got {odd}")
    return answer


def _pre_filter(plugin: str, hook: str, answer: object, *_args: Any) -> object:
    if answer is None:
        return None
    if not isinstance(answer, PreFilter):
        raise PluginError(plugin, f"{hook} must answer a PreFilter or None, got {type(answer).__name__}")
    odd = odd_status(answer.status) if answer.status is not None else ""
    if odd:
        raise PluginError(plugin, f"{hook} must answer a PreFilter whose status is a Status or None, got {odd}")
    names: object = answer.names
    if names is None:
        return answer
    if not isinstance(names, Collection) or isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise PluginError(plugin, f"{hook} must answer a PreFilter whose names are a set of texts, got {names!r:.80}")
    return answer._replace(names=frozenset(names))


def _verdict(plugin: str, hook: str, answer: object, *_args: Any) -> object:
    """Checks all of a Verdict but its mask, which the framework checks for every filter."""
    if not isinstance(answer, Verdict):
        return answer
    mask: object = answer.mask
    if not isinstance(mask, np.ndarray):
        return answer
    wrong = [
        name
        for name, fine in (
            ("reasons", _texts(answer.reasons)),
            ("codes", answer.codes is None or _within(answer.codes, mask, len(answer.reasons or " "))),
            ("detail", answer.detail is None or (np.shape(answer.detail) == mask.shape and _numbers(answer.detail))),
            ("label", answer.label is None or _by_label(answer.label, mask)),
            ("resolvable", _resolvable(answer, mask)),
        )
        if not fine
    ]
    if wrong:
        text = (
            "codes and detail (numbers) have one element per row, codes index reasons, and each of those is a tuple of texts; "
            "with a label of `nodes.label(…)` mask and codes have one element per value of its vocabulary"
        )
        raise PluginError(plugin, f"{hook} answered a Verdict with unusable {', '.join(wrong)}: {text}")
    return answer


def _numbers(detail: object) -> bool:
    return np.asarray(detail).dtype.kind in "iuf"


def _by_label(label: object, mask: npt.NDArray[Any]) -> bool:
    return isinstance(label, LabelColumn) and mask.shape == (len(label.vocabulary.values),)


def _texts(reasons: object) -> bool:
    return isinstance(reasons, list | tuple) and all(
        isinstance(each, tuple) and all(isinstance(text, str) for text in each) for each in reasons
    )


def _within(codes: object, mask: npt.NDArray[Any], count: int) -> bool:
    if not isinstance(codes, np.ndarray) or codes.shape != mask.shape or codes.dtype.kind not in "iu":
        return False
    return not len(codes) or (int(codes.min()) >= 0 and int(codes.max()) < count)


def _resolvable(answer: Verdict, mask: npt.NDArray[Any]) -> bool:
    found = answer.resolvable
    if isinstance(found, tuple):
        return len(found) == len(answer.reasons)
    return found is None or isinstance(found, bool) or np.shape(found) == mask.shape


def _scores(plugin: str, hook: str, answer: object, _pod: Any, nodes: Any) -> object:
    if answer is None or isinstance(answer, int):
        return answer
    if isinstance(answer, PerDomain):
        if not isinstance(answer.label, LabelColumn):
            raise PluginError(
                plugin, f"{hook} must answer a PerDomain with a label of `nodes.label(…)`, got {answer.label!r:.80}"
            )
        return answer._replace(values=_wide(checked_scores(plugin, answer.values, len(answer.label.vocabulary.values))))
    if isinstance(answer, Scores):
        if not isinstance(answer.normalize, str) or answer.normalize not in NORMALIZERS:
            known = ", ".join(sorted(NORMALIZERS))
            raise PluginError(plugin, f"{hook} answered normalize {answer.normalize!r}; it may be one of {known}")
        return answer._replace(raw=_wide(checked_scores(plugin, answer.raw, nodes.n)))
    return _wide(checked_scores(plugin, answer, nodes.n))


def _wide(raw: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Integers as int64 or float64: smaller types would overflow when they are normalised."""
    if raw.dtype.kind not in "iu" or not raw.size:
        return raw
    large = int(raw.max()) > EXACT or int(raw.min()) < -EXACT
    return raw.astype(np.float64 if large else np.int64)


def _row_score(plugin: str, hook: str, answer: object, *_args: Any) -> int:
    if not isinstance(answer, int | np.integer) or not -EXACT <= int(answer) <= EXACT:
        raise PluginError(plugin, f"{hook} must answer an integer, got {answer!r}")
    return int(answer)


def _row_percent(plugin: str, hook: str, answer: object, *_args: Any) -> int:
    score = _row_score(plugin, hook, answer)
    if not 0 <= score <= MAX_SCORE:
        raise PluginError(plugin, f"{hook} must answer 0 to {MAX_SCORE}, got {score}")
    return score


def _among(plugin: str, hook: str, answer: object, _pod: Any, _nodes: Any, feasible: Any) -> object:
    """The range is checked here for a plain number only, for arrays where they are used."""
    if answer is None:
        return None
    if isinstance(answer, int):
        return _row_percent(plugin, hook, answer)
    return checked_scores(plugin, answer, len(feasible), hook=hook)


def _instance_of(kind: type, what: str) -> "_Check":
    def check(plugin: str, hook: str, answer: object, *_args: Any) -> object:
        if answer is not None and not isinstance(answer, kind):
            raise PluginError(plugin, f"{hook} must answer {what} or None, got {type(answer).__name__}")
        return answer

    return check


def _amounts(plugin: str, hook: str, answer: object, *_args: Any) -> object:
    if not isinstance(answer, Mapping) or not all(
        isinstance(name, str) and isinstance(amount, int) for name, amount in answer.items()
    ):
        raise PluginError(plugin, f"{hook} must answer a mapping of resources to integers, got {answer!r:.80}")
    return answer


_CHECKS: Final[Mapping[str, _Check]] = {
    "pre_filter": _pre_filter,
    "narrows": _truth,
    "filter": _verdict,
    "filter_row": _truth,
    "score": _scores,
    "score_row": _row_score,
    "score_among": _among,
    "relevant": _truth,
    "minds": _facts,
    "confined": _truth,
    "touched_by": _truth,
    "beside": _instance_of(Beside, "a Beside"),
    "room": _amounts,
    "plan": _instance_of(VolumePlan, "a VolumePlan"),
    "post_filter": _untouched,
}


_SILENT: Final[dict[str, Any]] = {"filter": None, "score": None, "score_among": None, "relevant": False}
"""Hooks that are called, and the result that stands for Skip."""
_UNUSED: Final = ("narrows", "score_row", "filter_row", "minds", "confined", "touched_by", "beside")
"""Optional hooks that would have to be silenced one by one; without them the forms above are called."""


def silenced(loaded: RegisteredPlugin) -> RegisteredPlugin:
    """A `guarded` plugin whose PluginErrors become Skip: a shadow plugin must not hold a pod back."""
    for name, otherwise in _SILENT.items():
        hook = getattr(loaded, name)
        if hook is not None:
            setattr(loaded, name, _silent(loaded.name, hook, otherwise))
    for name in _UNUSED:
        setattr(loaded, name, None)
    return loaded


def _silent(plugin: str, hook: Callable[..., Any], otherwise: Any) -> Callable[..., Any]:
    def guard(*args: Any) -> Any:
        try:
            return hook(*args)
        except PluginError as error:
            log.warning("shadow plugin %s has no opinion: %s", plugin, error)
            return otherwise

    return guard
