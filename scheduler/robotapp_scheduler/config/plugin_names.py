"""Which plugin names exist: ours, third-party ones (entry point or `module:Class`), and upstream's that are not built.

A third-party plugin is any class following the plugin contract of `core/framework/interface.py`. It is named in the configuration
either by the name of its entry point (group `robotapp_scheduler.plugins`) or as `package.module:Class`.
"""

import difflib
import importlib
import importlib.metadata
from collections.abc import Collection, Iterable

import msgspec

from robotapp_scheduler.core.framework.profiles import OTHER_FORMS, POINTS, Catalogue

ENTRY_POINTS = "robotapp_scheduler.plugins"

NOT_BUILT = {
    "DeferredPodScheduling": "preemption for a resize that waits is alpha upstream",
    "GangScheduling": "the pods of a PodGroup are planned whole without it",
    "TopologyPlacementGenerator": "placements by topology are alpha upstream; the pods of a PodGroup are planned whole",
    "PodGroupPodsCount": "placements by topology are alpha upstream; the pods of a PodGroup are planned whole",
    "EBSLimits": "gone upstream too: NodeVolumeLimits counts the volumes of every CSI driver",
    "GCEPDLimits": "gone upstream too: NodeVolumeLimits counts the volumes of every CSI driver",
    "AzureDiskLimits": "gone upstream too: NodeVolumeLimits counts the volumes of every CSI driver",
}
"""Plugins of kube-scheduler, now or once, that are not built in, and why; a name in our catalogue wins over this list."""
IGNORED_ARGUMENTS = {
    "LatencyFilter": {
        "cacheTTL": "the scheduler probes nothing: agents measure, and a round trip is unknown after three of their rounds"
    }
}
"""Arguments by plugin that files for the thesis' scheduler have and that mean nothing here, and why."""


class UnknownPluginError(LookupError):
    """The name cannot be used; the text is the reason."""


def with_third_party(
    catalogue: Catalogue, names: Iterable[str], *, allowed: Collection[str] | None = None
) -> tuple[Catalogue, dict[str, str]]:
    """The catalogue with the classes behind these names added, and the problem of each name that has none.

    `allowed` limits what may be imported, for a configuration from a request; None = everything.
    """
    classes = dict(catalogue.classes)
    problems: dict[str, str] = {}
    for name in names:
        if name in classes or name in problems:
            continue
        if allowed is not None and name not in allowed:
            problems[name] = f'plugin "{name}" is not loaded here: only plugins of the running configuration are'
            continue
        try:
            classes[name] = load_class(name)
        except UnknownPluginError as error:
            near = [] if name in NOT_BUILT else difflib.get_close_matches(name, catalogue.classes, n=1, cutoff=0.8)
            problems[name] = f'{error} (did you mean "{near[0]}"?)' if near else str(error)
    return msgspec.structs.replace(catalogue, classes=classes), problems


def load_class(name: str) -> type:
    """The class of a third-party plugin. Raises `UnknownPluginError`."""
    if name in NOT_BUILT:
        raise UnknownPluginError(f'not supported here: plugin "{name}": {NOT_BUILT[name]}')
    try:
        found = _import(name)
    except UnknownPluginError:
        raise
    except ModuleNotFoundError as error:
        cure = "; the folder it is in belongs on PYTHONPATH" if name.startswith(error.name or ":") else ""
        raise UnknownPluginError(f'plugin "{name}" cannot be loaded: {error}{cure}') from error
    except (Exception, SystemExit) as error:
        # Somebody else's module may raise anything while it is imported, and scripts call sys.exit.
        raise UnknownPluginError(f'plugin "{name}" cannot be loaded: {error}') from error
    known = (*POINTS.values(), *OTHER_FORMS.values())
    if not isinstance(found, type) or not any(callable(getattr(found, hook, None)) for hook in known):
        hooks = ", ".join(known)
        raise UnknownPluginError(
            f'plugin "{name}" cannot be loaded: {found!r} is no class with one of the hooks {hooks}'
        )
    return found


def _import(name: str) -> object:
    module_name, colon, class_name = name.partition(":")
    if colon:
        return getattr(importlib.import_module(module_name), class_name)
    for entry in importlib.metadata.entry_points(group=ENTRY_POINTS, name=name):
        return entry.load()
    text = "no plugin and no entry point of this name; write module:Class for a file of your own"
    raise UnknownPluginError(f'plugin "{name}" cannot be loaded: {text}')
