"""Rigelfile in, RobotApp out. Needs PyYAML only, so it also lives in Rigel's own environment.

Rigel finds its plugin classes here: `Plugin` (Rigel 0.2) and `RobotAppPlugin` (0.3 and newer).
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

try:
    __version__ = version("robotapp")
except PackageNotFoundError:  # copied next to Rigel instead of installed
    __version__ = "0"


def __getattr__(name: str) -> Any:
    """Plugin classes, built on demand: only then the Rigel they belong to is imported."""
    if name not in ("Plugin", "RobotAppPlugin"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module("rigel_bridge.plugins.installed").plugin_class(name)
