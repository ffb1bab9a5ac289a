"""Orders boxes and their components from top to bottom so that few lines cross: the barycentre method of layered layouts."""

from bisect import bisect_right, insort
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

SWEEPS: Final = 12
_SAME_LANE: Final = 0.5
"""Weight of a neighbour in the same lane: nearness shortens a line there, but saves no crossing between lanes."""


@dataclass(frozen=True, slots=True)
class Part:
    """A component: `box` is the node it is drawn in, `lane` the position of its lane from the left."""

    name: str
    box: str
    lane: int


@dataclass(frozen=True, slots=True)
class Link:
    """A line from one part to another, by their positions in the list of parts. `label_width` is in pixels."""

    source: int
    target: int
    label_width: float = 0.0


@dataclass(slots=True)
class Cell:
    """Vertices that stay together: the parts of one box, or one passage of a line through a lane between its ends."""

    name: str
    members: list[int]
    is_passage: bool = False


@dataclass(slots=True)
class Order:
    """The cells of each lane from top to bottom. Vertices below the number of parts are parts, the others are passages."""

    lanes: list[list[Cell]]
    chains: list[tuple[int, ...]]
    """The vertices of each link, from its source to its target."""
    neighbours: dict[int, list[int]] = field(default_factory=dict)
    """The vertices of other lanes that each one is linked to."""

    def find_places(self) -> dict[int, float]:
        """Returns how far down each vertex is in its lane, between 0 and 1."""
        places: dict[int, float] = {}
        for cells in self.lanes:
            vertices = [vertex for cell in cells for vertex in cell.members]
            places |= {vertex: (row + 0.5) / len(vertices) for row, vertex in enumerate(vertices)}
        return places


def order_parts(parts: Sequence[Part], links: Sequence[Link]) -> Order:
    """Returns the best order of a fixed number of sweeps; equal inputs give equal orders."""
    order = _make_first_order(parts, links)
    lane_of = {vertex: lane for lane, cells in enumerate(order.lanes) for cell in cells for vertex in cell.members}
    neighbours = _collect_neighbours(order.chains, lane_of)
    best, best_cost = order.lanes, _count_cost(order, lane_of)
    for sweep in range(SWEEPS):
        backwards = sweep % 2 == 1
        lanes = range(len(order.lanes))
        for lane in reversed(lanes) if backwards else lanes:
            _sort_lane(order, lane, neighbours)
        cost = _count_cost(order, lane_of)
        if cost < best_cost:
            best, best_cost = (
                [[Cell(c.name, list(c.members), c.is_passage) for c in cells] for cells in order.lanes],
                cost,
            )
    across = {
        vertex: [other for other, _ in near if lane_of[other] != lane_of[vertex]] for vertex, near in neighbours.items()
    }
    return Order(best, order.chains, defaultdict(list, across))


def _make_first_order(parts: Sequence[Part], links: Sequence[Link]) -> Order:
    """Returns boxes and components by name, and a passage for each lane between the ends of a link."""
    lanes: list[dict[str, Cell]] = [{} for _ in range(max((part.lane for part in parts), default=-1) + 1)]
    for position, part in sorted(enumerate(parts), key=lambda item: (item[1].box, item[1].name)):
        lanes[part.lane].setdefault(part.box, Cell(part.box, [])).members.append(position)
    cells = [list(boxes.values()) for boxes in lanes]
    chains, vertex = [], len(parts)
    for link in links:
        near, far = parts[link.source].lane, parts[link.target].lane
        step = 1 if far > near else -1
        passages = []
        for lane in range(near + step, far, step) if near != far else ():
            cells[lane].append(Cell("", [vertex], is_passage=True))
            passages.append(vertex)
            vertex += 1
        chains.append((link.source, *passages, link.target))
    return Order(cells, chains)


def _collect_neighbours(
    chains: Iterable[tuple[int, ...]], lane_of: Mapping[int, int]
) -> dict[int, list[tuple[int, float]]]:
    neighbours: dict[int, list[tuple[int, float]]] = defaultdict(list)
    for chain in chains:
        for one, other in pairwise(chain):
            weight = 1.0 if lane_of[one] != lane_of[other] else _SAME_LANE
            neighbours[one].append((other, weight))
            neighbours[other].append((one, weight))
    return neighbours


def _sort_lane(order: Order, lane: int, neighbours: Mapping[int, list[tuple[int, float]]]) -> None:
    """Sorts cells, and vertices in them, by the mean place of their neighbours; names and positions decide between equals."""
    places = order.find_places()

    def find_centre(vertex: int) -> float:
        near = neighbours.get(vertex, ())
        total = sum(weight for _, weight in near)
        return sum(places[other] * weight for other, weight in near) / total if total else places[vertex]

    centres = {vertex: find_centre(vertex) for cell in order.lanes[lane] for vertex in cell.members}
    for cell in order.lanes[lane]:
        cell.members.sort(key=lambda vertex: (centres[vertex], vertex))
    order.lanes[lane].sort(
        key=lambda cell: (
            sum(centres[vertex] for vertex in cell.members) / len(cell.members),
            cell.name,
            cell.members[0],
        )
    )


def _count_cost(order: Order, lane_of: Mapping[int, int]) -> tuple[int, float]:
    """Returns the crossings between lanes, then the length of the lines within lanes."""
    places = order.find_places()
    between: dict[int, list[tuple[float, float]]] = defaultdict(list)
    length = 0.0
    for chain in order.chains:
        for one, other in pairwise(chain):
            left, right = (one, other) if lane_of[one] <= lane_of[other] else (other, one)
            if lane_of[left] == lane_of[right]:
                length += abs(places[left] - places[right])
            else:
                between[lane_of[left]].append((places[left], places[right]))
    return sum(_count_crossings(lines) for lines in between.values()), round(length, 6)


def _count_crossings(lines: list[tuple[float, float]]) -> int:
    """Returns how many pairs of lines between two lanes cross."""
    crossings = 0
    right_ends: list[float] = []
    for _, right in sorted(lines):
        crossings += len(right_ends) - bisect_right(right_ends, right)
        insort(right_ends, right)
    return crossings
