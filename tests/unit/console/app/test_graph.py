"""The graph of an app: its places, its lines, and what it says without colour."""

import re
from itertools import combinations, pairwise
from unicodedata import east_asian_width

import pytest
from defusedxml.ElementTree import fromstring
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.console.objects import NOW_S, Object, app, instance, node, snapshot, telemetry

from robotapp_console.views.app.edges import EdgeRow
from robotapp_console.views.app.page import AppView, build_app
from robotapp_console.views.graph.alignment import DesiredPlace, place_cells
from robotapp_console.views.graph.layout import Layout, Rectangle, lay_out
from robotapp_console.views.graph.ordering import Link, Part, order_parts
from robotapp_console.views.graph.picture import (
    CHARACTER,
    MOST_NAME,
    MOST_TOPIC,
    Node,
    Picture,
    draw_picture,
    format_figures,
)
from robotapp_console.web.rendering import Pages, StaticFiles

PAGES = Pages(StaticFiles())
WIDTH = 120.0


@st.composite
def graphs(draw: st.DrawFn) -> tuple[list[Part], list[Link]]:
    lane_count = draw(st.integers(1, 4))
    spots = st.tuples(st.integers(0, lane_count - 1), st.integers(0, 2))
    others = draw(st.lists(spots, max_size=10))
    parts = [
        Part(f"c{i}", f"n{lane}-{box}", lane)
        for i, (lane, box) in enumerate([(k, 0) for k in range(lane_count)] + others)
    ]
    ends = st.integers(0, len(parts) - 1)
    links = [
        Link(a, b, draw(st.sampled_from((60.0, 140.0)))) for a, b in draw(st.lists(st.tuples(ends, ends), max_size=25))
    ]
    return parts, links


def overlap(one: Rectangle, other: Rectangle) -> bool:
    apart_x = one.x + one.width <= other.x or other.x + other.width <= one.x
    return not (apart_x or one.y + one.height <= other.y or other.y + other.height <= one.y)


def contains(outer: Rectangle, inner: Rectangle) -> bool:
    return (
        outer.x <= inner.x
        and outer.y <= inner.y
        and inner.x + inner.width <= outer.x + outer.width
        and inner.y + inner.height <= outer.y + outer.height
    )


def labels_of(layout: Layout, links: list[Link]) -> list[Rectangle]:
    """Returns what the labels cover, as high as their characters are."""
    return [
        Rectangle(
            route.label_x - (link.label_width if route.anchor == "end" else 0), route.label_y - 9, link.label_width, 11
        )
        for route, link in zip(layout.routes, links, strict=True)
    ]


@settings(max_examples=150, deadline=None)
@given(graphs())
def test_no_box_component_or_label_covers_another(graph: tuple[list[Part], list[Link]]) -> None:
    parts, links = graph
    layout = lay_out(parts, links, part_width=WIDTH)
    page = Rectangle(0, 0, layout.width, layout.height)
    labels = labels_of(layout, links)
    boxes = {(box.lane, box.name): box.area for box in layout.boxes}
    for area in (*layout.parts, *boxes.values(), *layout.lanes, *labels):
        assert contains(page, area)
    for group in (layout.parts, tuple(boxes.values()), layout.lanes, labels):
        assert not any(overlap(one, other) for one, other in combinations(group, 2))
    for part, area in zip(parts, layout.parts, strict=True):
        assert contains(boxes[part.lane, part.box], area)
        assert contains(layout.lanes[part.lane], area)
        assert not any(overlap(area, label) for label in labels)


@settings(max_examples=100, deadline=None)
@given(graphs())
def test_each_line_begins_and_ends_at_its_components_in_a_row_of_its_own(graph: tuple[list[Part], list[Link]]) -> None:
    parts, links = graph
    layout = lay_out(parts, links, part_width=WIDTH)
    ports: set[tuple[float, float]] = set()
    for link, route in zip(links, layout.routes, strict=True):
        begin = re.match(r"M(\S+) (\S+?)H", route.line)
        arrow = re.match(r"M\S+ \S+?L(\S+) (\S+?)L", route.arrow)
        assert begin is not None
        assert arrow is not None
        assert route.line.endswith(f"H{arrow[1]}")
        for match, end in ((begin, link.source), (arrow, link.target)):
            x, y = float(match[1]), float(match[2])
            area = layout.parts[end]
            assert x in (pytest.approx(area.x), pytest.approx(area.x + area.width))
            assert area.y < y < area.y + area.height
            assert (x, y) not in ports
            ports.add((x, y))


@settings(max_examples=50, deadline=None)
@given(graphs())
def test_equal_graphs_have_equal_places(graph: tuple[list[Part], list[Link]]) -> None:
    parts, links = graph
    assert lay_out(parts, links, part_width=WIDTH) == lay_out(list(parts), list(links), part_width=WIDTH)


