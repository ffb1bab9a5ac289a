"""Names and messages of others are text on every page, whatever they hold."""

import shlex
from collections import Counter
from html.parser import HTMLParser
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.unit.console.objects import (
    NOW_S,
    Object,
    app,
    device_claim,
    instance,
    node,
    pool,
    snapshot,
    telemetry,
    timestamp,
)

from robotapp_api.model.names import Annotation, EventReason, Label
from robotapp_console.views.app.addresses import is_followed
from robotapp_console.views.app.page import build_app, build_events
from robotapp_console.views.app.reasons import build_reasons, find_trouble, list_without_pods, select_pods
from robotapp_console.views.app.timeline import build_timeline
from robotapp_console.views.fleet import STATES, build_fleet, draw_links, read_fleet_query, take_fleet_page
from robotapp_console.views.links import read_zones
from robotapp_console.views.nodes import build_nodes, read_nodes_query, take_nodes_page
from robotapp_console.views.objects import AppPod, AppPodStatus, Condition, Event, Meta
from robotapp_console.views.pairs import build_pairs
from robotapp_console.views.texts import MOST_CHARACTERS, clean, describe_moment, kubectl, parse_timestamp
from robotapp_console.web.rendering import Pages, StaticFiles

PAGES = Pages(StaticFiles())
HARMLESS = "harmless"
HOSTILE = (
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "</td></tr></table><h1>owned</h1>",
    '" onmouseover="alert(1)',
    "' autofocus onfocus='alert(1)",
    "javascript:alert(1)",
    "{{ 7*7 }}{% for x in y %}",
    "<!-- ",
    "]]>",
    "&lt;b&gt;",
    "\u202egnp.exe\u202c",
    "\u2066\u2069\u200b\u200f",
    "\x00\x07\x1b[31mred",
    "line\nbreak\r\ndata: x\n\ndata: y",
    "a" * 10_000,
    "日本語" * 3000,
    "$(rm -rf /); `id` && echo",
    "hx-get=/x",
    "emoji 🚀",
    "<svg onload=alert(1)>",
    "<iframe src=javascript:alert(1)>",
    "<style>*{display:none}</style>",
    "<base href=//evil.example>",
    "<meta http-equiv=refresh content='0;url=//evil.example'>",
    "<form action=//evil.example><button>Sign in</button>",
    "<input autofocus onfocus=alert(1)>",
    "<a href=javascript:alert(1)>x</a>",
    "<object data=//evil.example>",
    "<b>bold</b>",
    "<ScRiPt>alert(1)</sCrIpT>",
    "<script\n>alert(1)</script >",
    "\uff1cscript\uff1ealert(1)\uff1c/script\uff1e",
    "<!--#exec cmd=ls-->",
    "--><script>alert(1)</script>",
    "</title><script>alert(1)</script>",
    "</textarea><script>alert(1)</script>",
    "</svg><script>alert(1)</script>",
    "<![CDATA[<script>alert(1)</script>]]>",
    "&#60;script&#62;alert(1)&#60;/script&#62;",
    "%3Cscript%3Ealert(1)%3C/script%3E",
    '"><script>alert(1)</script>',
    "'><script>alert(1)</script>",
    "`><script>alert(1)</script>",
    '" style="position:fixed;inset:0',
    '" hx-on:click="alert(1)',
    '" hx-sse:connect="//evil.example" x="',
    "' formaction='//evil.example",
    "//evil.example/",
    "/\\evil.example",
    "data:text/html,<script>alert(1)</script>",
    "vbscript:msgbox(1)",
    "java\tscript:alert(1)",
    "${alert(1)}",
    "#{7*7}",
    "{%- include '/etc/passwd' -%}",
    "{{ config }}",
    "../../../../etc/passwd",
    "..%2f..%2fapps",
    "?namespace=kube-system&x=",
    "#fragment?query=1&other=2",
    "a\u0300" * 300,
    "\u200f\u200e\u061c",
    "\ud7ff\ue000\ufffd",
    "event: close\ndata: gone",
)


