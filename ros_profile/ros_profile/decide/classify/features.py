"""What of a unit speaks for a class: named features with the facts behind them. Weights stand in `weights.py`."""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

from ros_profile.knowledge import roles
from ros_profile.knowledge.libraries import ROLE_SYMBOLS
from ros_profile.model.endpoints import Endpoint, Role
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.package import Unit

_TEST_FILE = re.compile(r"(?:^|/)(?:tests?|testing|benchmarks?)/|(?:^|/)test_[^/]*$|_test\.\w+$|(?:^|/)conftest\.py$")
MEMORY = 1 << 16
"""Answers kept: the same names come back in every executable of a workspace (without it, judging takes three times as long)."""
_OUT = {Role.PUBLISHER: "pub", Role.SUBSCRIPTION: "sub"}
_SERVED = {
    Role.SERVICE_SERVER: "serve:service",
    Role.ACTION_SERVER: "serve:action",
    Role.SERVICE_CLIENT: "call:service",
    Role.ACTION_CLIENT: "call:action",
}
MOST_WORDS = 40
"""Of a description; what follows is about other packages."""
_CLI_EXPORT = re.compile(r"ros2cli|ros2_?\w*\.(?:command|verb)")


@dataclass(slots=True)
class Features:
    """Facts by feature name."""

    found: dict[str, list[Fact]] = field(default_factory=lambda: defaultdict(list))

    def add(self, name: str, fact: Fact) -> None:
        self.found[name].append(fact)

    def __contains__(self, name: str) -> bool:
        return name in self.found

    def any(self, *names: str) -> bool:
        return any(name in self.found for name in names)


@lru_cache(maxsize=MEMORY)
def is_test(file: str) -> bool:
    return _TEST_FILE.search(file) is not None


def features(unit: Unit) -> Features:
    found = Features()
    facts = [fact for fact in unit.facts if not is_test(fact.file)]
    endpoints = [e for e in unit.endpoints if not is_test(e.file)]
    _from_bases(found, facts, unit.package.name)
    _from_endpoints(found, endpoints)
    _from_libraries(found, facts)
    _from_words(found, unit)
    _from_shape(found, unit, facts)
    return found


@lru_cache(maxsize=MEMORY)
def _of_base(name: str) -> str:
    return _role(roles.PLUGIN_BASES, name)


@lru_cache(maxsize=MEMORY)
def _of_library(name: str) -> str:
    return _role(ROLE_SYMBOLS, name)


@lru_cache(maxsize=MEMORY)
def _of_dependency(name: str) -> str:
    return _role(roles.DEPENDENCIES, name)


def _role(table: Iterable[tuple[re.Pattern[str], str]], text: str) -> str:
    return next((role for pattern, role in table if pattern.search(text)), "")


_DRIVING = frozenset({"hardware", "controller"})


def _is_simulated(plugin: str, package: str) -> bool:
    """Returns whether a plug-in stands in for a device: by the words of its own name, or of its package's."""
    return any("simulation" in name_roles(name) for name in (plugin.replace("/", "::").rpartition("::")[2], package))


def _from_bases(found: Features, facts: list[Fact], package: str) -> None:
    """Plug-ins by their base class, classes by what they inherit, and hosts by what they load."""
    registered = {fact.value for fact in facts if fact.kind is Kind.PLUGIN_BASE}
    reporting = {f.value for f in facts if f.kind is Kind.INHERITS and roles.REPORTING_CONTROLLER.search(f.subject)}
    for fact in facts:
        if fact.kind is Kind.PLUGIN_BASE and (role := _of_base(fact.subject)):
            broadcaster = role == "controller" and (
                "roadcaster" in fact.value or fact.value.rpartition("::")[2] in reporting
            )
            if role in _DRIVING and _is_simulated(fact.value, package):
                found.add("plugin:simulated", fact)
                continue
            found.add("plugin:broadcaster" if broadcaster else f"plugin:{role}", fact)
        elif fact.kind is Kind.INHERITS and fact.value not in registered:
            if role := _of_base(fact.subject):
                stands_in = role in _DRIVING and _is_simulated(fact.value, package)
                found.add("plugin:simulated" if stands_in else f"inherits:{role}", fact)
        elif fact.subject == "pluginlib::ClassLoader" and (role := _of_base(fact.value)):
            found.add(f"hosts:{role}", fact)


