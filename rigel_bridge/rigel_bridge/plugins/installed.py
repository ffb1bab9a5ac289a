"""Which Rigel is installed, and the plugin class for it."""

from importlib import import_module
from typing import Any, Final

from rigel_bridge.plugins import rigel02, rigel03

_WRITTEN: Final = {
    "Plugin": "Rigel 0.2: deploy: [{name: robotapp/rigel_bridge, kwargs: {…}}]",
    "RobotAppPlugin": "Rigel 0.3 and newer: jobs: {deploy: {plugin: rigel_bridge.RobotAppPlugin, with: {…}}}",
}


def plugin_class(name: str) -> type:
    """`Plugin` or `RobotAppPlugin` for the Rigel that is installed; AttributeError when it is another one, or none."""
    base = _base()
    if base is None:
        raise AttributeError(
            f"rigel_bridge.{name} is for Rigel, and Rigel is not installed here; rigel-bridge works without it"
        )
    # A Protocol needs no subclass; an ordinary class does: that is how the generations differ.
    present = "Plugin" if getattr(base, "_is_protocol", False) else "RobotAppPlugin"
    if name != present:
        raise AttributeError(
            f"rigel_bridge.{name} is not for the Rigel that is installed; write for {_WRITTEN[present]}"
        )
    if present == "Plugin":
        return rigel02.plugin(import_module("rigelcore.exceptions").RigelError)
    return rigel03.plugin(base, import_module("rigel.exceptions").RigelError)


def _base() -> Any:
    try:
        return import_module("rigel.plugins").Plugin
    except ModuleNotFoundError as error:
        if error.name not in ("rigel", "rigel.plugins"):
            raise
        return None
