"""Places of boxes and lines in pixels.

Lanes are columns, boxes stand in them one below the other, and each line has a row of its own where it leaves a component and
where it arrives. So labels, which stand on the row where a line begins, never cover each other. Between two lanes a line is a
curve; to another component of the same lane it goes around on the right, in a track of its own. The places follow from names
and structure alone: a new measurement moves nothing.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from robotapp_console.views.graph.alignment import DesiredPlace, place_cells
from robotapp_console.views.graph.ordering import Cell, Link, Part, order_parts
from robotapp_console.views.graph.routes import Crossing, End, draw_arrow, draw_curves, draw_loop

MARGIN: Final = 12
HEAD: Final = 26
"""Room for the title of a lane."""
TITLE: Final = 22
"""Room for the title of a box."""
PAD: Final = 10
GAP: Final = 10
ROW: Final = 16
LEAST_HEIGHT: Final = 32
PASSAGE: Final = 10
TRACK: Final = 8
CURVE: Final = 72
"""Width in which lines change their row."""
STUB: Final = 22
"""Length of a line beside a component before its label ends or its curve begins."""
LEFT, RIGHT = -1, 1


@dataclass(frozen=True, slots=True)
class Rectangle:
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Box:
    """The frame around the parts on one node."""

    name: str
    lane: int
    area: Rectangle


@dataclass(frozen=True, slots=True)
class Route:
    """A line and the head of its arrow as path data; the label begins (`start`) or ends (`end`) at its place."""

    line: str
    arrow: str
    label_x: float
    label_y: float
    anchor: str


@dataclass(frozen=True, slots=True)
class Layout:
    """All places. `parts` and `routes` are in the order of what was given."""

    width: float
    height: float
    lanes: tuple[Rectangle, ...]
    boxes: tuple[Box, ...]
    parts: tuple[Rectangle, ...]
    routes: tuple[Route, ...]


@dataclass(frozen=True, slots=True)
class _Column:
    """A lane's room from left to right: labels of lines that leave to the left, parts, labels to the right, tracks of loops."""

    begin: float
    x: float
    label_end: float
    end: float


def lay_out(parts: Sequence[Part], links: Sequence[Link], *, part_width: float) -> Layout:
    """Returns the places of parts and links. Every lane up to the highest one must have a part."""
    return _Builder(parts, links, part_width).build()


