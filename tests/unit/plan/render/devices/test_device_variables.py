"""Paths of devices in the variables of a pod's containers."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app

from robotapp_api.values.devices.variables import device_variable
from robotapp_operator.plan.render.parameters import ParameterState
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import Domain, desired_of


def render_pod(**fields: Any) -> dict[str, Any]:
    app = make_app(component("driver", **fields))
    template = pod_template(app.spec.components[0], desired_of(app, ""), domain=Domain(7), state=ParameterState())
    spec: dict[str, Any] = template["spec"]
    return spec


def test_a_fixed_path_is_a_variable_of_every_container_before_those_that_refer_to_it() -> None:
    pod = render_pod(
        devices=[
            {"name": "front-lidar", "type": "serial", "mountAs": "/dev/front"},
            {"name": "base", "type": "serial"},
        ],
        env=[{"name": "PORT", "value": "$(ROBOTAPP_DEVICE_FRONT_LIDAR)"}],
        template={
            "spec": {"initContainers": [{"name": "i", "image": "i"}], "containers": [{"name": "s", "image": "s"}]}
        },
    )
    for container in (*pod["initContainers"][-1:], *pod["containers"]):
        names = [variable["name"] for variable in container["env"]]
        values = {variable["name"]: variable.get("value") for variable in container["env"]}
        assert values["ROBOTAPP_DEVICE_FRONT_LIDAR"] == "/dev/front"
        assert "ROBOTAPP_DEVICE_BASE" not in names, "its path comes with the device"
    names = [variable["name"] for variable in pod["containers"][0]["env"]]
    assert names.index("ROBOTAPP_DEVICE_FRONT_LIDAR") < names.index("PORT")


@given(st.lists(st.from_regex(r"[a-z0-9]([-a-z0-9]{0,8}[a-z0-9])?", fullmatch=True), unique=True, max_size=16))
def test_devices_of_different_names_have_different_variables(names: list[str]) -> None:
    variables = [device_variable(name) for name in names]
    assert len(set(variables)) == len(names)
    assert all(variable.replace("_", "A").isalnum() and variable.isascii() for variable in variables)
