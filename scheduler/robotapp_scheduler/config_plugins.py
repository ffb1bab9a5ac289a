"""Which plugins run at which point, in which order, with which weight: the merge rules of kube-scheduler.

Two steps, as upstream: the profile's lists are merged into the defaults (same name replaces in place, the rest is
appended, `disabled` removes, `"*"` removes all), then `multiPoint` is spread over the points a plugin implements.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from robotapp_scheduler.config_model import PluginRef, Plugins, PluginSet

POINTS: tuple[str, ...] = (
    "preEnqueue",
    "queueSort",
    "filter",
    "postFilter",
    "score",
    "reserve",
    "permit",
    "preBind",
    "bind",
    "postBind",
)
"""Extension points with hooks of their own. preFilter and preScore are part of filter and score here."""

PART_OF: Mapping[str, str] = {"preFilter": "filter", "preScore": "score"}

PointsOf = Callable[[str], frozenset[str]]
"""Plugin name to the extension points it implements; an unknown plugin implements none."""


@dataclass(frozen=True, slots=True)
class PluginUse:
    """One plugin at one point. `weight` matters at `score` only."""

    name: str
    weight: int = 1


class DuplicatePluginError(ValueError):
    """A plugin stands twice in one list; upstream refuses this too."""


def merge(defaults: PluginSet, custom: PluginSet) -> PluginSet:
    """The profile's list on top of the default one; `disabled` of both are kept for the multiPoint step."""
    _refuse_duplicates(custom.enabled)
    disabled = {ref.name for ref in custom.disabled}
    replacing = {ref.name: ref for ref in custom.enabled}
    kept: list[PluginRef] = []
    if "*" not in disabled:
        kept = [replacing.get(ref.name, ref) for ref in defaults.enabled if ref.name not in disabled]
    replaced = {ref.name for ref in kept} & set(replacing)
    appended = [ref for ref in custom.enabled if ref.name not in replaced]
    return PluginSet(enabled=[*kept, *appended], disabled=[*custom.disabled, *defaults.disabled])


def spread(point: PluginSet, multi: PluginSet, *, implements: Callable[[str], bool]) -> tuple[PluginUse, ...]:
    """The effective list of one point.

    Order: plugins named in both places (in the point's order), then the rest of multiPoint, then those named only here.
    """
    _refuse_duplicates(point.enabled)
    _refuse_duplicates(multi.enabled)
    disabled = {ref.name for ref in point.disabled}
    named = {ref.name: ref for ref in point.enabled}
    if "*" in disabled:
        return tuple(_use(ref) for ref in point.enabled)
    from_multi = [ref for ref in multi.enabled if implements(ref.name) and ref.name not in disabled]
    overridden = {ref.name for ref in from_multi} & set(named)
    ordered = [ref for ref in point.enabled if ref.name in overridden]
    ordered += [ref for ref in from_multi if ref.name not in named]
    ordered += [ref for ref in point.enabled if ref.name not in overridden]
    return tuple(_use(ref) for ref in ordered)


def effective(
    defaults: Sequence[PluginRef], custom: Plugins, *, points_of: PointsOf
) -> dict[str, tuple[PluginUse, ...]]:
    """Every point's list for a profile whose defaults are given as one multiPoint list."""
    multi = merge(PluginSet(enabled=list(defaults)), custom.multi_point)
    lists: dict[str, tuple[PluginUse, ...]] = {}
    for point in POINTS:
        own = merge(PluginSet(), point_set(custom, point))
        implementing = {ref.name for ref in multi.enabled if point in points_of(ref.name)}
        lists[point] = spread(own, multi, implements=implementing.__contains__)
    return lists


def point_set(plugins: Plugins, point: str) -> PluginSet:
    """The list of a point by its name in the file (camelCase)."""
    field = {info.alias: name for name, info in Plugins.model_fields.items()}[point]
    value = getattr(plugins, field)
    if not isinstance(value, PluginSet):  # pragma: no cover - the model has no other field type
        raise TypeError(field)
    return value


def _use(ref: PluginRef) -> PluginUse:
    return PluginUse(name=ref.name, weight=ref.weight or 1)


def _refuse_duplicates(refs: Sequence[PluginRef]) -> None:
    seen: set[str] = set()
    for ref in refs:
        if ref.name in seen:
            raise DuplicatePluginError(ref.name)
        seen.add(ref.name)
