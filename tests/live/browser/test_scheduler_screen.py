"""The thesis' panel for the scheduler, in a real browser: weights, the text that follows from them, a replay, apply and undo."""

from playwright.sync_api import Locator, Page, expect
from tests.live.browser.conftest import Fleet

from robotapp_testbed import wait_until

SCHEDULER = "ros-aware-scheduler"


def find_weight(page: Page, plugin: str) -> Locator:
    """Returns the number that is the plugin's weight in the first profile."""
    return page.get_by_label(f"Weight of {plugin}", exact=True).first


def place_pod(fleet: Fleet, name: str) -> str:
    """Creates a pod that would rather run on edge-1, where much is taken, and returns the node it gets."""
    wish = {"matchExpressions": [{"key": "kubernetes.io/hostname", "operator": "In", "values": ["edge-1"]}]}
    pod = {
        "apiVersion": "v1",
        "kind": "Pod",
        "metadata": {"name": name},
        "spec": {
            "schedulerName": SCHEDULER,
            "affinity": {
                "nodeAffinity": {
                    "preferredDuringSchedulingIgnoredDuringExecution": [{"weight": 100, "preference": wish}]
                }
            },
            "containers": [{"name": "main", "image": "ros:humble", "resources": {"requests": {"cpu": "2"}}}],
        },
    }
    fleet.plane.kubectl("-n", fleet.namespace, "apply", "-f", "-", stdin=pod)
    nodes: list[str] = []

    def is_placed() -> bool:
        nodes[:] = [fleet.plane.kubectl("-n", fleet.namespace, "get", "pod", name, "-o", "jsonpath={.spec.nodeName}")]
        return bool(nodes[0])

    assert wait_until(is_placed, timeout_s=60, poll_s=0.2)
    return nodes[0]


def test_two_weights_are_changed_replayed_applied_and_undone(page: Page, fleet: Fleet) -> None:
    assert place_pod(fleet, "before") == "edge-1"
    page.goto("/scheduler")
    expect(page.locator("#state")).to_have_attribute("data-state", "running")
    find_weight(page, "NodeAffinity").fill("1")
    find_weight(page, "NodeResourcesFit").fill("100")
    expect(page.locator("#yaml .added").filter(has_text="weight: 100")).to_be_visible()
    page.locator("#replay-button").click()
    moved = page.locator("#replay-pods tr").filter(has_text="before")
    expect(moved).to_contain_text("edge-1")
    expect(moved.locator("td").nth(2)).not_to_have_text("edge-1")
    page.locator("#apply").click()
    expect(page.locator("#state")).to_have_attribute("data-state", "running")
    expect(page.locator("#reloads")).to_contain_text("ConfigReloaded")
    assert place_pod(fleet, "after") != "edge-1"
    page.locator("#undo").click()
    expect(page.locator("#state")).to_have_attribute("data-state", "running")
    assert place_pod(fleet, "undone") == "edge-1"


def test_a_mistake_stands_at_its_field_and_nothing_is_written(page: Page, fleet: Fleet) -> None:
    del fleet
    page.goto("/scheduler")
    limit = page.get_by_label("maxLatency", exact=True).first
    limit.fill("soon")
    expect(page.locator("#problems")).to_contain_text("1 mistake")
    expect(limit).to_have_attribute("aria-invalid", "true")


def test_a_slider_and_its_number_are_one_value(page: Page, fleet: Fleet) -> None:
    del fleet
    page.goto("/scheduler")
    slider = page.get_by_label("Weight of NodeAffinity, slider").first
    slider.focus()
    before = int(find_weight(page, "NodeAffinity").input_value())
    page.keyboard.press("ArrowRight")
    expect(find_weight(page, "NodeAffinity")).to_have_value(str(before + 1))
    expect(page.locator("#changes strong")).to_be_visible()
