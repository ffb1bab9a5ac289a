"""Hashes of rendered pod templates. A change here rolls every robot in the world: make it on purpose, and say so in CHANGELOG.

To renew the table after a deliberate change, copy the values this test prints.
"""

from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.render.parameters import ParameterState
from robotapp_operator.plan.spec.covers import content_hash
from robotapp_operator.plan.spec.desired import Domain, desired_of

FULL = component(
    "full",
    args=["run"],
    env=[{"name": "A", "value": "1"}],
    parameters=[{"inline": "/**: {ros__parameters: {v: 1.0}}"}, {"configMapKeyRef": {"name": "c", "key": "k.yaml"}}],
    devices=[{"name": "can", "type": "can", "interface": "can0"}],
    requires=[{"type": "gpu", "model": "nvidia"}],
    ready={"topic": {"name": "/odom", "minRate": 20}},
    runsOn=["Robot"],
)
SPECS: dict[str, tuple[str, dict[str, Any]]] = {
    "minimal": ("", {"components": [component("main")]}),
    "robot": ("amr-07", {"components": [component("main", runsOn=["Robot"]), component("free")]}),
    "full": ("amr-07", {"components": [FULL]}),
    "on board as a fallback": ("amr-07", {"components": [component("main", runsOn=["Edge", "Robot"])]}),
    "cyclone": ("", {"ros2": {"rmw": "rmw_cyclonedds_cpp"}}),
    "zenoh": ("", {"ros": {"distro": "jazzy"}, "ros2": {"rmw": "rmw_zenoh_cpp"}}),
    "noetic": ("", {"ros": {"distro": "noetic"}}),
    "foreign scheduler": ("amr-07", {"components": [FULL], "schedulerName": "default-scheduler"}),
}
GOLDEN: dict[str, list[str]] = {
    "minimal": ["9101de08c1bd35b2"],
    "robot": ["6823bd24f70a6fde", "940fcb97985a0ea3", "d640ff77081210a3", "83e881116e706fc9"],
    "full": ["a454d192bf5d9ba1"],
    "on board as a fallback": ["db2c668e58d2ef0b"],
    "cyclone": ["d8763bc859da97dc", "b3a8ba986b65500d"],
    "zenoh": ["bd43cbe019d05536", "5e558dd1604e1ad1", "2a5ec09b559e04c6"],
    "noetic": ["b0910314430f6ca3", "df945259d7216be1", "b61feba86447e18d"],
    "foreign scheduler": ["0427c01fb8e3011a"],
}


def templates(robot: str, spec: dict[str, Any]) -> list[str]:
    fields = dict(spec)
    app = make_app(*fields.pop("components", ()), **fields)
    desired = desired_of(app, robot)
    domain = Domain(7, "dds.default.c.7") if app.ros_version == 2 else None
    state = {part.name: ParameterState(hash="0123456789abcdef") for part in app.spec.components if part.parameters}
    children = wanted_children(desired, domain=domain, parameters=state, running=True)
    return [content_hash(child.spec["template"]) for child in children if "template" in child.spec]


@pytest.mark.parametrize("name", SPECS)
def test_the_template_is_the_one_that_is_deployed_out_there(name: str) -> None:
    assert templates(*SPECS[name]) == GOLDEN[name]
