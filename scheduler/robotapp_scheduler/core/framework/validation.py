"""Checks the attributes of a plugin class when it is loaded, so that a mistake is not found by the first pod."""

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, Final

from robotapp_scheduler.core.events.cluster_event import READS, Change
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.pods.pod_info import FEATURES, LIVE

NAMES: Final = (tuple, list, set, frozenset)
KINDS: Final[Mapping[str, tuple[type, ...]]] = {
    "row_local": (bool,),
    "resolvable": (bool,),
    "reason": (str,),
    "normalize": (str,),
    "events": (Change,),
    "reads": NAMES,
    "node_reads": NAMES,
    "hint_reads": NAMES,
    "relevant_reads": NAMES,
}
HOOKS: Final = (
    *(
        "pre_enqueue",
        "queue_key",
        "pre_filter",
        "narrows",
        "filter",
        "post_filter",
        "score",
        "score_among",
        "reserve",
        "unreserve",
    ),
    *(
        "permit",
        "pre_bind",
        "bind",
        "post_bind",
        "plan",
        "plan_claims",
        "filter_row",
        "score_row",
        "relevant",
        "confined",
        "minds",
        "hint",
    ),
    *("hint_of_each", "hint_serves", "gate_group", "touched_by", "beside", "room"),
)


_SPELT: Final = {hook.replace("_", ""): hook for hook in HOOKS}


def misread(plugin: object, made_here: Callable[[object], bool]) -> list[str]:
    """Problems: functions of a third-party plugin that look like hooks and would never be called.

    `made_here` is True for functions of built-in classes.
    """
    found = []
    for name in dir(type(plugin)):
        value = getattr(type(plugin), name, None)
        if name.startswith("_") or name in HOOKS or not callable(value) or isinstance(value, type) or made_here(value):
            continue
        plain = name.replace("_", "").lower()
        meant = _SPELT.get(plain)
        if plain == "prescore":
            found.append(f"`{name}` is no hook here: what is the same for all nodes is worked out in `score`")
        elif meant is not None:
            found.append(f"`{name}` is no hook; did you mean `{meant}`?")
    return found


def problems_of(plugin: object, normalizers: Collection[str]) -> list[str]:
    """Problems with the attributes of a plugin; empty when it may be used."""
    name = getattr(plugin, "name", None)
    if not isinstance(name, str) or not name:
        return [f"`name` must be a text, got {name!r}"]
    return list(_kinds(plugin)) or [*_names(plugin), *_normalize(plugin, normalizers)]


def _kinds(plugin: object) -> Iterator[str]:
    for attribute, kinds in KINDS.items():
        value = getattr(plugin, attribute, None)
        if hasattr(plugin, attribute) and not isinstance(value, kinds):
            yield f"`{attribute}` must be a {' or '.join(kind.__name__ for kind in kinds)}, got {value!r}"
    for hook in HOOKS:
        if not callable(getattr(plugin, hook, None)) and getattr(plugin, hook, None) is not None:
            yield f"`{hook}` must be a function, got {getattr(plugin, hook)!r}"


def _names(plugin: Any) -> Iterator[str]:
    reads = getattr(plugin, "reads", ())
    for attribute in ("reads", "hint_reads"):
        unknown = sorted(set(map(str, getattr(plugin, attribute, ()))) - set(FEATURES))
        if unknown:
            yield f"`{attribute}` names {', '.join(unknown)}; features of a pod are {', '.join(sorted(FEATURES))}"
    for attribute in ("node_reads", "relevant_reads"):
        named = [each for each in getattr(plugin, attribute, ()) if not isinstance(each, NodeFact)]
        unknown = sorted(str(name) for name in named if name not in READS)
        if unknown:
            yield f"`{attribute}` names {', '.join(unknown)}; facts of nodes are {', '.join(sorted(READS))}"
    if len({next((live for live in LIVE if name.startswith(live)), "") for name in map(str, reads)}) > 1:
        yield f"`reads` {', '.join(sorted(map(str, reads)))} mixes parts of ros, volumes or claims with other features"


def _normalize(plugin: object, normalizers: Collection[str]) -> Iterator[str]:
    how = getattr(plugin, "normalize", "none")
    if how not in normalizers:
        yield f"`normalize` is {how!r}; it may be one of {', '.join(sorted(normalizers))}"