def test_components_are_ordered_so_that_lines_do_not_cross() -> None:
    left, right = ("a", "b", "c", "d"), ("w", "x", "y", "z")
    parts = [Part(name, f"node-{name}", 0) for name in left] + [Part(name, f"node-{name}", 1) for name in right]
    links = [Link(i, 7 - i) for i in range(4)]
    lanes = order_parts(parts, links).lanes
    rows = [[parts[cell.members[0]].name for cell in cells] for cells in lanes]
    assert [right[3 - left.index(name)] for name in rows[0]] == rows[1]


def test_a_line_past_a_lane_goes_between_its_boxes() -> None:
    parts = [Part("a", "r", 0), Part("b", "e1", 1), Part("c", "e2", 1), Part("d", "c", 2)]
    links = [Link(0, 3), Link(0, 1), Link(0, 2), Link(1, 3), Link(2, 3)]
    layout = lay_out(parts, links, part_width=WIDTH)
    rows = {float(y) for y in re.findall(r" (\d+(?:\.\d+)?)(?=H)", layout.routes[0].line)[1:-1]}
    for box in layout.boxes:
        if box.lane == 1:
            assert not any(box.area.y < row < box.area.y + box.area.height for row in rows)


def test_without_components_there_is_an_empty_picture() -> None:
    layout = lay_out([], [], part_width=WIDTH)
    assert (layout.parts, layout.routes, layout.lanes) == ((), (), ())


@given(st.lists(st.builds(DesiredPlace, st.integers(1, 50), st.integers(-100, 900), st.integers(0, 5)), max_size=12))
def test_cells_keep_their_order_and_never_overlap(places: list[DesiredPlace]) -> None:
    depth = sum(place.height for place in places) + 200.0
    tops = place_cells(places, depth)
    ends = [top + place.height for top, place in zip(tops, places, strict=True)]
    assert all(end <= top for end, top in zip(ends, tops[1:], strict=False))
    assert all(top >= 0 and end <= depth for top, end in zip(tops, ends, strict=True))


def test_a_cell_gets_its_place_and_two_that_want_the_same_place_share_it() -> None:
    assert place_cells([DesiredPlace(10, 40, 1)], 100) == [40]
    assert place_cells([DesiredPlace(10, 40, 1), DesiredPlace(10, 40, 1)], 100) == [35, 45]
    assert place_cells([DesiredPlace(10, 95, 3)], 100) == [90]


def edge(topic: str, source: str, target: str, **fields: object) -> Object:
    return {"topic": topic, "from": source, "to": target, "budget": "30ms", **fields}


def world(
    *edges: Object,
    components: list[Object] | None = None,
    specs: list[Object] | None = None,
    refused: tuple[str, ...] = (),
) -> AppView:
    body = app("teleop")
    body["spec"] = {"edges": specs or []}
    places = (("driver", "amr-07"), ("planner", "edge-1"), ("ui", "cloud-1"), ("mapper", ""), ("spare", "plain"))
    shown = components or [{"name": name, "node": where, "ready": bool(where)} for name, where in places]
    nodes = [
        node("amr-07", robot="amr-07", zone="hall"),
        node("edge-1", tier="edge", zone="hall"),
        node("cloud-1", tier="cloud", zone="far"),
        node("plain"),
    ]
    view = build_app(
        snapshot(
            apps=[body],
            instances=[instance("teleop", "amr-07", components=shown, edges=list(edges))],
            nodes=[] if refused else nodes,
            reports=[telemetry("amr-07", rtt={"edge-1": 2.0}, written_s=NOW_S)],
            refused=refused,
        ),
        "default",
        "teleop",
    )
    assert view is not None
    return view


def picture_of(view: AppView) -> Picture:
    picture = view.instances[0].picture
    assert picture is not None
    return picture


def lane_of(picture: Picture, name: str) -> str:
    area = next(part.area for part in picture.parts if part.title == name)
    return next(lane.title for lane in picture.lanes if contains(lane.area, area))


def test_components_stand_in_the_lane_of_their_nodes_tier_in_a_box_per_node() -> None:
    picture = picture_of(world())
    lanes = {name: lane_of(picture, name) for name in ("driver", "planner", "ui", "spare", "mapper")}
    assert lanes == {
        "driver": "robot",
        "planner": "edge",
        "ui": "cloud",
        "spare": "nodes of no tier",
        "mapper": "no node",
    }
    assert [box.title for box in picture.boxes] == ["amr-07", "edge-1", "cloud-1", "plain", "not running"]


def test_who_may_not_read_nodes_sees_boxes_all_the_same() -> None:
    picture = picture_of(world(refused=("nodes",)))
    assert lane_of(picture, "planner") == "nodes (their tiers may not be read)"


