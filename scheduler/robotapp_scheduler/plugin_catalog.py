"""Which plugin names exist: ours, third-party ones (entry point or `module:Class`), and upstream's that are not built.

A third-party plugin is any class following the plugin contract of `core/framework.py`. It is named in the configuration
either by the name of its entry point (group `robotapp_scheduler.plugins`) or as `package.module:Class`.
"""

import importlib
import importlib.metadata
from collections.abc import Mapping
from dataclasses import dataclass, field

from robotapp_scheduler.config_model import PluginRef

ENTRY_POINTS = "robotapp_scheduler.plugins"
HOOKS: Mapping[str, str] = {
    "pre_enqueue": "preEnqueue",
    "queue_key": "queueSort",
    "filter": "filter",
    "post_filter": "postFilter",
    "score": "score",
    "reserve": "reserve",
    "permit": "permit",
    "pre_bind": "preBind",
    "bind": "bind",
    "post_bind": "postBind",
}
"""Method of a plugin class to the extension point it makes the plugin a member of."""

NOT_BUILT = frozenset(
    {
        "VolumeRestrictions",
        "NodeVolumeLimits",
        "VolumeBinding",
        "VolumeZone",
        "PodTopologySpread",
        "InterPodAffinity",
        "DynamicResources",
        "DefaultPreemption",
        "ImageLocality",
        "NodeDeclaredFeatures",
        "DeferredPodScheduling",
        "GangScheduling",
    }
)
"""kube-scheduler 1.37 plugins that exist upstream; a name that is in our registry wins over this list."""


@dataclass(slots=True)
class Catalog:
    """Plugin classes by name. Third-party classes are loaded when first named, so an unused one costs nothing."""

    registry: Mapping[str, type]
    defaults: tuple[PluginRef, ...]
    """Enabled without a configuration: name and score weight, in multiPoint order."""
    loaded: dict[str, type] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    def plugin_class(self, name: str) -> type | None:
        """The class behind a name, or None with the reason kept for `problem`."""
        if name in self.registry:
            return self.registry[name]
        if name not in self.loaded and name not in self.failures:
            self._load(name)
        return self.loaded.get(name)

    def points_of(self, name: str) -> frozenset[str]:
        found = self.plugin_class(name)
        return frozenset(point for hook, point in HOOKS.items() if callable(getattr(found, hook, None)))

    def is_third_party(self, name: str) -> bool:
        return name not in self.registry

    def problem(self, name: str, *, point: str) -> str | None:
        """Why this name may not stand in this list, or None."""
        if self.plugin_class(name) is None:
            return self.failures[name]
        if point in HOOKS.values() and point not in self.points_of(name):
            return f'plugin "{name}" does not extend {point}'
        return None

    def _load(self, name: str) -> None:
        if name in NOT_BUILT:
            self.failures[name] = f'not supported here: plugin "{name}" is not built into this scheduler yet'
            return
        try:
            self.loaded[name] = _third_party(name)
        except Exception as error:  # noqa: BLE001 - somebody else's module may raise anything at import
            self.failures[name] = f'plugin "{name}" cannot be loaded: {error}'


def _third_party(name: str) -> type:
    module_name, colon, class_name = name.partition(":")
    if colon:
        found = getattr(importlib.import_module(module_name), class_name)
    else:
        found = next(iter(importlib.metadata.entry_points(group=ENTRY_POINTS, name=name)), None)
        if found is None:
            raise LookupError("no plugin and no entry point of this name; write module:Class for a file of your own")
        found = found.load()
    if not isinstance(found, type):
        raise TypeError(f"{found!r} is no class")
    if not any(callable(getattr(found, hook, None)) for hook in HOOKS):
        raise TypeError(f"has none of the hooks {', '.join(HOOKS)}")
    return found