def _from_endpoints(found: Features, endpoints: list[Endpoint]) -> None:
    publishes_sensor = any(e.role is Role.PUBLISHER and e.type in roles.SENSOR_TYPES for e in endpoints)
    for endpoint in endpoints:
        if endpoint.role in _OUT:
            for name in _stream(endpoint, publishes_sensor=publishes_sensor):
                found.add(f"{_OUT[endpoint.role]}:{name}", _fact(endpoint))
            continue
        name = _SERVED[endpoint.role]
        if roles.MOTION_ACTIONS.search(endpoint.type):
            name = f"{name.split(':')[0]}:motion"
        elif roles.PLANNING_ACTIONS.search(endpoint.type):
            name = f"{name.split(':')[0]}:planning"
        found.add(name, _fact(endpoint))


def _stream(endpoint: Endpoint, *, publishes_sensor: bool) -> Iterator[str]:
    """What a topic carries, by its type and by its name."""
    kind, topic = endpoint.type, endpoint.name.removeprefix("$param:")
    named = roles.COMMAND_TOPIC.search(topic) is not None
    measured = kind in roles.MEASURED_COMMAND_TYPES and (publishes_sensor or not named)
    if kind in roles.COMMAND_TYPES and not measured:
        yield "command"
    elif named and kind in roles.SIGNAL_TYPES:
        yield "command_text"
    elif named:
        yield "command" if not kind or kind.startswith(("std_msgs/", "geometry_msgs/")) else "command_name"
    elif kind in roles.SENSOR_TYPES:
        yield "sensor"
    elif kind == roles.JOY:
        yield "joy"
    elif kind in roles.FIELDBUS_TYPES:
        yield "fieldbus"
    elif kind in roles.STATE_TYPES:
        yield "state"
    elif kind in roles.DISPLAY_TYPES:
        yield "display"
    elif kind == "diagnostic_msgs/msg/DiagnosticArray":
        yield "diagnostics"
    elif roles.INTERPRETED.search(kind):
        yield "interpreted"
    elif kind in roles.POSE_TYPES:
        yield "pose"
    elif kind == "tf2_msgs/msg/TFMessage":
        yield "tf"
    elif kind == "nav_msgs/msg/Path":
        yield "path"
    elif kind or topic:
        yield _own_message(kind, topic)


def _own_message(kind: str, topic: str) -> str:
    """Returns what plain numbers, texts and messages of the repository's own carry, by the words of their names."""
    if roles.COMMAND_TYPE_NAME.search(kind):
        return "command_name"
    if roles.ACTUATOR_TOPIC.search(topic.lower()):
        return "command_text" if kind == "std_msgs/msg/String" else "command_name"
    if roles.MEASURED_TYPE_NAME.search(kind) or roles.MEASURED_TOPIC.search(topic.lower()):
        return "measured"
    return "other"


def _fact(endpoint: Endpoint) -> Fact:
    kind = {
        Role.PUBLISHER: Kind.PUBLISHES,
        Role.SUBSCRIPTION: Kind.SUBSCRIBES,
        Role.SERVICE_SERVER: Kind.SERVES,
        Role.ACTION_SERVER: Kind.SERVES,
    }.get(endpoint.role, Kind.CALLS)
    return Fact(kind, endpoint.type, endpoint.name, endpoint.file, endpoint.line)


def _from_libraries(found: Features, facts: list[Fact]) -> None:
    for fact in facts:
        if fact.kind in {Kind.SYMBOL, Kind.INCLUDE}:
            if role := _of_library(fact.subject):
                found.add(f"uses:{role}", fact)
        elif fact.kind is Kind.DEPENDENCY and (role := _of_dependency(fact.subject)):
            found.add(f"needs:{role}", fact)
        elif fact.kind is Kind.COMPONENT:
            found.add("is:component", fact)
        elif fact.kind is Kind.HARDWARE_PLUGIN:
            found.add("names:hardware_plugin", fact)
        elif fact.kind is Kind.EXPORT and _CLI_EXPORT.search(fact.subject):
            found.add("plugin:tool", fact)


@lru_cache(maxsize=MEMORY)
def name_roles(name: str) -> tuple[str, ...]:
    """Roles that words of a name tell, the last word first: `image_view` is a view of images, not an image source."""
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower().replace("-", "_")
    padded = f"_{text}_"
    scored: list[tuple[int, int, str]] = []
    for role, words in roles.WORDS:
        places = [padded.rfind(f"_{word}_") + len(word) for word in words.split() if f"_{word}_" in padded]
        if places:
            scored.append((max(places), max(len(w) for w in words.split() if f"_{w}_" in padded), role))
    return tuple(role for _, _, role in sorted(scored, reverse=True))