def test_a_box_is_as_wide_as_the_name_of_its_node() -> None:
    node_name = "warehouse-robot-00000042"
    picture = picture_of(world(components=[{"name": "ui", "node": node_name, "ready": True}]))
    assert picture.boxes[0].title == node_name
    assert picture.boxes[0].area.width >= 8 + len(node_name) * CHARACTER


def test_an_edge_of_a_suspended_component_is_unknown_for_that_reason() -> None:
    body = app("teleop")
    body["spec"] = {
        "components": [{"name": "driver"}, {"name": "recorder", "replicas": 0}],
        "edges": [{"topic": "/image", "from": "driver", "to": "recorder"}],
    }
    components = [{"name": "driver", "node": "amr-07", "ready": True}, {"name": "recorder"}]
    view = build_app(
        snapshot(apps=[body], instances=[instance("teleop", "amr-07", components=components)]), "default", "teleop"
    )
    assert view is not None
    assert [row.how_known for row in view.instances[0].edges] == ["unknown (recorder is suspended)"]
    picture = picture_of(view)
    colours = {part.title: part.colour for part in picture.parts}
    assert colours == {"driver": "good", "recorder": "idle"}
    assert "recorder on no node, suspended" in {part.words for part in picture.parts}


def test_the_meaning_of_lines_is_told_where_there_are_lines() -> None:
    assert "Each line: topic" not in render(world())
    assert "Each line: topic" in render(world(edge("/a", "driver", "ui")))


def test_the_robot_itself_is_drawn_where_an_edge_ends_at_it() -> None:
    assert "@robot" not in {part.title for part in picture_of(world()).parts}
    picture = picture_of(world(edge("/odom", "@robot", "planner", nodes=["amr-07", "edge-1"])))
    assert lane_of(picture, "@robot") == "robot"
    unread = picture_of(world(edge("/odom", "@robot", "planner", nodes=["amr-07", "edge-1"]), refused=("nodes",)))
    assert lane_of(unread, "@robot") == "robot"


def test_an_edge_to_what_the_status_does_not_have_yet_is_drawn() -> None:
    picture = picture_of(world(edge("/a", "driver", "newcomer", nodes=[])))
    assert lane_of(picture, "newcomer") == "no node"


@pytest.mark.parametrize(
    ("fields", "colour", "line", "figures"),
    [
        ({"p95": "18ms", "measured": True, "met": True}, "good", "measured", "18/30 ms"),
        ({"p95": "25ms", "measured": True, "met": True}, "busy", "measured", "25/30 ms"),
        ({"p95": "45ms", "measured": True, "met": False}, "bad", "measured", "▲ 45/30 ms"),
        ({"measured": True, "met": False}, "bad", "measured", "▲ lost/30 ms"),
        ({"p95": "50us", "met": True, "nodes": ["n", "n"]}, "good", "measured", "0.05/30 ms"),
        ({"nodes": ["amr-07", "edge-1"]}, "good", "estimated", "≈2/30 ms"),
        ({"nodes": []}, "idle", "unknown", "?/30 ms"),
        ({"p95": "18ms", "measured": True, "budget": None}, "idle", "measured", "18 ms"),
    ],
)
def test_use_and_knowledge_are_told_by_colour_line_and_words(
    fields: Object, colour: str, line: str, figures: str
) -> None:
    (drawn,) = picture_of(world(edge("/cmd_vel", "ui", "driver", **fields))).edges
    assert (drawn.colour, drawn.line, drawn.figures) == (colour, line, figures)
    assert drawn.words.startswith("/cmd_vel, ui → driver: ")


def test_a_budget_for_the_median_is_named_so() -> None:
    assert (
        format_figures(EdgeRow("/t", "a", "b", "18 ms", "20 ms, median", "measured", verdict="met"))
        == "18 ms/20 ms p50"
    )


def test_a_new_measurement_moves_nothing() -> None:
    unmeasured: Object = {"nodes": []}
    orders = [
        [edge("/cmd_vel", "ui", "driver", **fields), edge("/joy", "ui", "planner"), edge("/a", "planner", "driver")]
        for fields in (unmeasured, {"measured": True, "met": False}, {"p95": "8ms", "measured": True, "met": True})
    ]
    pictures = [picture_of(world(*edges)) for edges in (*orders, orders[1][::-1])]
    for one, other in pairwise(pictures):
        assert (one.width, one.height, one.boxes) == (other.width, other.height, other.boxes)
        assert [edge.path for edge in one.edges] == [edge.path for edge in other.edges]


def count_columns(text: str) -> int:
    return sum(2 if east_asian_width(character) in "WF" else 1 for character in text)


