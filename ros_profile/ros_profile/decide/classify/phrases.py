"""Features in plain words, for the reason that comes with a class."""

_NOUNS = {
    "command": "commands",
    "command_name": "a topic named like a command",
    "command_text": "commands as texts",
    "measured": "measurements in messages of its own",
    "sensor": "sensor data",
    "fieldbus": "field bus frames",
    "joy": "operator input",
    "interpreted": "what is made of sensor data",
    "state": "states of joints or batteries",
    "pose": "poses",
    "tf": "transforms",
    "path": "paths",
    "motion": "motion actions",
    "planning": "planning actions",
    "service": "services",
    "action": "actions",
}
_KINDS = {
    "needs:sensing": "packages of sensors",
    "needs:control": "packages of ros_control",
    "needs:command": "packages of commands",
    "needs:fieldbus": "packages of a field bus",
    "needs:coordination": "packages of planning and coordination",
    "needs:network": "packages of bridges and networks",
    "needs:display": "packages of displays",
    "needs:simulation": "packages of simulations",
    "needs:tool": "packages of tools",
    "word:fieldbus": "a field bus",
    "word2:fieldbus": "a field bus",
    "word:planning": "planning",
    "word2:planning": "planning",
    "hardware:serial": "a serial line",
    "hardware:can": "a CAN bus",
    "hardware:usb": "a USB device",
    "hardware:camera": "a camera",
    "hardware:gpu": "a GPU",
    "hardware:gpio": "GPIO pins",
}
"""Nouns that fit one form only."""
_FORMS = {
    "plugin": "is a plug-in of kind {}",
    "inherits": "derives from a base class of kind {}",
    "hosts": "loads plug-ins of kind {}",
    "pub": "publishes {}",
    "sub": "subscribes {}",
    "serve": "serves {}",
    "call": "calls {}",
    "uses": "uses a library for {}",
    "needs": "depends on {}",
    "word": "is named like {}",
    "word2": "is named like {}",
    "program": "is named like {}",
    "told": "is described as {}",
    "hardware": "opens {}",
    "curated": "is well known as {}",
}
_SHAPES = {
    "servers_only": "answers requests and has no streams",
    "sensor_filter": "turns sensor data into sensor data",
    "sensor_source": "is a source of sensor data",
    "sensor_sink": "only takes sensor data",
    "operator": "makes commands from what an operator does",
    "operator_device": "reads a joystick",
    "operator_panel": "is a window that drives the robot",
    "base_driver": "takes commands and opens a device",
    "viewer": "opens windows and is named like a display",
    "device_link": "connects a serial line or field bus, and no sensor",
    "device_source": "only reports what its device gives",
    "device_report": "only reports what hangs on its serial line",
    "signal_output": "shows something to people over its serial line",
    "discrete_io": "switches pins on request",
    "no_code": "has no code",
    "no_node": "has no node",
}


def phrase(name: str) -> str:
    """`pub:command` as "publishes commands"."""
    kind, _, what = name.partition(":")
    if kind == "shape":
        return _SHAPES.get(what, what.replace("_", " "))
    return _FORMS.get(kind, "{}").format(_KINDS.get(name) or _NOUNS.get(what, what))
