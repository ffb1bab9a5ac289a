"""Units of well-known nodes whose source is not in the workspace."""

from ros_profile.decide.places import TABLE
from ros_profile.knowledge.interfaces import INTERFACES
from ros_profile.model.endpoints import Endpoint, Role
from ros_profile.model.package import Manifest, Unit

_SIGNS = {">": Role.PUBLISHER, "<": Role.SUBSCRIPTION, "?": Role.SERVICE_CLIENT, "!": Role.SERVICE_SERVER}


def known_unit(package: str, executable: str, plugin: str) -> Unit | None:
    """The node as the table has it; ROS 1 scripts are named with `.py`."""
    written = INTERFACES.get(plugin) if plugin else INTERFACES.get(f"{package}/{executable.removesuffix('.py')}")
    if written is None:
        return None
    endpoints = []
    for part in written.split(","):
        sign, name, kind = part.split()
        endpoints.append(Endpoint(_SIGNS[sign], name, kind, TABLE, 0))
    return Unit(Manifest(name=package, file=""), plugin or executable, "program", endpoints=tuple(endpoints))
