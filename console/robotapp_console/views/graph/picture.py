"""The picture of one instance: what is drawn where, in which colour and line, with which words."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Final
from unicodedata import east_asian_width

from robotapp_api.model.names import Label
from robotapp_console.views.app.edges import ESTIMATED, MEASURED, SAME_NODE, UNKNOWN, UNREACHABLE, EdgeRow
from robotapp_console.views.graph.layout import Layout, Rectangle, lay_out
from robotapp_console.views.graph.ordering import Link, Part

LANES: Final = ("robot", "edge", "cloud", "nodes of no tier", "no node")
ROBOT, _EDGE, _CLOUD, OTHER, _NONE = range(len(LANES))
TIERS_NOT_READ: Final = "nodes (their tiers may not be read)"
CHARACTER: Final = 6.7
"""Width of a character of a label in pixels: they are of a fixed-width font."""
NAME_CHARACTER: Final = 7.6
MOST_NAME: Final = 24
MOST_TOPIC: Final = 26
TIME: Final = 9
"""Characters kept free for a time with its marks, such as `▲ ≈0.05/`: a new measurement must not move anything."""
LINES: Final[Mapping[str, str]] = {
    MEASURED: "measured",
    SAME_NODE: "measured",
    ESTIMATED: "estimated",
    UNKNOWN: "unknown",
}


@dataclass(frozen=True, slots=True)
class Node:
    """A component to draw: `node` is where it runs, empty while it waits."""

    name: str
    node: str
    colour: str
    words: str


@dataclass(frozen=True, slots=True)
class DrawnLane:
    title: str
    area: Rectangle


@dataclass(frozen=True, slots=True)
class DrawnBox:
    title: str
    full_title: str
    area: Rectangle


@dataclass(frozen=True, slots=True)
class DrawnPart:
    title: str
    words: str
    colour: str
    area: Rectangle


@dataclass(frozen=True, slots=True)
class DrawnEdge:
    """`line` names the pattern of the line, `words` are shown on hover."""

    path: str
    arrow: str
    colour: str
    line: str
    topic: str
    figures: str
    words: str
    x: float
    y: float
    anchor: str


@dataclass(frozen=True, slots=True)
class Picture:
    """Everything that the template draws."""

    title: str
    description: str
    width: float
    height: float
    lanes: tuple[DrawnLane, ...]
    boxes: tuple[DrawnBox, ...]
    parts: tuple[DrawnPart, ...]
    edges: tuple[DrawnEdge, ...]


def read_lane(labels: Mapping[str, str] | None) -> int:
    """Returns the lane of a node by its labels; None for a node that cannot be read."""
    if labels is None:
        return OTHER
    tier = LANES[ROBOT] if labels.get(Label.ROBOT) else labels.get(Label.TIER, "")
    return LANES.index(tier) if tier in LANES[:OTHER] else OTHER


def draw_picture(
    title: str,
    components: Sequence[Node],
    edges: Sequence[EdgeRow],
    *,
    lane_of: Callable[[str], int],
    are_tiers_known: bool = True,
) -> Picture:
    """Returns the picture of an instance; `lane_of` gives the lane of a node.

    The operator lists the worst first, which changes with every measurement: here names decide.
    """
    edges = sorted(edges, key=lambda edge: (edge.source, edge.target, edge.topic))
    vertices = sorted([*components, *_list_other_ends(components, edges)], key=lambda vertex: vertex.name)
    position = {vertex.name: i for i, vertex in enumerate(vertices)}
    lanes = [lane_of(vertex.node) if vertex.node else _NONE for vertex in vertices]
    used_lanes = sorted(set(lanes))
    layout = lay_out(
        [Part(vertex.name, vertex.node, used_lanes.index(lane)) for vertex, lane in zip(vertices, lanes, strict=True)],
        [Link(position[edge.source], position[edge.target], _measure_label(edge)) for edge in edges],
        part_width=max((_measure_part(vertex) for vertex in vertices), default=0.0),
    )
    return Picture(
        title,
        _describe(vertices, edges),
        layout.width,
        layout.height,
        tuple(
            DrawnLane(TIERS_NOT_READ if lane == OTHER and not are_tiers_known else LANES[lane], area)
            for lane, area in zip(used_lanes, layout.lanes, strict=True)
        ),
        tuple(_draw_box(box.name, box.area) for box in layout.boxes),
        tuple(
            DrawnPart(_shorten_end(vertex.name, MOST_NAME), vertex.words, vertex.colour, area)
            for vertex, area in zip(vertices, layout.parts, strict=True)
        ),
        tuple(_draw_edges(edges, layout)),
    )


def _list_other_ends(components: Iterable[Node], edges: Iterable[EdgeRow]) -> list[Node]:
    """Returns ends that no component has the name of: a component that the status does not have (yet)."""
    names = {component.name for component in components}
    ends = dict.fromkeys(end for edge in edges for end in (edge.source, edge.target) if end not in names)
    return [Node(end, "", "idle", f"{end}: not running") for end in ends]


def _draw_box(name: str, area: Rectangle) -> DrawnBox:
    return DrawnBox(_title_box(name), name or "Components without a node", area)


def _title_box(node: str) -> str:
    """Returns the name of the node; what has none waits for one, or is suspended."""
    return _shorten_end(node, MOST_NAME) if node else "not running"


def _measure_part(vertex: Node) -> float:
    """Returns the width that the component's name needs, and the name of its node above it."""
    name_cells, title_cells = _count_cells(_shorten_end(vertex.name, MOST_NAME)), _count_cells(_title_box(vertex.node))
    return max(name_cells * NAME_CHARACTER + 24, title_cells * CHARACTER + 8)


