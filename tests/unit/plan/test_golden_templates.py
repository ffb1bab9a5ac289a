"""Hashes of rendered pod templates. A change here rolls every robot in the world: make it on purpose, and say so in CHANGELOG.

To renew the table after a deliberate change, copy the values this test prints.
"""

from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_operator.plan.changes import wanted_children
from robotapp_operator.plan.compare import content_hash
from robotapp_operator.plan.template import ParamsFile
from robotapp_operator.plan.wish import Domain, wish_of

FULL = component(
    "full",
    args=["run"],
    env=[{"name": "A", "value": "1"}],
    params={"configMap": "c"},
    devices=[{"name": "can", "type": "can", "interface": "can0"}],
    requires=[{"type": "gpu", "model": "nvidia"}],
    ready={"topic": "/odom", "minHz": 20},
    runsOn="Robot",
)
SPECS: dict[str, tuple[str, dict[str, Any]]] = {
    "minimal": ("", {"components": [component("main")]}),
    "robot": ("amr-07", {"components": [component("main", runsOn="Robot"), component("free")]}),
    "full": ("amr-07", {"components": [FULL]}),
    "cyclone": ("", {"dds": {"rmw": "rmw_cyclonedds_cpp"}}),
    "zenoh": ("", {"ros": {"distro": "jazzy"}, "dds": {"rmw": "rmw_zenoh_cpp"}}),
    "noetic": ("", {"ros": {"distro": "noetic"}}),
    "foreign scheduler": ("amr-07", {"components": [FULL], "schedulerName": "default-scheduler"}),
}
GOLDEN: dict[str, list[str]] = {
    "minimal": ["61b67e4970798e3d", "b29a2d0a8f5f7d35", "205531292e02efe6"],
    "robot": ["bf42162e8817bf43", "754b9edaf3852026", "da5697d5f046b05f", "b1fa196915e0f77f"],
    "full": ["bf42162e8817bf43", "754b9edaf3852026", "a72815d336aa3436"],
    "cyclone": ["2c52025c256928ec", "a3406b90d2e95ba0"],
    "zenoh": ["0a16f057825f2c19", "1328fba6f74b7876", "e632ddf84d53a434"],
    "noetic": ["33a02f946f55469f", "b30a87b72dcb0e90", "f782e02be61b229c"],
    "foreign scheduler": ["206b76dab81675a3", "95aeb65b610dfacc", "a84d37a51e065fee"],
}


def templates(robot: str, spec: dict[str, Any]) -> list[str]:
    fields = dict(spec)
    app = make_app(*fields.pop("components", ()), **fields)
    wish = wish_of(app, robot)
    domain = Domain(7, "dds.default.c.7") if app.ros_version == 2 else None
    params = {part.name: ParamsFile("params.yaml", "0123456789abcdef") for part in app.spec.components}
    children = wanted_children(wish, domain=domain, params=params, running=True)
    return [content_hash(child.spec["template"]) for child in children if "template" in child.spec]


@pytest.mark.parametrize("name", SPECS)
def test_the_template_is_the_one_that_is_deployed_out_there(name: str) -> None:
    assert templates(*SPECS[name]) == GOLDEN[name]
