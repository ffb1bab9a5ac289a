"""The table of what an instance costs has the numbers that are rendered."""

import re
from collections import Counter
from pathlib import Path
from typing import Any, Final

import pytest
from tests.support.factories import component, make_app

from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.spec.desired import Domain, desired_of

PAGE: Final = Path(__file__).resolve().parents[3] / "docs/operator.md"
ONE, TWO = [component("driver")], [component("driver"), component("operator")]
FAST_DDS, CYCLONE, ZENOH = ({"rmw": f"rmw_{name}_cpp"} for name in ("fastrtps", "cyclonedds", "zenoh"))
APPS: Final[dict[str, tuple[list[dict[str, Any]], dict[str, Any]]]] = {
    "Fast DDS, two components or more": (TWO, {"ros2": FAST_DDS}),
    "Fast DDS, one component": (ONE, {"ros2": FAST_DDS}),
    "Cyclone DDS, two components or more": (TWO, {"ros2": CYCLONE}),
    "Cyclone DDS, one component": (ONE, {"ros2": CYCLONE}),
    "Zenoh, any number": (ONE, {"ros2": ZENOH}),
    "ROS 1 with a managed master": (TWO, {"ros": {"distro": "noetic"}}),
    "no ROS": (TWO, {"ros": {"distro": "none"}}),
}


def read_table() -> dict[str, tuple[int, int]]:
    section = PAGE.read_text().partition("### What an instance costs")[2].partition("\n### ")[0]
    rows = re.findall(r"^\| ([^|]+) \| (\d+) \| (\d+) \|$", section, flags=re.MULTILINE)
    return {name: (int(pods), int(services)) for name, pods, services in rows}


@pytest.mark.parametrize("name", APPS)
def test_the_page_has_the_pods_and_services_of_an_instance(name: str) -> None:
    components, spec = APPS[name]
    desired = desired_of(make_app(*components, **spec), "")
    children = wanted_children(desired, domain=Domain(7), parameters={}, running=True)
    kinds = Counter(child.ref.kind for child in children)
    assert read_table()[name] == (kinds["Deployment"] - len(components), kinds["Service"])


def test_every_row_of_the_page_is_counted() -> None:
    assert set(read_table()) == set(APPS)