def _draw_edges(edges: Sequence[EdgeRow], layout: Layout) -> Iterable[DrawnEdge]:
    for edge, route in zip(edges, layout.routes, strict=True):
        yield DrawnEdge(
            route.line,
            route.arrow,
            edge.colour,
            LINES[edge.knowledge],
            _shorten_begin(edge.topic, MOST_TOPIC),
            format_figures(edge),
            describe_edge(edge),
            route.label_x,
            route.label_y,
            route.anchor,
        )


def format_figures(edge: EdgeRow) -> str:
    """Returns `18/30 ms`, with a mark for what the colour and the line say: `≈` estimated, `?` unknown, `▲` exceeded."""
    time = edge.time.removesuffix(" ms") if edge.budget.endswith(" ms") else edge.time
    if edge.time == UNREACHABLE:
        time = "lost"
    elif edge.knowledge == ESTIMATED:
        time = f"≈{time}"
    budget = edge.budget.replace(", median", " p50")
    figures = f"{time or '?'}/{budget}" if budget else time
    return f"▲ {figures}" if edge.colour == "bad" else figures


def describe_edge(edge: EdgeRow) -> str:
    """Returns the edge as a sentence, for who points at it."""
    budget = f", budget {edge.budget}" if edge.budget else ", no budget"
    share = f", {edge.share} % of it" if edge.share is not None else ""
    verdict = f", {edge.verdict}" if edge.verdict else ""
    time = f"p95 {edge.time}, {edge.how_known}" if edge.time else "time unknown"
    return f"{edge.topic}, {edge.ends}: {time}{budget}{share}{verdict}"


def _describe(vertices: Sequence[Node], edges: Sequence[EdgeRow]) -> str:
    nodes = {vertex.node for vertex in vertices if vertex.node}
    exceeded = sum(edge.colour == "bad" for edge in edges)
    return (
        f"{len(vertices)} components on {len(nodes)} nodes and {len(edges)} edges between them, "
        f"{exceeded} of them above their budget. The tables below have the same names and figures."
    )


def _measure_label(edge: EdgeRow) -> float:
    return (_count_cells(_shorten_begin(edge.topic, MOST_TOPIC)) + 1 + TIME + len(edge.budget)) * CHARACTER


def _count_cells(text: str) -> int:
    """Returns how many columns a text takes in a fixed-width font."""
    return sum(2 if east_asian_width(character) in "WF" else 1 for character in text)


def _shorten_end(text: str, most: int) -> str:
    """Returns at most so many columns of a text, with its end cut. The rest of it is not read: a tenant makes topics' names as long as he likes."""
    if len(text) <= most and _count_cells(text) <= most:
        return text
    columns = accumulate(_count_cells(character) for character in text[:most])
    kept_count = sum(column < most for column in columns)
    return f"{text[:kept_count]}…"


def _shorten_begin(text: str, most: int) -> str:
    """Returns at most so many columns of a text, with its beginning cut: the end of a topic's name tells more."""
    nearest_first = text[: -most - 2 : -1]
    return _shorten_end(nearest_first, most)[::-1]
