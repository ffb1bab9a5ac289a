"""Open pages follow the cluster: nothing jumps, and neither API server nor scheduler can be restarted without them going on."""

import re

from playwright.sync_api import Page, Route, expect
from tests.live.browser.conftest import Fleet

from robotapp_testbed.browser import start_console


def mark(page: Page) -> None:
    """Leaves a mark that a reload would wipe out."""
    page.evaluate("window.isSame = true")


def is_marked(page: Page) -> bool:
    return bool(page.evaluate("window.isSame === true"))


def test_updates_arrive_without_a_reload_and_nothing_on_the_page_moves(page: Page, fleet: Fleet) -> None:
    page.goto("/")
    mark(page)
    row = page.locator("#robot-amr-08")
    expect(row).to_contain_text("2 ms")
    page.evaluate("document.getElementById('q').focus(); document.getElementById('q').value = 'half a wo'")
    fleet.telemetry.set_rtt("edge-2", "amr-08", 7.25)
    fleet.telemetry.set_load("amr-08", cpu=33, memory=44)
    expect(row).to_contain_text("7.25 ms")
    expect(row).to_contain_text("33 %, 44 %")
    fleet.plane.kubectl("-n", fleet.namespace, "delete", "robotapp", "can-holder")
    expect(page.locator("article.problem")).to_have_count(0)
    fleet.apply("can-holder")
    expect(page.locator("article.problem").first).to_contain_text("can-holder")
    fleet.telemetry.set_rtt("edge-2", "amr-08", 2.0)
    expect(row).to_contain_text("2 ms")
    assert is_marked(page)
    assert page.locator("#q").input_value() == "half a wo", "what is being typed stays"
    assert page.evaluate("window.shifts") == []


def test_a_page_follows_the_cluster_also_when_its_scripts_arrive_late(page: Page, fleet: Fleet) -> None:
    def delay(route: Route) -> None:
        page.wait_for_timeout(400)
        route.continue_()

    page.route("**/hx-sse.min.js*", delay)
    page.goto("/nodes")
    fleet.telemetry.set_load("cloud-1", cpu=71, memory=18)
    expect(page.locator("#node-cloud-1")).to_contain_text("used 71 %")


def test_an_app_that_is_suspended_and_resumed_is_followed(page: Page, fleet: Fleet) -> None:
    page.goto(f"/apps/{fleet.namespace}/teleop")
    mark(page)
    fleet.plane.kubectl(
        "-n", fleet.namespace, "patch", "robotapp", "teleop", "--type=merge", "-p", '{"spec":{"suspend":true}}'
    )
    expect(page.locator("h1")).to_contain_text("Suspended")
    fleet.plane.kubectl(
        "-n", fleet.namespace, "patch", "robotapp", "teleop", "--type=merge", "-p", '{"spec":{"suspend":false}}'
    )
    expect(page.locator("h1")).to_contain_text("Running", timeout=60_000)
    assert is_marked(page)


def test_pages_say_stale_while_the_api_server_is_gone_and_go_on_afterwards(page: Page, fleet: Fleet) -> None:
    server = fleet.plane.process("kube-apiserver")
    page.goto("/nodes")
    mark(page)
    server.kill()
    try:
        expect(page.locator(".banner").first).to_contain_text(re.compile(r"stale since"), timeout=60_000)
        expect(page.locator("#node-edge-1")).to_contain_text("hall-1")
    finally:
        server.start().wait_ready()
        fleet.scheduler.restart()  # without its lease it ends, and its pod would be started again
    expect(page.get_by_text("stale since")).to_have_count(0, timeout=60_000)
    fleet.telemetry.set_load("edge-1", cpu=17, memory=18)
    expect(page.locator("#node-edge-1")).to_contain_text("used 17 %", timeout=60_000)
    assert is_marked(page)


def test_pages_go_on_over_a_restart_of_the_scheduler(page: Page, fleet: Fleet) -> None:
    page.goto("/")
    mark(page)
    fleet.scheduler.kill()
    fleet.plane.kubectl("-n", fleet.namespace, "delete", "robotapp", "teleop")
    chips = page.locator("#robot-amr-07 .chip")
    expect(chips.filter(has_text="teleop")).to_have_count(0, timeout=60_000)
    fleet.scheduler.start().wait_ready()
    fleet.apply("teleop")
    expect(chips.filter(has_text="teleop")).to_contain_text("Running", timeout=60_000)
    assert is_marked(page)


def test_a_page_says_since_when_it_has_lost_its_console(page: Page, fleet: Fleet) -> None:
    console = start_console(fleet.plane, name="console-that-ends")
    page.goto(console.address)
    expect(page.locator("#robot-amr-07")).to_be_visible()
    expect(page.locator("#lost")).to_be_hidden()
    console.process.stop()
    expect(page.locator("#lost")).to_contain_text("What is shown is from", timeout=60_000)
    expect(page.locator("#lost-since")).to_contain_text("ago")
    expect(page.locator("#robot-amr-07")).to_be_visible()
