"""Which nodes exchange messages: names of topics, services and actions resolved per launched node, then matched."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Final

from ros_profile.decide.launching import Launched, absolute
from ros_profile.decide.substitution import resolve
from ros_profile.decide.workspace import Index
from ros_profile.model.conclusions import Edge, GraphName
from ros_profile.model.endpoints import PARAMETER_MARK, Endpoint, Parameter, Role
from ros_profile.model.launch import UNKNOWN_TEXT
from ros_profile.model.package import Unit

MAX_EDGES: Final = 2000
MAX_PAIRS: Final = 500_000
"""Of a sender and a receiver of one name, of one launch file; those of real ones are some thousands."""
_PAIRS: Final = (
    ("Topic", Role.PUBLISHER, Role.SUBSCRIPTION),
    ("Service", Role.SERVICE_CLIENT, Role.SERVICE_SERVER),
    ("Action", Role.ACTION_CLIENT, Role.ACTION_SERVER),
)
_NAME: Final = re.compile(r"[~/\w{}.$()?-]{1,256}")
_QUIET: Final = frozenset({"/rosout", "/parameter_events", "/tf", "/tf_static", "/clock"})
"""Topics that every node has: no edge for placement follows from them."""
_MAX_PLUGINS: Final = 50
_MAX_WILDCARDS: Final = 20
"""Node patterns with * that are compared with one node."""
_MAX_PATTERN: Final = 200
_PART: Final = re.compile(r"\*\*/?|\*|[^*]+")


@dataclass(frozen=True, slots=True)
class Ends:
    """A launched node with its resolved names."""

    launched: Launched
    full_name: str
    graph: tuple[GraphName, ...]


_End = tuple[Ends, GraphName]


def ends_of(launched: Launched, unit: Unit | None, index: Index) -> Ends:
    """The topics, services and actions of a node as they are called on the graph."""
    name = launched.name or _default_name(launched, unit, index)
    full_name = absolute(name, launched.namespace)
    if unit is None:
        return Ends(launched, full_name, ())
    values = _parameters(launched, unit, full_name, index)
    found: dict[tuple[str, str, str], GraphName] = {}
    for endpoint in (*unit.endpoints, *_of_plugins(values, index)):
        written = endpoint.name
        if written.startswith(PARAMETER_MARK):
            written = values.get(written.removeprefix(PARAMETER_MARK), "")
        if not written or UNKNOWN_TEXT in written or not _NAME.fullmatch(written):
            continue
        topic = graph_name(written, full_name, launched.namespace, launched.remaps)
        key = (endpoint.role.value, topic, endpoint.type)
        found.setdefault(key, _graph_name(endpoint, topic))
    return Ends(launched, full_name, tuple(found.values()))


def _of_plugins(values: Mapping[str, str], index: Index) -> Iterator[Endpoint]:
    """What plug-ins make that are loaded because a parameter names their class: it is made on this node."""
    classes = dict.fromkeys(value for value in values.values() if "::" in value or "/" in value)
    for name in list(classes)[:_MAX_PLUGINS]:
        unit = index.plugin_unit(name)
        if unit is not None:
            yield from unit.endpoints


def _graph_name(endpoint: Endpoint, topic: str) -> GraphName:
    return GraphName(endpoint.role.value, topic, endpoint.type, endpoint.qos, endpoint.file, endpoint.line)


def _default_name(launched: Launched, unit: Unit | None, index: Index) -> str:
    """The name in the code, when there is exactly one; else the executable's."""
    package = index.package(launched.package)
    if unit is not None and package is not None:
        names = {n for s in package.sources if s.file in unit.files for n in s.node_names if not n.startswith("$")}
        if len(names) == 1:
            return names.pop()
        snake = _snake(launched.plugin) or launched.executable
        if fitting := [name for name in names if snake in (name, _snake(name), f"{name}_node")]:
            return fitting[0]
    plugin = launched.plugin.replace("::", "/").rpartition("/")[2]
    return launched.executable.removesuffix(".py") or plugin


def _snake(plugin: str) -> str:
    """`pkg::PointCloudNode` as its node is mostly called: `point_cloud_node`."""
    simple = plugin.replace("/", "::").rpartition("::")[2]
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", simple).lower()


def _parameters(launched: Launched, unit: Unit, full_name: str, index: Index) -> dict[str, str]:
    """Values by parameter: of the launch file, of parameter files, else the default of the code."""
    values = {p.name: p.default for p in unit.parameters if not p.node and p.default}
    values.update({p.name: p.default for p in file_parameters(launched, full_name, index)})
    values.update({name: value for name, value in launched.parameters if value})
    return values


def file_parameters(launched: Launched, full_name: str, index: Index) -> Iterator[Parameter]:
    """Yields what the parameter files of a launched node give to it, with substitutions replaced and files named by package."""
    patterns = _Patterns(full_name)
    for file in dict.fromkeys(launched.parameter_files):
        package, _, path = file.partition("/")
        source = index.parameter_file(package, path)
        for parameter in source.parameters if source is not None else ():
            if parameter.default and patterns.mean(parameter.node):
                value = resolve(parameter.default, launched.values)
                yield replace(parameter, default=value, file=f"{package}/{parameter.file}")


