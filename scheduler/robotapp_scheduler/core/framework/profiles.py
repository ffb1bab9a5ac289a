"""A scheduling profile: which plugins run at which point, in which order, with which weights and arguments.

Built from the `plugins` and `pluginConfig` blocks of a KubeSchedulerConfiguration by upstream's merge rules.
"""

import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from hashlib import sha256
from typing import Any, Final

import msgspec

from robotapp_scheduler.core.framework.incremental import PreFlight, Send
from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.framework.third_party import guarded, is_ours, silenced
from robotapp_scheduler.core.pods.pod_info import ROS_FEATURES

log = logging.getLogger(__name__)

POINTS: Final = {
    "preEnqueue": "pre_enqueue",
    "queueSort": "queue_key",
    "preFilter": "pre_filter",
    "filter": "filter",
    "postFilter": "post_filter",
    "preScore": "pre_score",
    "score": "score",
    "reserve": "reserve",
    "permit": "permit",
    "preBind": "pre_bind",
    "bind": "bind",
    "postBind": "post_bind",
}
"""Extension points of the configuration and the hook that makes a plugin take part."""
PLACES: Final = frozenset({"multiPoint", *POINTS})
"""Where a configuration may list plugins."""
OTHER_FORMS: Final = {"score": "score_among"}
"""Points at which another hook makes a plugin take part too."""


FOR_APPS: Final = {"reserve": "ROSReserve", "bind": "ROSBind", "postBind": "ROSReserve"}
"""Plugins without which no pod of a RobotApp is placed: the check of its domain cannot be configured away (claims.md rule 1)."""


class ProfileError(Exception):
    """Profiles that cannot be built; `problems` name the path and what is allowed. `config.load` reports them in a ConfigError."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


class NoArgs(msgspec.Struct, forbid_unknown_fields=True):
    """Arguments of plugins that have none."""


class PluginRef(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A plugin named in the configuration. A weight of 0 means 1, as upstream."""

    name: str
    weight: int = 0


