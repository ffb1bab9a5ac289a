"""The links of an instance: which addresses a browser may follow, and how the others are reached."""

from urllib.parse import urlsplit

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.unit.console.objects import app, instance, snapshot

from robotapp_console.views.app.addresses import MOST_LINKS, LinkRow, build_links, is_followed
from robotapp_console.views.app.page import build_app
from robotapp_console.views.objects import InstanceLink
from robotapp_console.web.rendering import Pages, StaticFiles

FOXGLOVE = "https://app.foxglove.dev/?ds=foxglove-websocket&ds.url="


def row_of(url: str, robot: str = "amr-07") -> LinkRow:
    link = InstanceLink(component="bridge", name="view", url=url)
    (row,) = build_links([link], namespace="team-a", app="patrol", robot=robot)
    return row


@pytest.mark.parametrize(
    "url",
    [
        "http://10.0.0.7:30080/vnc.html",
        "https://[fd00::7]:30080",
        "foxglove://open?ds=foxglove-websocket",
        f"{FOXGLOVE}ws%3A%2F%2F10.0.0.7%3A30765",
    ],
)
def test_an_address_for_a_browser_is_followed_as_it_is_shown(url: str) -> None:
    row = row_of(url)
    assert (row.href, row.address, row.command) == (url, url, "")


@pytest.mark.parametrize(
    "url",
    [
        "ws://10.0.0.7:30765",
        "10.0.0.7:31811",
        "javascript:alert(1)",
        "JavaScript://host/%0aalert(1)",
        "data:text/html,x",
        "//evil.example",
        "https:evil.example",
        "https://bank.example@evil.example/",
        "https:\\\\evil.example",
        "http://host/ path",
        "http://host/\u202egnp",
        "http://[half",
        "http://" + "a" * 1100,
        "",
    ],
)
def test_any_other_address_is_text(url: str) -> None:
    assert row_of(url).href == ""


@pytest.mark.parametrize(
    "url", ["http://patrol-x.team-a.svc:8080/map", f"{FOXGLOVE}ws%3A%2F%2Fpatrol-x.team-a.svc%3A8765"]
)
def test_an_address_of_the_pod_network_comes_with_the_command_that_opens_it(url: str) -> None:
    row = row_of(url)
    assert row.href == ""
    assert row.command == "kubectl robotapp open patrol bridge --link view -n team-a --robot amr-07"
    assert row_of(url, robot="").command.endswith("-n team-a")


@given(st.one_of(st.text(max_size=60), st.text("htps:/@\\.[]svc ?#\t", max_size=30).map("http://".__add__)))
@example("http://host.svc\t@evil.example")
def test_what_is_followed_has_a_harmless_scheme_and_a_host_that_is_seen(url: str) -> None:
    row = row_of(url)
    if row.href:
        assert row.href == row.address == url
        assert is_followed(url)
        assert urlsplit(url).scheme in {"http", "https", "foxglove"}
        assert urlsplit(url).hostname


def test_the_page_of_an_app_has_the_links_of_each_instance_and_no_more_than_a_status_holds() -> None:
    body = instance("teleop", "r1")
    body["status"]["links"] = [{"component": "bridge", "name": f"l{i}", "url": "http://h:1"} for i in range(40)]
    page = build_app(snapshot(apps=[app("teleop")], instances=[body]), "default", "teleop")
    assert page is not None
    rows = page.instances[0].links
    assert len(rows) == MOST_LINKS
    assert rows[0] == LinkRow("bridge", "l0", "http://h:1", "http://h:1", "")


def test_an_anchor_gives_the_other_page_neither_a_handle_nor_an_address() -> None:
    body = instance("teleop", "r1")
    urls = ("http://10.0.0.7:1", "javascript:alert(1)", "http://t.default.svc:1")
    body["status"]["links"] = [
        {"component": "bridge", "name": f"l{position}", "url": url} for position, url in enumerate(urls)
    ]
    page = build_app(snapshot(apps=[app("teleop")], instances=[body]), "default", "teleop")
    shared = {"stale": (), "namespace": "", "timeline": (), "events": (), "events_refusal": "", "allowed": frozenset()}
    html = Pages(StaticFiles()).render("app_live.html", shared | {"app": page, "are_events_whole": True})
    assert '<a href="http://10.0.0.7:1" rel="noopener noreferrer">http://10.0.0.7:1</a>' in html
    assert "<span>javascript:alert(1)</span>" in html
    assert "<span>http://t.default.svc:1</span>" in html
    assert "kubectl robotapp open teleop bridge --link l2" in html