@dataclass(slots=True)
class _Patterns:
    """Which node patterns of parameter files (`/**`, `ns/node`, `/*/node`) mean one node."""

    full_name: str
    known: dict[str, bool] = field(default_factory=dict)
    compared: int = 0

    def mean(self, pattern: str) -> bool:
        if pattern not in self.known:
            full, stripped = self.full_name.strip("/"), pattern.strip("/")
            if "*" in stripped and stripped != "**":
                self.compared += 1
                self.known[pattern] = self.compared <= _MAX_WILDCARDS and _fits(stripped, full)
            else:
                self.known[pattern] = stripped in ("", "**", full, full.rpartition("/")[2])
        return self.known[pattern]


def _fits(pattern: str, name: str) -> bool:
    """Whether a name has the form of a pattern, by following all places at which its parts may end: a regular expression of
    many `**` takes longer than anybody waits.
    """
    places = {0}
    for part in _PART.findall(pattern[:_MAX_PATTERN]):
        first = min(places, default=len(name) + 1)
        if part == "**":
            places = set(range(first, len(name) + 1))
        elif part == "**/":
            places |= {at + 1 for at in range(first, len(name)) if name[at] == "/"}
        elif part == "*":
            ends = ((at, name.find("/", at)) for at in places)
            places = {at for begin, end in ends for at in range(begin, (len(name) if end < 0 else end) + 1)}
        else:
            places = {at + len(part) for at in places if name.startswith(part, at)}
    return len(name) in places


def graph_name(written: str, full_name: str, namespace: str, remaps: Iterable[tuple[str, str]]) -> str:
    """A name of the source as it is on the graph: private and relative names expanded, the first remap that fits applied."""
    expanded = _expanded(written, full_name, namespace)
    for source, target in remaps:
        if source and target and _expanded(source, full_name, namespace) == expanded:
            return _expanded(target, full_name, namespace)
    return expanded


def _expanded(name: str, full_name: str, namespace: str) -> str:
    name = name.partition(":=")[0].replace("{node}", full_name.rpartition("/")[2]).replace("{ns}", namespace)
    name = name.replace("{namespace}", namespace)
    if name.startswith("~"):
        return absolute(name[1:].lstrip("/"), full_name)
    return absolute(name, namespace)


def edges(nodes: Iterable[Ends]) -> tuple[Edge, ...]:
    """Every pair of nodes that a topic, service or action connects, sorted; the first MAX_EDGES of MAX_PAIRS that are looked at."""
    found: dict[tuple[str, str, str, str], Edge] = {}
    for kind, sender, receiver in islice(_pairs(list(nodes)), MAX_PAIRS):
        (source, sent), (target, received) = sender, receiver
        if target.full_name != source.full_name and _may_match(sent.type, received.type):
            if len(found) >= MAX_EDGES:
                break
            edge = _edge(kind, sender, receiver)
            found.setdefault((kind, edge.topic, edge.source, edge.target), edge)
    return tuple(found[key] for key in sorted(found))


def _pairs(nodes: list[Ends]) -> Iterator[tuple[str, _End, _End]]:
    """Kind, sender and receiver of one name: of many nodes that all have many names there are millions."""
    for kind, sending, receiving in _PAIRS:
        receivers = _by_name(nodes, receiving)
        for node, sent in _names(nodes):
            if sent.role == sending.value and sent.name not in _QUIET:
                for received in receivers.get(sent.name, ()):
                    yield kind, (node, sent), received


def _by_name(nodes: Iterable[Ends], role: Role) -> Mapping[str, list[_End]]:
    found: dict[str, list[_End]] = {}
    for node, name in _names(nodes):
        if name.role == role.value:
            found.setdefault(name.name, []).append((node, name))
    return found


def _names(nodes: Iterable[Ends]) -> Iterator[_End]:
    for node in nodes:
        for name in node.graph:
            yield node, name


def _may_match(first: str, second: str) -> bool:
    """Types that differ do not connect; a type that is known only in part may be the same."""
    if not first or not second:
        return True
    if "/" in first and "/" in second:
        return first == second
    return first.rpartition("/")[2] == second.rpartition("/")[2] or not (first[:1].isupper() and second[:1].isupper())


def _edge(kind: str, sender: _End, receiver: _End) -> Edge:
    source, sent = sender
    target, received = receiver
    certain = source.launched.certain and target.launched.certain
    same = bool(sent.type) and sent.type == received.type
    return Edge(
        kind=kind,
        topic=sent.name,
        type=sent.type if "/" in sent.type else received.type or sent.type,
        source=source.full_name,
        target=target.full_name,
        qos=sent.qos,
        requested_qos=received.qos,
        confidence=(0.95 if same else 0.75) * (1.0 if certain else 0.6),
    )