@lru_cache(maxsize=MEMORY)
def described_roles(description: str, name: str) -> tuple[str, ...]:
    """Returns the role of the first telling word of a description that is not the name's, and simulation wherever it stands."""
    own = {"description", *name.lower().split("_")}
    words = [word for word in re.findall(r"[a-z0-9]+", description.lower())[:MOST_WORDS] if word not in own]
    found = [role for word in words for role, listed in roles.WORDS if word in listed.split()]
    return tuple(dict.fromkeys([*found[:1], *(role for role in found if role == "simulation")]))


def _from_words(found: Features, unit: Unit) -> None:
    named = name_roles(unit.package.name)
    for index, role in enumerate(named[:3]):
        place = "last" if index == 0 else "other"
        found.add(
            f"word:{role}" if place == "last" else f"word2:{role}",
            Fact(Kind.NAME, unit.package.name, role, unit.package.file),
        )
    for role in described_roles(unit.package.description, unit.package.name):
        found.add(f"told:{role}", Fact(Kind.NAME, unit.package.description[:80], role, unit.package.file))
    if unit.kind != "package":
        for role in name_roles(unit.name)[:1]:
            found.add(f"program:{role}", Fact(Kind.NAME, unit.name, role))


def _from_shape(found: Features, unit: Unit, facts: list[Fact]) -> None:
    """What is there at all: a package without nodes, launch files only, servers without streams."""
    manifest = Fact(Kind.NAME, unit.package.name, "", unit.package.file)
    if unit.kind == "package" and unit.files and not _has_node(facts, found):
        found.add(_shape_without_node(unit, facts), manifest)
    streams = ("pub:command", "sub:command", "pub:sensor", "sub:sensor", "pub:interpreted", "pub:state", "pub:joy")
    own_streams = ("pub:command_name", "sub:command_name", "pub:measured", "sub:measured")
    servers = ("serve:service", "serve:action", "serve:planning", "call:action", "call:planning")
    if not found.any(*streams, *own_streams) and found.any(*servers):
        found.add("shape:servers_only", manifest)
    if found.any("uses:display") and found.any("word:display", "word2:display"):
        found.add("shape:viewer", found.found["uses:display"][0])
    _from_streams(found)


def _has_node(facts: list[Fact], found: Features) -> bool:
    made = any(fact.kind in {Kind.NODE, Kind.COMPONENT, Kind.PLUGIN_BASE} for fact in facts)
    return made or any(name.startswith(("pub:", "sub:", "serve:", "call:")) for name in found.found)


def _shape_without_node(unit: Unit, facts: list[Fact]) -> str:
    starts = any(fact.kind is Kind.STARTS for fact in facts)
    if unit.languages & {"cpp", "python"}:
        return "shape:launch_and_code" if starts else "shape:no_node"
    return "shape:launch_only" if starts else "shape:no_code"


def _from_streams(found: Features) -> None:
    """What comes in and what goes out, taken together."""
    first = {name: inside[0] for name, inside in found.found.items()}
    if "pub:sensor" in found and "sub:sensor" in found and not found.any("sub:command", "pub:command"):
        found.add("shape:sensor_filter", first["sub:sensor"])
    made_of_it = ("pub:sensor", "pub:interpreted", "pub:command", "pub:pose", "pub:tf", "pub:other")
    if "sub:sensor" in found and not found.any(*made_of_it):
        found.add("shape:sensor_sink", first["sub:sensor"])
    hands = ("uses:terminal", "sub:joy", "word:teleop")
    if "pub:command" in found and not found.any("sub:sensor", "sub:command", "pub:sensor") and found.any(*hands):
        found.add("shape:operator", first["pub:command"])
    driving = [fact for fact in found.found.get("pub:command", ()) if fact.subject == "geometry_msgs/msg/Twist"]
    if driving and found.any("plugin:display", "inherits:display"):
        found.add("shape:operator_panel", driving[0])
    if "pub:sensor" in found and not found.any("sub:sensor", "sub:command", "pub:command"):
        found.add("shape:sensor_source", first["pub:sensor"])