class PluginSet(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """enabled and disabled plugins of one point; disabled "*" removes all defaults."""

    enabled: tuple[PluginRef, ...] = ()
    disabled: tuple[PluginRef, ...] = ()


class ProfileSpec(msgspec.Struct, frozen=True):
    """One profile as configured."""

    scheduler_name: str
    plugins: Mapping[str, PluginSet] = {}
    """Per point, and "multiPoint"."""
    plugin_config: Mapping[str, Mapping[str, Any]] = {}
    """Plugin name → raw arguments."""


class Catalogue(msgspec.Struct, frozen=True):
    """Known plugin classes by name and the default multiPoint list with weights."""

    classes: Mapping[str, type]
    defaults: tuple[PluginRef, ...]
    stand_ins: Mapping[str, str] = {}
    """Our default plugin → the upstream default that it replaces, until a configuration names the upstream one."""

    upstream_points: Mapping[str, Collection[str]] = {}
    """Points at which upstream's plugin of a name takes part."""

    def is_idle(self, name: str, point: str) -> bool:
        """True when upstream's plugin of this name takes part at this point and ours does not: naming it there is no error."""
        return point in self.upstream_points.get(name, ()) and not _takes_part(self, name, point)

    def takes_part(self, name: str, point: str) -> bool:
        """Returns whether the plugin of this name has something to do at the point."""
        return _takes_part(self, name, point)

    def with_defaults_for(self, specs: Sequence[ProfileSpec]) -> "Catalogue":
        """The catalogue with the default plugins that apply to a file with these profiles.

        When a file written for kube-scheduler enables or disables an upstream default by name, that default replaces ours,
        in all profiles of the file, since they share one queue.
        """
        sets = (found for spec in specs for found in spec.plugins.values())
        named = {ref.name for found in sets for ref in (*found.enabled, *found.disabled)}
        meant = {ours: theirs for ours, theirs in self.stand_ins.items() if theirs in named}
        defaults = tuple(PluginRef(meant[ref.name], ref.weight) if ref.name in meant else ref for ref in self.defaults)
        return msgspec.structs.replace(self, defaults=defaults)


class Profile:
    """The plugins of one schedulerName, ready to run."""

    def __init__(
        self,
        scheduler_name: str,
        plugins: Mapping[str, Sequence[RegisteredPlugin]],
        config_hash: str,
        *,
        queue_sort_args: str = "",
    ) -> None:
        self.scheduler_name = scheduler_name
        self.config_hash = config_hash
        self.queue_sort_args = queue_sort_args
        """Digest of the queue sort plugin's arguments."""
        self.pre_enqueue = _deciding(plugins, "preEnqueue")
        self.queue_sort = plugins["queueSort"][0]
        self.pre_filters = _deciding(plugins, "preFilter")
        self.filters = _deciding(plugins, "filter")
        self.shadow_filters = tuple(loaded for loaded in plugins.get("filter", ()) if loaded.shadow)
        """Called for the chosen node only, after the choice."""
        self.post_filters = _deciding(plugins, "postFilter")
        self.scores = tuple(plugins.get("score", ()))
        """Shadow plugins among them are scored and left out of the totals."""
        self.has_shadows = any(loaded.shadow for chain in plugins.values() for loaded in chain)
        self.reserves = _deciding(plugins, "reserve")
        self.permits = _deciding(plugins, "permit")
        self.pre_binds = _deciding(plugins, "preBind")
        self.binds = tuple(plugins.get("bind", ()))
        """The first that does not skip a pod binds it."""
        self.post_binds = _deciding(plugins, "postBind")
        around_the_bind = (self.reserves, self.permits, self.pre_binds, self.post_binds)
        self.pre_flights = tuple(_pre_flights(*around_the_bind))
        self.send = _send_of(self.binds[0]) if self.binds else None
        """The bind for pods that no plugin has work for: nothing is awaited, a callback gets the result."""
        self.waits = any(pre_flight_of(loaded) is None for chain in around_the_bind for loaded in chain) or not all(
            is_ours(loaded.plugin) for loaded in self.binds
        )
        """Whether a hook without `pre_flight`, or another author's bind, may make any placed pod wait for minutes."""
        if self.waits:
            self.send = None
        self.reserves_devices = any(loaded.name == FOR_APPS["reserve"] for loaded in self.reserves)
        """Whether devices are chosen and claimed for pods that request some."""
        self.unfit_for_apps = _unfit_for_apps(
            scheduler_name, {"reserve": self.reserves, "bind": self.binds, "postBind": self.post_binds}
        )
        """Why this profile cannot place pods of RobotApps; "" when it can."""
        self.everywhere = tuple(loaded for chain in plugins.values() for loaded in chain)
        """One for each point that a plugin takes part in."""
        self.all = {loaded.name: loaded for loaded in self.everywhere}
        planners = (loaded for loaded in self.everywhere if loaded.plan_claims is not None and not loaded.shadow)
        self.claim_planner = next(planners, None)
        """The plugin that allocates resource claims."""
        self.reads = tuple(sorted({name for loaded in (*self.filters, *self.scores) for name in loaded.reads}))
        """Features of the class key."""
        self.uses_ros = any(name.startswith(ROS_FEATURES) for name in self.reads)

    def __repr__(self) -> str:
        return f"Profile({self.scheduler_name}, {len(self.filters)} filters, {len(self.scores)} scores)"


def _deciding(plugins: Mapping[str, Sequence[RegisteredPlugin]], point: str) -> tuple[RegisteredPlugin, ...]:
    """The plugins of a point that are no shadows."""
    return tuple(loaded for loaded in plugins.get(point, ()) if not loaded.shadow)


def pre_flight_of(loaded: RegisteredPlugin) -> PreFlight | None:
    """The plugin's `pre_flight`; None for a third-party class, whose own hooks an inherited `pre_flight` does not cover."""
    return getattr(loaded.plugin, "pre_flight", None) if is_ours(loaded.plugin) else None


def _pre_flights(*chains: Sequence[RegisteredPlugin]) -> Collection[PreFlight]:
    """One per plugin that has one."""
    found = {loaded.name: pre_flight_of(loaded) for chain in chains for loaded in chain}
    return [each for each in found.values() if each is not None]


def _send_of(loaded: RegisteredPlugin) -> Send | None:
    return getattr(loaded.plugin, "send", None) if is_ours(loaded.plugin) else None


def _unfit_for_apps(scheduler_name: str, chains: Mapping[str, Sequence[RegisteredPlugin]]) -> str:
    missing = [
        f"{name} at {point}"
        for point, name in FOR_APPS.items()
        if not any(loaded.name == name and is_ours(loaded.plugin) for loaded in chains[point])
    ]
    if not missing:
        return ""
    return (
        f"profile {scheduler_name!r} cannot place pods of a RobotApp, because nothing in it checks or hands out their "
        f"domains and devices: enable {' and '.join(missing)} in the scheduler's configuration"
    )


def build_profiles(specs: Sequence[ProfileSpec], catalogue: Catalogue) -> dict[str, Profile]:
    """All profiles by schedulerName. Raises ProfileError with every problem found."""
    catalogue = catalogue.with_defaults_for(specs)
    problems: list[str] = []
    profiles: dict[str, Profile] = {}
    for i, spec in enumerate(specs):
        path = f"profiles[{i}]"
        if spec.scheduler_name in profiles:
            problems.append(f"{path}.schedulerName: {spec.scheduler_name!r} is used twice")
        profile = _build(spec, catalogue, path, problems)
        if profile is not None:
            profiles[spec.scheduler_name] = profile
    problems.extend(_queue_sort_problems(profiles.values()))
    if problems:
        raise ProfileError(problems)
    return profiles


def _queue_sort_problems(profiles: Collection[Profile]) -> Iterator[str]:
    """Problems with queueSort: all profiles share one queue, so they must order it the same way."""
    sorts = {profile.queue_sort.name for profile in profiles}
    if len(sorts) > 1:
        yield f"profiles: queueSort must be the same for all profiles, found {', '.join(sorted(sorts))}"
    elif len({profile.queue_sort_args for profile in profiles}) > 1:
        yield f"profiles: the arguments of {', '.join(sorts)} must be the same for all profiles: it orders one queue"


def _build(spec: ProfileSpec, catalogue: Catalogue, path: str, problems: list[str]) -> Profile | None:
    before = len(problems)
    problems.extend(
        f"{path}.plugins.{point}: unknown plugin {ref.name!r}; known: {', '.join(sorted(catalogue.classes))}"
        for point, plugins in spec.plugins.items()
        for ref in plugins.enabled
        if ref.name not in catalogue.classes
    )
    points = expand(spec.plugins, catalogue, path, problems)
    loaded: dict[str, Any] = {}
    enabled = (ref.name for refs in points.values() for ref in refs)
    # Arguments of a disabled plugin are checked too, so that enabling it brings no surprise.
    for name in dict.fromkeys([*enabled, *spec.plugin_config]):
        plugin = _instance(name, spec.plugin_config.get(name), catalogue, path, problems)
        if plugin is not None:
            loaded[name] = plugin
    problems.extend(
        f"{path}.pluginConfig: {name!r} is not an enabled plugin of this scheduler"
        for name in spec.plugin_config
        if name not in loaded and name not in catalogue.classes
    )
    shadows = {name for name, (_, shadow) in loaded.items() if shadow}
    problems.extend(
        f"{path}.pluginConfig[{ref.name}].args.shadow: a plugin that orders the queue or binds cannot be a shadow"
        for point in ("queueSort", "bind")
        for ref in points[point]
        if ref.name in shadows
    )
    if len(points["queueSort"]) != 1:
        found = ", ".join(ref.name for ref in points["queueSort"]) or "none"
        problems.append(
            f"{path}.plugins.queueSort: only one queue sort plugin can be enabled, and one must be: {found}"
        )
    if not points["bind"]:
        problems.append(f"{path}.plugins.bind: at least one bind plugin is needed")
    if len(problems) > before:
        return None
    chains = _chains(points, loaded, path, problems)
    if len(problems) > before:
        return None
    config_hash = _digest([points, spec.plugin_config])
    sort_args = spec.plugin_config.get(points["queueSort"][0].name, {})
    return Profile(spec.scheduler_name, chains, config_hash, queue_sort_args=_digest(_own_values(sort_args)))


def _chains(
    points: Mapping[str, Sequence[PluginRef]],
    loaded: Mapping[str, tuple[Any, bool]],
    path: str,
    problems: list[str],
) -> dict[str, list[RegisteredPlugin]]:
    """The plugins of every point, their attributes checked; each problem is reported once."""
    chains: dict[str, list[RegisteredPlugin]] = {}
    owner: dict[str, str] = {}
    found: list[str] = []
    for point, refs in points.items():
        chains[point] = []
        for ref in refs:
            plugin, shadow = loaded[ref.name]
            try:
                made = _made(plugin, ref.weight or 1, shadow=shadow)
            except PluginError as error:
                found.append(f"{path}.plugins: {error}")
                continue
            except Exception as error:  # a property of a third-party class may raise anything
                log.warning("plugin %s cannot be looked at", ref.name, exc_info=True)
                found.append(
                    f"{path}.plugins: plugin {ref.name!r} cannot be looked at: {type(error).__name__}: {error}"
                )
                continue
            if owner.setdefault(made.name, ref.name) != ref.name:
                found.append(f"{path}.plugins: {ref.name!r} and {owner[made.name]!r} are both called {made.name!r}")
            chains[point].append(made)
    problems.extend(dict.fromkeys(found))
    return chains


def _made(plugin: Any, weight: int, *, shadow: bool) -> RegisteredPlugin:
    loaded = RegisteredPlugin(plugin, weight=weight, shadow=shadow)
    if shadow or not is_ours(plugin):
        loaded = guarded(loaded)
    return silenced(loaded) if shadow else loaded


def _own_values(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments without apiVersion and kind."""
    return {key: value for key, value in raw.items() if key not in ("apiVersion", "kind")}


def _digest(value: object) -> str:
    return sha256(msgspec.json.encode(value, order="deterministic")).hexdigest()[:12]


def _instance(
    name: str, raw: Mapping[str, Any] | None, catalogue: Catalogue, path: str, problems: list[str]
) -> tuple[Any, bool] | None:
    """(plugin, shadow). `shadow` is an argument that every plugin may have; its class does not get it."""
    cls = catalogue.classes.get(name)
    if cls is None:
        return None  # reported with the place where it is named
    values = _own_values(raw or {})
    shadow = values.pop("shadow", False)
    if not isinstance(shadow, bool):
        problems.append(f"{path}.pluginConfig[{name}].args.shadow: expected true or false, got {shadow!r}")
        return None
    kind: type[msgspec.Struct] = getattr(cls, "Args", NoArgs)
    try:
        args = msgspec.convert(values, kind)
        return (cls(args) if kind is not NoArgs else cls()), shadow
    except (msgspec.ValidationError, ValueError) as error:
        problems.append(f"{path}.pluginConfig[{name}].args: {error}")
    except (Exception, SystemExit) as error:  # third-party code; a configuration must not end the process
        log.warning("plugin %s cannot be made", name, exc_info=True)
        problems.append(f"{path}.plugins: plugin {name!r} cannot be made: {type(error).__name__}: {error}")
    return None


def expand(
    plugins: Mapping[str, PluginSet], catalogue: Catalogue, path: str, problems: list[str]
) -> dict[str, list[PluginRef]]:
    """Plugins per point: the point's own list merged with the expanded multiPoint list.

    The profile's list is appended to the defaults, the same name replaces in place, `disabled` removes. At each point
    come first the plugins named in both lists (in the point's order), then the other multiPoint ones, then those
    named only at the point, also those that it disables for multiPoint; a plugin that has nothing to do there is left
    out. The point's weight counts, 1 where it has none.
    """
    problems.extend(
        f"{path}.plugins.{point}: unknown extension point; known: {', '.join(POINTS)}"
        for point in plugins
        if point not in PLACES
    )
    multi = _merged(catalogue.defaults, plugins.get("multiPoint", PluginSet()), f"{path}.plugins.multiPoint", problems)
    result: dict[str, list[PluginRef]] = {}
    for point in POINTS:
        own = plugins.get(point, PluginSet())
        _no_duplicates(own.enabled, f"{path}.plugins.{point}", problems)
        removed = {ref.name for ref in own.disabled}
        named = {ref.name for ref in own.enabled}
        spread = [ref for ref in multi if not removed & {ref.name, "*"} and _takes_part(catalogue, ref.name, point)]
        both = [ref for ref in own.enabled if any(other.name == ref.name for other in spread)]
        rest = [ref for ref in spread if ref.name not in named]
        only = [ref for ref in own.enabled if ref not in both and not catalogue.is_idle(ref.name, point)]
        problems.extend(
            f"{path}.plugins.{point}: plugin {ref.name!r} does not take part at this point"
            for ref in only
            if ref.name in catalogue.classes and not _takes_part(catalogue, ref.name, point)
        )
        result[point] = [*both, *rest, *only]
    return result


def _takes_part(catalogue: Catalogue, name: str, point: str) -> bool:
    cls = catalogue.classes.get(name)
    return hasattr(cls, POINTS[point]) or (point in OTHER_FORMS and hasattr(cls, OTHER_FORMS[point]))


def _merged(defaults: Sequence[PluginRef], custom: PluginSet, path: str, problems: list[str]) -> list[PluginRef]:
    _no_duplicates(custom.enabled, path, problems)
    removed = {ref.name for ref in custom.disabled}
    replaced = {ref.name: ref for ref in custom.enabled}
    kept = [replaced.pop(ref.name, ref) for ref in defaults if not removed & {ref.name, "*"}]
    return kept + [ref for ref in custom.enabled if ref.name in replaced]


def _no_duplicates(refs: Sequence[PluginRef], path: str, problems: list[str]) -> None:
    names = [ref.name for ref in refs]
    problems.extend(
        f"{path}: plugin {name!r} is enabled twice" for name in dict.fromkeys(names) if names.count(name) > 1
    )