class _Builder:
    """The steps of one layout, each with what the steps before it found out."""

    def __init__(self, parts: Sequence[Part], links: Sequence[Link], part_width: float) -> None:
        self._parts = parts
        self._links = links
        self._part_width = part_width
        self._order = order_parts(parts, links)
        self._sides = [_choose_sides(parts[link.source].lane, parts[link.target].lane) for link in links]
        self._heights = self._find_heights()
        self._tops: dict[int, float] = {}
        self._box_tops: dict[tuple[int, str], float] = {}
        self._passages: dict[int, float] = {}
        self._centres: dict[int, float] = {}
        """The centres of all vertices that have a place."""

    def build(self) -> Layout:
        depth = self._stack()
        rows = self._assign_rows()
        tracks = self._assign_tracks(rows)
        columns = self._place_columns(tracks)
        height = 2 * MARGIN + HEAD + depth
        return Layout(
            columns[-1].end + MARGIN if columns else 2 * MARGIN,
            height,
            tuple(
                Rectangle(column.x - PAD, MARGIN, self._part_width + 2 * PAD, height - 2 * MARGIN) for column in columns
            ),
            tuple(self._list_boxes(columns)),
            tuple(
                Rectangle(columns[part.lane].x, self._tops[i], self._part_width, self._heights[i])
                for i, part in enumerate(self._parts)
            ),
            tuple(self._draw(i, rows[i], columns, tracks.get(i)) for i in range(len(self._links))),
        )

    def _lane(self, part: int) -> int:
        return self._parts[part].lane

    def _find_heights(self) -> list[float]:
        """Returns the height of each part: a row per line on the side that has more of them."""
        row_counts: dict[tuple[int, int], int] = defaultdict(int)
        for link, (leaving, arriving) in zip(self._links, self._sides, strict=True):
            row_counts[link.source, leaving] += 1
            row_counts[link.target, arriving] += 1
        return [
            max(LEAST_HEIGHT, PAD + ROW * max(row_counts[i, LEFT], row_counts[i, RIGHT]))
            for i in range(len(self._parts))
        ]

    def _measure_box(self, cell: Cell) -> float:
        return TITLE + sum(self._heights[i] for i in cell.members) + GAP * (len(cell.members) - 1) + PAD

    def _stack(self) -> float:
        """Finds the tops of parts, boxes and passages and returns the depth of the deepest lane.

        That lane is packed; in the others each cell is drawn to what it is linked to, from that lane outwards and once more
        when all have a place.
        """
        lanes = self._order.lanes
        depths = [sum(map(self._measure_cell, cells)) for cells in lanes]
        depth = max(depths, default=0)
        if not lanes:
            return depth
        deepest = depths.index(depth)
        self._place_lane(
            deepest, place_cells([DesiredPlace(self._measure_cell(cell)) for cell in lanes[deepest]], depth)
        )
        shallower_lanes = sorted(set(range(len(lanes))) - {deepest}, key=lambda lane: (abs(lane - deepest), lane))
        for lane in (*shallower_lanes, *shallower_lanes):
            self._place_lane(lane, place_cells([self._find_desired_place(cell, depth) for cell in lanes[lane]], depth))
        return depth

    def _measure_cell(self, cell: Cell) -> float:
        return PASSAGE if cell.is_passage else self._measure_box(cell) + GAP

    def _place_lane(self, lane: int, tops: Sequence[float]) -> None:
        for cell, top in zip(self._order.lanes[lane], tops, strict=True):
            y = MARGIN + HEAD + top
            if cell.is_passage:
                self._passages[cell.members[0]] = self._centres[cell.members[0]] = y + PASSAGE / 2
                continue
            self._box_tops[lane, cell.name] = y
            y += TITLE
            for i in cell.members:
                self._tops[i], self._centres[i] = y, y + self._heights[i] / 2
                y += self._heights[i] + GAP

    def _find_desired_place(self, cell: Cell, depth: float) -> DesiredPlace:
        """Returns where the cell would have to begin for its lines to be straight on average; the middle without any."""
        height = self._measure_cell(cell)
        tops: list[float] = []
        y = PASSAGE / 2 if cell.is_passage else float(TITLE)
        for vertex in cell.members:
            centre = y if cell.is_passage else y + self._heights[vertex] / 2
            neighbours = [neighbour for neighbour in self._order.neighbours[vertex] if neighbour in self._centres]
            tops += [self._centres[neighbour] - MARGIN - HEAD - centre for neighbour in neighbours]
            y += 0 if cell.is_passage else self._heights[vertex] + GAP
        return (
            DesiredPlace(height, sum(tops) / len(tops), len(tops))
            if tops
            else DesiredPlace(height, (depth - height) / 2)
        )

    def _assign_rows(self) -> list[tuple[float, float]]:
        """Returns the rows, as y, in which each line leaves and arrives.

        Lines to components further up in the same lane come first, the nearest on top, then those to other lanes by how far
        down they end, then those further down in the same lane, the nearest last: so lines of one component do not cross.
        """
        at_side: dict[tuple[int, int], list[tuple[int, float, int, int]]] = defaultdict(list)
        for i, (link, sides) in enumerate(zip(self._links, self._sides, strict=True)):
            for end, (part, far_part) in enumerate(((link.source, link.target), (link.target, link.source))):
                at_side[part, sides[end]].append((*self._rank_end(part, far_part), i, end))
        rows = [[0.0, 0.0] for _ in self._links]
        for (part, _), entries in at_side.items():
            first = self._tops[part] + (self._heights[part] - ROW * (len(entries) - 1)) / 2
            for row, (_, _, i, end) in enumerate(sorted(entries)):
                rows[i][end] = first + ROW * row
        return [(leaving, arriving) for leaving, arriving in rows]

    def _rank_end(self, part: int, far_part: int) -> tuple[int, float]:
        near, far = self._centres[part], self._centres[far_part]
        if self._lane(part) != self._lane(far_part) or part == far_part:
            return 1, far
        return (0, -far) if far < near else (2, -far)

    def _assign_tracks(self, rows: Sequence[tuple[float, float]]) -> dict[int, int]:
        """Returns the track of each line within a lane: short lines inside, and no two on one another."""
        tracks: dict[int, int] = {}
        spans: dict[tuple[int, int], list[tuple[float, float]]] = defaultdict(list)
        loops = [i for i, link in enumerate(self._links) if self._lane(link.source) == self._lane(link.target)]
        for i in sorted(loops, key=lambda i: (abs(rows[i][0] - rows[i][1]), i)):
            top, bottom = min(rows[i]), max(rows[i])
            lane, track = self._lane(self._links[i].source), 0
            while any(top <= other_bottom and other_top <= bottom for other_top, other_bottom in spans[lane, track]):
                track += 1
            spans[lane, track].append((top, bottom))
            tracks[i] = track
        return tracks

    def _place_columns(self, tracks: dict[int, int]) -> list[_Column]:
        room: dict[tuple[int, int], float] = {}
        track_counts: dict[int, int] = defaultdict(int)
        for i, (link, (leaving, arriving)) in enumerate(zip(self._links, self._sides, strict=True)):
            source, target = (self._lane(link.source), leaving), (self._lane(link.target), arriving)
            room[source] = max(room.get(source, 0), STUB + link.label_width)
            room[target] = max(room.get(target, 0), STUB)
            if i in tracks:
                track_counts[source[0]] = max(track_counts[source[0]], tracks[i] + 1)
        columns: list[_Column] = []
        begin = float(MARGIN)
        for lane in range(len(self._order.lanes)):
            x = begin + room.get((lane, LEFT), 0) + PAD
            label_end = x + self._part_width + PAD + room.get((lane, RIGHT), 0)
            end = label_end + TRACK * track_counts[lane]
            columns.append(_Column(begin, x, label_end, end))
            begin = end + CURVE
        return columns

    def _list_boxes(self, columns: Sequence[_Column]) -> Iterator[Box]:
        for lane, cells in enumerate(self._order.lanes):
            for cell in cells:
                if not cell.is_passage:
                    x, y = columns[lane].x - PAD / 2, self._box_tops[lane, cell.name]
                    yield Box(cell.name, lane, Rectangle(x, y, self._part_width + PAD, self._measure_box(cell)))

    def _draw(self, i: int, rows: tuple[float, float], columns: Sequence[_Column], track: int | None) -> Route:
        lanes = tuple(self._lane(part) for part in (self._links[i].source, self._links[i].target))
        source, target = (
            End(columns[lane].x + (self._part_width if side == RIGHT else 0), y, side)
            for lane, side, y in zip(lanes, self._sides[i], rows, strict=True)
        )
        if track is not None:
            line = draw_loop(source, target, columns[lanes[0]].label_end + TRACK * track)
        else:
            passages = [self._passages[vertex] for vertex in self._order.chains[i][1:-1]]
            line = draw_curves(source, target, _list_crossings(lanes[0], lanes[1], [*passages, target.y], columns))
        label_x = source.x + source.side * (PAD + 4)
        anchor = "start" if source.side == RIGHT else "end"
        return Route(line, draw_arrow(target), label_x, source.y - 4, anchor)


def _choose_sides(source_lane: int, target_lane: int) -> tuple[int, int]:
    """Returns at which side a line leaves and arrives."""
    if source_lane == target_lane:
        return RIGHT, RIGHT
    return (RIGHT, LEFT) if source_lane < target_lane else (LEFT, RIGHT)


def _list_crossings(source: int, target: int, rows: Sequence[float], columns: Sequence[_Column]) -> Iterator[Crossing]:
    """Gives the gaps between lanes that a line crosses from its source to its target; `rows` are where it is after each."""
    if source < target:
        gaps = [(columns[lane].end, columns[lane + 1].begin) for lane in range(source, target)]
    else:
        gaps = [(columns[lane].begin, columns[lane - 1].end) for lane in range(source, target, -1)]
    return (Crossing(begin, end, y) for (begin, end), y in zip(gaps, rows, strict=True))