def draw_topic(topic: str, name: str = "a") -> tuple[str, str]:
    """Returns the words that are drawn for an edge of this topic and for the component it begins at."""
    row = EdgeRow(topic, name, "", "18 ms", "20 ms", "measured", verdict="met")
    picture = draw_picture("t", [Node(name, "", "idle", "")], [row], lane_of=len)
    (drawn,) = picture.edges
    return drawn.topic, next(part.title for part in picture.parts if part.title)


@given(text=st.text(st.sampled_from("ab/漢字é"), min_size=1, max_size=60))
def test_a_topic_keeps_its_end_and_a_name_its_beginning_as_far_as_there_is_room(text: str) -> None:
    topic, name = draw_topic(text, text)
    for shown, most, tail in ((topic, MOST_TOPIC, text), (name[::-1], MOST_NAME, text[::-1])):
        if count_columns(text) <= most:
            assert shown == tail
            continue
        kept = shown[1:]
        assert shown[0] == "…"
        assert tail.endswith(kept)
        longer = tail[-len(kept) - 1 :]
        assert count_columns(kept) < most <= count_columns(longer)


def test_a_topic_of_a_million_characters_is_cut_without_reading_them_all_again_and_again() -> None:
    topic, _ = draw_topic("t" * 1_000_000)
    assert topic == f"…{'t' * (MOST_TOPIC - 1)}"


def test_edges_that_the_status_has_no_room_for_are_looked_up_in_telemetry() -> None:
    specs = [
        {"topic": "/scan", "from": "driver", "to": "planner", "latency": {"budget": "10ms"}},
        {"topic": "/map", "from": "planner", "to": "mapper"},
    ]
    rows = world(edge("/cmd_vel", "ui", "driver"), specs=specs).instances[0].edges
    assert [(row.topic, row.time, row.budget, row.knowledge, row.share) for row in rows[1:]] == [
        ("/scan", "2 ms", "10 ms", "measured", 20),
        ("/map", "", "", "unknown", None),
    ]


def make_large() -> AppView:
    """Returns the largest app that the schema allows: 64 components, 256 edges, of which the status has 64."""
    names = [f"component-{i:02}" for i in range(64)]
    components: list[Object] = [
        {"name": name, "node": ("amr-07", "edge-1", "cloud-1")[i % 3], "ready": True} for i, name in enumerate(names)
    ]
    edges = [
        edge(f"/topic_{i}", names[i % 64], names[(i * 7 + i // 64 + 1) % 64], p95="3ms", measured=True)
        for i in range(256)
    ]
    specs = [{"topic": item["topic"], "from": item["from"], "to": item["to"]} for item in edges]
    return world(*edges[:64], components=components, specs=specs)


def render(view: AppView) -> str:
    context = {
        "app": view,
        "events": (),
        "events_refusal": "",
        "are_events_whole": True,
        "allowed": frozenset(),
        "timeline": (),
        "stale": (),
        "namespace": "",
    }
    return PAGES.render("app_live.html", context, now_s=NOW_S)


def test_the_largest_app_is_drawn_whole_and_its_table_has_the_same() -> None:
    html = render(make_large())
    svg = html[html.index("<svg role") : html.index("</svg>") + len("</svg>")]
    drawing = fromstring(svg)
    assert len(drawing.findall("g[title]")) >= 64 + 256
    texts = {text.text.strip() for text in drawing.iter("text") if text.text}
    assert {f"component-{i:02}" for i in range(64)} | {f"/topic_{i}" for i in range(256)} <= texts
    assert html.count('<tr role="row"><th role="rowheader" scope="row" data-label="Topic"') == 256


def test_the_drawing_has_a_name_a_description_and_no_style_of_its_own() -> None:
    html = render(world(edge("/cmd_vel", "ui", "driver", p95="18ms", measured=True, met=True)))
    svg = fromstring(html[html.index("<svg role") : html.index("</svg>") + len("</svg>")])
    labels = svg.attrib["aria-labelledby"].split()
    assert [element.attrib["id"] for element in (svg[0], svg[1])] == labels
    assert svg[0].text == "Graph of teleop on amr-07"
    assert "5 components on 4 nodes and 1 edges" in (svg[1].text or "")
    assert not {"style", "onclick", "onload"} & {name for element in svg.iter() for name in element.attrib}


def test_of_several_instances_the_first_is_drawn_and_the_others_are_a_click_away() -> None:
    components: list[Object] = [{"name": "driver", "node": "r", "ready": True}]
    world_of_two = snapshot(
        apps=[app("teleop")], instances=[instance("teleop", f"r{i}", components=components) for i in range(2)]
    )
    view = build_app(world_of_two, "default", "teleop")
    assert view is not None
    assert [item.picture is not None for item in view.instances] == [True, False]
    assert 'href="/apps/default/teleop?robot=r1">Graph of r1</a>' in render(view)