class Parsed(HTMLParser):
    """Counts elements and attributes, and collects what is shown."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: Counter[str] = Counter()
        self.attributes: Counter[str] = Counter()
        self.shown: list[str] = []
        self.links: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements[tag] += 1
        self.attributes.update(name for name, _ in attrs)
        self.links += [value or "" for name, value in attrs if name in ("href", "src", "action", "formaction")]

    def handle_data(self, data: str) -> None:
        self.shown.append(data)


def world(text: str) -> dict[str, list[Object]]:
    """One of everything, with the text wherever somebody else writes."""
    body = app("teleop", troubled=[{"instance": text, "reason": text, "message": text}], phase=text)
    body["status"]["conditions"] = [{"type": text, "status": text, "reason": text, "message": text}]
    body["status"]["summary"] = dict.fromkeys(("ready", "domain", "budget", "rmw", "discovery", "devices"), text or "x")
    component = {"name": text, "node": text, "message": text}
    edge = {"topic": text, "from": text, "to": text, "kind": text, "budget": text, "p95": text, "nodes": [text]}
    single = instance("teleop", text or "x", phase=text, components=[component], edges=[edge])
    single["status"]["claims"] = [text]
    urls = (text, f"http://10.0.0.1:80/{text}", f"https://{text}", f"https://app.foxglove.dev/?ds.url={text}")
    single["status"]["links"] = [{"component": text, "name": text, "url": url} for url in urls]
    single["status"]["moves"] = [{"component": text, "times": [text, timestamp(NOW_S)]}]
    single["status"]["summary"] = {"message": text}
    device = {"id": text, "type": text, "present": True}
    return {
        "apps": [body],
        "instances": [single],
        "nodes": [
            node("amr-07", robot=text or "x", zone=text or "x", tier=text or "x"),
            node("amr-08", zone=text or "x"),
        ],
        "reports": [telemetry("amr-07", rtt={"amr-08": 1.0}, devices=[device], written_s=NOW_S, deviceProblem=text)],
        "claims": [device_claim("can-can0", holder=text or "x", component=text)],
        "pools": [pool(name=text or "x", used="119/119")],
    }


def render(text: str) -> str:
    """All fragments of a world with this text."""
    now = snapshot(**world(text))
    fleet, nodes = build_fleet(now), build_nodes(now)
    page = take_fleet_page(fleet, read_fleet_query({"q": ""}))
    shared: dict[str, Any] = {"stale": (), "namespace": ""}
    head = {"query": read_fleet_query({"q": text, "zone": text}), "zones": fleet.zones, "states": STATES}
    shown = build_app(now, "default", "teleop")
    reasons = (text, EventReason.RESCHEDULED, EventReason.BUDGET_EXCEEDED)
    events = build_events(Event(metadata=Meta(name="e"), reason=reason, note=text, type=text) for reason in reasons)
    allowed = frozenset(("suspend", "resume", "restart", "approve", "delete"))
    zones = read_zones(now.nodes)
    pairs = build_pairs(now, zones, zones["amr-07"], zones["amr-07"])
    nodes_page = {
        "nodes": nodes,
        "page": take_nodes_page(nodes, read_nodes_query({})),
        "pairs": pairs,
        "may_shut_down": True,
    }
    assert shown is not None
    timeline = build_timeline(shown.instances, events)
    app_page = {
        "app": shown,
        "timeline": timeline,
        "events": events,
        "events_refusal": clean(text),
        "allowed": allowed,
        "are_events_whole": False,
    }
    return "".join(
        (
            PAGES.render("fleet_head.html", shared | head),
            PAGES.render(
                "fleet_live.html",
                shared | {"fleet": fleet, "page": page, "links": draw_links(page, now), "query": page.query},
            ),
            PAGES.render(
                "nodes_live.html", shared | nodes_page | {"query": read_nodes_query({"near": text, "far": text})}
            ),
            PAGES.render("app_live.html", shared | app_page),
            PAGES.render("app_why.html", shared | build_why_page(text)),
            PAGES.render("app_delete.html", shared | build_delete_page(text)),
        )
    )


def build_why_page(text: str) -> dict[str, Any]:
    """Returns the context of the page that explains a pod, with the text in its spec, its record and its annotations."""
    labels = {Label.COMPONENT: text, Label.INSTANCE: text}
    annotations = {Annotation.FALLBACK: text, Annotation.BETTER_NODE: text}
    meta = Meta(name=text, labels=labels, annotations=annotations)
    condition = Condition(type="PodScheduled", message=text)
    pods = select_pods([AppPod(metadata=meta, status=AppPodStatus(conditions=(condition,)))], text)
    refusal = {"plugin": text, "reason": text, "nodes": 2, "unit": text, "examples": [{"node": text, "number": 1.5}]}
    record = {"runnerUp": text, "refusals": [refusal], "tier": text, "planned": text, "devices": [text]}
    record["top"] = {"nodes": [text], "totals": [7]}
    rows = build_reasons({"spec": {"components": [{"name": text}]}}, pods, {text: record}, robot=text)
    names = {
        "title": clean(text, 320),
        "name": clean(text, 63),
        "robot": clean(text, 63) or "x",
        "problem": clean(text) or "x",
        "without_pods": list_without_pods({"spec": {"components": [{"name": text}]}}, ()),
        "trouble": find_trouble({"status": {"troubled": [{"instance": text, "message": text}]}}, text) or "x",
    }
    page = {"caller": None, "csrf": "c", "screen": "", "notice": ""}
    return (
        page | names | {"rows": rows, "path": "/apps/a/b", "namespace_of_app": "a", "command": kubectl("explain", text)}
    )


def build_delete_page(text: str) -> dict[str, Any]:
    names = {"title": clean(text, 320), "name": clean(text, 63), "uid": text, "namespace_of_app": clean(text, 63)}
    return names | {"caller": None, "csrf": "c", "screen": "", "path": "/apps/a/b", "instances": 3}


REFERENCE = Parsed(render(HARMLESS))
# A text that means something to a view changes what is shown, as it should: a colour, a link to another zone, a count.
STRUCTURE = frozenset(
    {"script", "img", "h1", "form", "iframe", "object", "style", "svg", "table", "section", "button", "input", "b"}
)


@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_no_text_becomes_an_element_or_an_attribute(text: str) -> None:
    _assert_only_text(text)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.one_of(st.text(min_size=1, max_size=60), st.text("<>&\"'=/ \u202e\u2066\n{}%abc", min_size=1, max_size=80)))
def test_no_random_text_does_either(text: str) -> None:
    _assert_only_text(text)


def _assert_only_text(text: str) -> None:
    html = render(text)
    parsed = Parsed(html)
    for element in STRUCTURE:
        assert parsed.elements[element] == REFERENCE.elements[element], element
    assert parsed.attributes.keys() <= REFERENCE.attributes.keys()
    links = [link for link in parsed.links if link != "#main" and not is_followed(link)]
    assert all(link.startswith(("/", "?")) and not link.startswith("//") for link in links), links
    for character in "\u202e\u2066\u2069\u200f\x00\x1b\x07":
        assert character not in "".join(parsed.shown)
    assert len(html) < 400_000


def test_hostile_text_is_still_readable() -> None:
    shown = "".join(Parsed(render("<b>bold</b>")).shown)
    assert "<b>bold</b>" in shown


@given(st.text(max_size=3000))
def test_clean_text_is_short_and_has_no_control_characters(text: str) -> None:
    shown = clean(text)
    assert all(character.isprintable() or character == "\n" for character in shown)
    assert len(text) <= MOST_CHARACTERS or f"({len(text) - MOST_CHARACTERS} more characters)" in shown


@given(st.text(min_size=1, max_size=40))
def test_a_name_in_a_command_stays_one_word(name: str) -> None:
    words = shlex.split(kubectl("robotapp", "info", name))
    assert words == ["kubectl", "robotapp", "info", clean(name)]


@pytest.mark.parametrize(
    "text", ["", "now", "0001-01-01T00:00:00+23:59", "9999-12-31T23:59:59-23:59", "2026-13-01T00:00:00Z"]
)
def test_a_time_that_is_none_is_not_shown(text: str) -> None:
    assert describe_moment(text, 0.0) is None
    assert parse_timestamp(text) is None


def test_a_time_without_a_zone_is_one_of_the_api_server() -> None:
    moment = describe_moment("1970-01-01T00:01:00", 180.0)
    assert moment == ("1970-01-01T00:01:00Z", "2m ago", "1970-01-01 00:01:00 UTC")
    assert parse_timestamp("1970-01-01T01:01:00+01:00") == 60.0
