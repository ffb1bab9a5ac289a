"""Every screen in a real browser: what it shows, from phone to wall, light and dark, and by the keyboard alone."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import yaml
from playwright.sync_api import Browser, Page, expect
from tests.live.browser.conftest import Fleet, open_context

from robotapp_testbed import wait_until
from robotapp_testbed.browser import start_console
from robotapp_testbed.browser.axe import find_barriers
from robotapp_testbed.browser.chromium import REBOUND_HOST

PLUGIN = Path(sys.executable).parent / "kubectl-robotapp"

SCREENS = {
    "fleet": "/",
    "teleop": "/apps/{namespace}/teleop",
    "can-rival": "/apps/{namespace}/can-rival",
    "reasons": "/apps/{namespace}/teleop/why",
    "deletion": "/apps/{namespace}/teleop/delete",
    "nodes": "/nodes?near=hall-1&far=hall-2",
    "scheduler": "/scheduler",
    "nothing there": "/apps/{namespace}/no-such-app",
}


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 1920])
def test_every_screen_fits_and_shuts_nobody_out(
    browser: Browser, fleet: Fleet, axe: Path, width: int, scheme: str
) -> None:
    with open_context(browser, fleet, width=width, scheme=scheme) as context:
        page = context.new_page()
        for name, path in SCREENS.items():
            page.goto(path.format(namespace=fleet.namespace))
            page_width = page.evaluate("document.documentElement.scrollWidth")
            assert page_width <= width, f"{name} is {page_width} px wide at {width} px"
            barriers = find_barriers(page, axe)
            assert not [finding for finding in barriers if finding.is_severe], f"{name} at {width} px, {scheme}"


def test_light_and_dark_differ(browser: Browser, fleet: Fleet) -> None:
    grounds = set()
    for scheme in ("light", "dark"):
        with open_context(browser, fleet, scheme=scheme) as context:
            page = context.new_page()
            page.goto("/")
            grounds.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert len(grounds) == 2


def test_the_one_time_address_opens_the_fleet_and_does_so_once(browser: Browser, fleet: Fleet) -> None:
    address = fleet.console.address
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(address)
        expect(page).to_have_title("Fleet · RobotApp")
        expect(page.locator("#robot-amr-07")).to_be_visible()
        assert "pass=" not in page.url
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(address)
        expect(page.locator("main")).to_contain_text("This address is not valid")


@contextmanager
def run_plugin(fleet: Fleet, folder: Path) -> Iterator[Path]:
    """Runs `kubectl robotapp console` for a user with a browser of his own, and gives the page that this browser is to open."""
    home, given, program = folder / "home", folder / "given", folder / "browser.py"
    home.mkdir()
    program.write_text("import pathlib, sys\npathlib.Path(sys.argv[1]).write_text(sys.argv[2])\n")
    environment = os.environ | {"HOME": str(home), "BROWSER": f"{sys.executable} {program} {given} %s"}
    command = [str(PLUGIN), "console", f"--kubeconfig={fleet.plane.kubeconfig()}"]
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as process:
        try:
            assert wait_until(lambda: given.exists() and bool(given.read_text()), timeout_s=60)
            yield Path(urlsplit(given.read_text()).path)
            process.send_signal(signal.SIGINT)
            assert process.wait(30) == 0
        finally:
            process.kill()


def test_the_page_that_kubectl_opens_leads_the_browser_on_and_it_arrives_signed_in(
    browser: Browser, fleet: Fleet, tmp_path: Path
) -> None:
    with run_plugin(fleet, tmp_path) as opening_page, browser.new_context() as context:
        page = context.new_page()
        page.goto(opening_page.as_uri(), wait_until="commit")
        expect(page).to_have_title("Fleet · RobotApp")
        expect(page.locator("#robot-amr-07")).to_be_visible()
        address = urlsplit(page.url)
        assert (address.hostname, address.path, address.query) == ("127.0.0.1", "/", "")
        page.get_by_role("link", name="Nodes").click()
        expect(page.locator("#node-edge-1")).to_be_visible()
        assert not opening_page.parent.exists(), "its address is used up"


def test_the_fleet_puts_the_problem_first_with_the_command_that_helps(page: Page, fleet: Fleet) -> None:
    page.goto("/")
    problem = page.locator("article.problem").first
    expect(problem).to_contain_text(f"{fleet.namespace}/can-rival on amr-07")
    expect(problem).to_contain_text(f"held by {fleet.namespace}/can-holder")
    expect(problem.locator("code")).to_have_text("kubectl robotapp devices")
    row = page.locator("#robot-amr-07")
    expect(row).to_contain_text("2 ms")
    expect(row).to_contain_text("1 held, 0 free")
    expect(row.locator(".chip")).to_have_count(3)


def test_a_command_is_copied_by_its_button(page: Page, fleet: Fleet) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=fleet.console.origin)
    page.goto("/")
    page.locator("article.problem button").first.click()
    expect(page.locator("article.problem button").first).to_have_text("Copied")
    assert page.evaluate("navigator.clipboard.readText()") == "kubectl robotapp devices"


def test_the_fleet_is_searched_and_an_app_opened_by_the_keyboard_alone(page: Page, fleet: Fleet) -> None:
    page.goto("/")
    page.keyboard.press("Tab")
    expect(page.locator(".skip")).to_be_focused()
    page.keyboard.press("/")
    expect(page.locator("#q")).to_be_focused()
    page.keyboard.type("amr-07")
    page.keyboard.press("Enter")
    expect(page.locator("#robot-amr-08")).to_have_count(0)
    expect(page.locator("#robot-amr-07")).to_be_visible()
    assert "q=amr-07" in page.url, "the address can be shared"
    press_tab_until(page, "a.chip", "teleop")
    page.keyboard.press("Enter")
    expect(page).to_have_title(f"{fleet.namespace}/teleop on amr-07 · RobotApp")
    press_tab_until(page, "nav a", "Nodes")
    page.keyboard.press("Enter")
    expect(page).to_have_title("Nodes · RobotApp")
    press_tab_until(page, "th a", "Zone")
    page.keyboard.press("Enter")
    expect(page.locator("th[aria-sort=ascending]")).to_have_text("Zone")


def press_tab_until(page: Page, selector: str, text: str) -> None:
    """Goes from control to control until the focus is on the one with this text; everything must be reached, and seen."""
    for _ in range(80):
        page.keyboard.press("Tab")
        focused = page.locator("*:focus")
        if focused.evaluate(f"(element) => element.matches({selector!r})") and text in focused.inner_text():
            assert focused.evaluate("(element) => getComputedStyle(element).outlineStyle") == "solid"
            return
    pytest.fail(f"the keyboard does not reach {selector} {text}")


def test_an_app_shows_its_conditions_components_and_edges(page: Page, fleet: Fleet) -> None:
    page.goto(f"/apps/{fleet.namespace}/teleop")
    expect(page.locator("table.conditions")).to_contain_text("BudgetMet")
    components = page.locator("table.components")
    expect(components).to_contain_text("operator-ui")
    expect(components).to_contain_text("edge-1")
    edges = page.locator("table.edges")
    expect(edges).to_contain_text("/cmd_vel")
    expect(edges).to_contain_text("2 ms / 30 ms")


def make_app_in_order() -> dict[str, object]:
    """A web page inside of the cluster and one on a port of its node, a component that is suspended, and one that waits for it."""
    web = {"ports": [{"name": "web", "port": 8080}]}
    links = [{"name": "map", "port": "web", "path": "/map"}]
    components = [
        {"name": "inside", "image": "i", "service": {"spec": web, "links": links}},
        {"name": "outside", "image": "i", "service": {"spec": web | {"type": "NodePort"}, "links": links}},
        {"name": "recorder", "image": "i", "replicas": 0},
        {"name": "mapper", "image": "i", "dependsOn": [{"component": "recorder"}]},
    ]
    spec = {"ros": {"distro": "none"}, "components": components}
    return {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": "ordered"}, "spec": spec}


def test_an_app_shows_its_links_and_which_component_is_suspended_and_which_waits(page: Page, fleet: Fleet) -> None:
    fleet.plane.kubectl("apply", "-n", fleet.namespace, "-f", "-", stdin=make_app_in_order())
    page.goto(f"/apps/{fleet.namespace}/ordered")
    links = page.locator("table.links tbody tr")
    inside, outside = links.filter(has_text="inside"), links.filter(has_text="outside")
    expect(inside.locator("code")).to_have_text(f"kubectl robotapp open ordered inside --link map -n {fleet.namespace}")
    expect(inside.locator("a")).to_have_count(0)
    expect(outside.get_by_role("link")).to_have_attribute("href", re.compile(r"^http://[0-9.]+:[0-9]+/map$"))
    components = page.locator("table.components tbody tr")
    expect(components.filter(has=page.get_by_role("rowheader", name="recorder"))).to_contain_text("suspended")
    waiting = components.filter(has=page.get_by_role("rowheader", name="mapper"))
    expect(waiting).to_contain_text("waits until recorder (suspended by replicas: 0) is Ready (dependsOn)")
    page.get_by_role("link", name="Why is mapper there?").click()
    expect(page.locator("main")).to_contain_text("Without a pod: recorder, mapper.")
    fleet.plane.kubectl("delete", "-n", fleet.namespace, "robotapp", "ordered")


def make_sweep() -> dict[str, object]:
    """Two runs of a program that ends."""
    matrix = {"parameters": [{"name": "seed", "values": ["1", "2"]}]}
    components = [{"name": "sim", "image": "i", "job": {}}]
    spec = {"ros": {"distro": "none"}, "matrix": matrix, "components": components}
    return {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": "seeds"}, "spec": spec}


def test_a_sweep_shows_how_many_of_its_runs_are_done(page: Page, fleet: Fleet) -> None:
    fleet.plane.kubectl("apply", "-n", fleet.namespace, "-f", "-", stdin=make_sweep())
    page.goto(f"/apps/{fleet.namespace}/seeds")
    expect(page.locator("dl.facts")).to_contain_text("2/2 done")
    expect(page.locator("table.instances")).to_contain_text("Run")
    expect(page.locator("table.instances tbody tr").filter(has_text="Completed")).to_have_count(2)
    fleet.plane.kubectl("delete", "-n", fleet.namespace, "robotapp", "seeds")


def test_why_here_has_the_runner_up_and_the_time_for_which_a_node_was_refused(page: Page, fleet: Fleet) -> None:
    page.goto(f"/apps/{fleet.namespace}/teleop")
    page.get_by_role("link", name="Why is operator-ui there?").click()
    expect(page).to_have_title(f"Why here? {fleet.namespace}/teleop on amr-07 · RobotApp")
    reasons = page.locator("table.why tbody tr").filter(has_text="operator-ui")
    expect(reasons.get_by_role("cell").nth(0)).to_have_text("edge-1")
    expect(reasons.get_by_role("cell").nth(1)).to_have_text("edge-2")
    expect(reasons).to_contain_text(re.compile(r"cloud-1: 60(\.0)? ms to .+ > 30 ms"))
    page.get_by_role("link", name="Back to the app").click()
    expect(page).to_have_title(f"{fleet.namespace}/teleop on amr-07 · RobotApp")


def test_why_here_names_the_holder_of_the_device_for_which_a_pod_waits(page: Page, fleet: Fleet) -> None:
    page.goto(f"/apps/{fleet.namespace}/can-rival/why")
    reasons = page.locator("table.why tbody tr")
    expect(reasons.get_by_role("cell").nth(0)).to_have_text("waits")
    expect(reasons).to_contain_text("amr-07: had no free device for the pod")
    expect(page.locator("main .error")).to_contain_text(f"held by {fleet.namespace}/can-holder")


def test_why_here_without_a_way_to_the_scheduler_has_what_the_pods_say_and_the_command(
    browser: Browser, fleet: Fleet
) -> None:
    console = start_console(fleet.plane, name="console-without-a-scheduler")
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(console.address)
        page.goto(f"{console.origin}/apps/{fleet.namespace}/teleop/why")
        expect(page.locator("section.refused")).to_contain_text("no scheduler pod runs in namespace robotapp-system")
        expect(page.locator("section.refused code")).to_have_text(
            f"kubectl robotapp explain teleop -n {fleet.namespace} --robot amr-07"
        )
        expect(page.locator("table.why")).to_contain_text("operator-ui")
    console.process.stop()


def test_without_scripts_every_screen_still_shows_what_it_has(browser: Browser, fleet: Fleet) -> None:
    name, _, value = fleet.session.partition("=")
    with browser.new_context(java_script_enabled=False, base_url=fleet.console.origin) as context:
        context.add_cookies([{"name": name, "value": value, "url": fleet.console.origin}])
        page = context.new_page()
        page.goto("/")
        expect(page.locator("#robot-amr-07")).to_contain_text("teleop")
        page.locator("#q").fill("amr-08")
        page.get_by_role("button", name="Filter").click()
        expect(page.locator("#robot-amr-07")).to_have_count(0)
        page.goto("/nodes")
        expect(page.locator("#node-edge-1")).to_contain_text("16")


def test_the_telemetry_panel_shows_what_nodes_have_use_and_hold(page: Page, fleet: Fleet) -> None:
    fleet.telemetry.set_load("amr-07", cpu=41, memory=52)
    page.goto("/nodes")
    robot = page.locator("#node-amr-07")
    expect(robot).to_contain_text("can-can0")
    expect(robot).to_contain_text(f"held by {fleet.namespace}/can-holder base-driver")
    expect(robot).to_contain_text("used 41 %")
    expect(robot).to_contain_text("used 52 %")
    expect(robot.locator("time")).to_contain_text("ago")
    edge = page.locator("#node-edge-1")
    expect(edge).to_contain_text("6 of 16")
    expect(edge).to_contain_text("hall-1")
    expect(page.locator("table.matrix")).to_contain_text("60 ms")


def test_a_cell_of_the_matrix_leads_to_its_pairs_of_nodes(page: Page, fleet: Fleet) -> None:
    del fleet
    page.goto("/nodes")
    page.get_by_role("link", name="hall-1 to hall-2").click()
    pairs = page.locator("table.pairs tbody tr")
    expect(pairs).to_have_count(4)
    expect(pairs.first).to_contain_text("15 ms")
    expect(pairs.first).to_contain_text("measured")
    assert "near=hall-1&far=hall-2" in page.url


def test_a_graceful_shutdown_is_begun_by_a_button_and_other_pages_turn_red_without_a_reload(
    browser: Browser, page: Page, fleet: Fleet
) -> None:
    page.goto("/nodes")
    with open_context(browser, fleet) as context:
        other_page = context.new_page()
        other_page.goto("/nodes")
        other_page.get_by_role("button", name="Begin shutdown of edge-2").click()
        expect(other_page.locator(".notice")).to_contain_text("edge-2 is shutting down gracefully")
        expect(page.locator("#node-edge-2 .phase.bad")).to_have_text("graceful shutdown")
        other_page.get_by_role("button", name="End shutdown of edge-2").click()
        expect(page.locator("#node-edge-2")).not_to_contain_text("graceful shutdown")


def test_a_name_that_was_rebound_to_this_machine_reaches_no_page(browser: Browser, fleet: Fleet) -> None:
    with open_context(browser, fleet) as context:
        name, _, value = fleet.session.partition("=")
        origin = f"http://{REBOUND_HOST}:{fleet.console.port}"
        context.add_cookies([{"name": name, "value": value, "url": origin}])
        page = context.new_page()
        for path in ("/", "/nodes", "/open?pass=guess", "/static/console.css"):
            answer = page.goto(origin + path)
            assert answer is not None
            assert answer.status == 403, path
            assert "amr-07" not in page.content()


def test_the_users_token_is_on_no_page_in_no_address_and_in_no_log(page: Page, fleet: Fleet) -> None:
    token = yaml.safe_load(fleet.plane.kubeconfig().read_text())["users"][0]["user"]["token"]
    addresses: list[str] = []
    page.on("request", lambda request: addresses.append(request.url))
    for path in SCREENS.values():
        page.goto(path.format(namespace=fleet.namespace))
        assert token not in page.content()
    assert addresses
    assert not [address for address in addresses if token in address]
    assert token not in fleet.console.process.log_text()
