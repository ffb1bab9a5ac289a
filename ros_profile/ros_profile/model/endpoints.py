"""Where a node touches the ROS graph: topics, services, actions, timers, parameters."""

from dataclasses import dataclass
from enum import StrEnum

PARAMETER_MARK = "$param:"
"""A name that is the value of a parameter is written `$param:name` (its default, when known, stands in `Parameter`)."""


class Role(StrEnum):
    PUBLISHER = "publisher"
    SUBSCRIPTION = "subscription"
    SERVICE_SERVER = "service_server"
    SERVICE_CLIENT = "service_client"
    ACTION_SERVER = "action_server"
    ACTION_CLIENT = "action_client"


@dataclass(frozen=True, slots=True)
class Qos:
    """What code states; an empty text or -1 was not stated. `profile` is the name of a preset of rmw."""

    profile: str = ""
    reliability: str = ""
    durability: str = ""
    history: str = ""
    liveliness: str = ""
    depth: int = -1
    deadline_s: float = -1.0


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A publisher, subscription, server or client. `name` is as written (`scan`, `~/odom`, `/tf`), `$param:…` when a
    parameter names it, empty when it cannot be told; `type` is `package/msg/Name`, or `Name`, or empty.
    `owner` is the class that creates it.
    """

    role: Role
    name: str
    type: str
    file: str
    line: int
    qos: Qos | None = None
    owner: str = ""


@dataclass(frozen=True, slots=True)
class Timer:
    """A timer or rate loop: a literal period, or the parameter that gives it (`parameter_is_rate`: in Hz)."""

    file: str
    line: int
    period_s: float = -1.0
    parameter: str = ""
    parameter_is_rate: bool = False
    owner: str = ""
    runs: str = ""
    """Name of the function it calls; `publish` for a loop in which something is published."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A declared parameter, or a value in a parameter file. `default` is text as written (`0.05`, `/dev/ttyUSB0`).
    `node` is the node name or pattern of a parameter file, empty for a declaration in code.
    """

    name: str
    default: str
    file: str
    line: int
    node: str = ""
    owner: str = ""
