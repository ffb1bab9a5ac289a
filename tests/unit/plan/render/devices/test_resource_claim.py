"""The ResourceClaim of a component: what it requests, and that the pod template names it in every container."""

import json
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app

from robotapp_agent.driver.rules.device_config import AllocatedConfig, Opaque, RequestConfig, resolve_config
from robotapp_api.model.names import WAITING_STEP, Annotation
from robotapp_api.model.patterns import LABEL_PATTERN
from robotapp_api.values.devices.variables import device_variable
from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.render.child import Child
from robotapp_operator.plan.render.devices.resource_claim import (
    claim_spec,
    may_be_handed_over,
    named_claim,
    wanted_claims,
)
from robotapp_operator.plan.spec.desired import App, Domain, desired_of

LIDAR = {"name": "front-lidar", "type": "serial", "usbID": "10c4:ea60", "mountAs": "/dev/lidar"}
CAMERAS = {"name": "cams", "type": "camera", "count": 2}
BUS = {"name": "bus", "type": "can", "interface": "can0"}
GPU = {"name": "gpu", "type": "gpu"}
SHARED = {"name": "mic", "type": "sound", "sharing": "Cluster"}


def render(app: App, *, claiming: frozenset[str] = frozenset({"driver"}), running: bool = True) -> list[Child]:
    return wanted_children(
        desired_of(app, "amr-07"), domain=Domain(7), parameters={}, running=running, claiming=claiming
    )


def template_of(children: list[Child]) -> dict[str, Any]:
    (driver,) = (child for child in children if child.component == "driver")
    template: dict[str, Any] = driver.spec["template"]
    return template


def test_each_exclusive_device_is_a_request_with_what_the_driver_does_about_it() -> None:
    spec = claim_spec(make_app(component("driver", devices=[LIDAR, CAMERAS, GPU, SHARED])).spec.components[0])
    requests, config = spec["devices"]["requests"], spec["devices"]["config"]
    assert [(request["name"], request["exactly"]["count"]) for request in requests] == [("front-lidar", 1), ("cams", 2)]
    assert all(request["exactly"]["deviceClassName"] == "devices.robotics.io" for request in requests)
    assert [entry["requests"] for entry in config] == [["front-lidar"], ["cams"]]
    first, second = (entry["opaque"]["parameters"] for entry in config)
    kind = {"apiVersion": "devices.robotics.io/v1alpha1", "kind": "DeviceConfig"}
    assert first == kind | {"env": "FRONT_LIDAR", "mountAs": "/dev/lidar"}
    assert second == kind | {"env": "CAMS"}


@given(
    st.from_regex(LABEL_PATTERN, fullmatch=True).filter(
        lambda name: len(name) <= 63 and name.isascii() and "\n" not in name
    ),
    st.sampled_from(["/dev/lidar", "/dev/serial/by-id/usb-FTDI_A5:1.0-if00@x+y"]),
)
def test_the_driver_takes_what_the_claim_of_any_device_has_for_it(name: str, path: str) -> None:
    device = {"name": name, "type": "serial", "mountAs": path}
    (entry,) = claim_spec(make_app(component("driver", devices=[device])).spec.components[0])["devices"]["config"]
    parameters = json.dumps(entry["opaque"]["parameters"]).encode()
    config = AllocatedConfig(opaque=Opaque("devices.robotics.io", msgspec.Raw(parameters)))
    assert resolve_config(name, [config]) == RequestConfig(variable=device_variable(name), mount_as=path)


@pytest.mark.parametrize(
    ("devices", "host_network", "expected"),
    [
        ([LIDAR], False, True),
        ([LIDAR, BUS], False, False),
        ([LIDAR, BUS], True, True),
        ([GPU], False, False),
        ([SHARED], False, False),
        ([], False, False),
    ],
)
def test_a_component_without_devices_of_its_own_or_with_a_bus_outside_the_nodes_network_has_no_claim(
    devices: list[dict[str, Any]], host_network: bool, expected: bool
) -> None:
    template = {"spec": {"hostNetwork": True}} if host_network else {}
    part = make_app(component("driver", devices=devices, template=template)).spec.components[0]
    assert may_be_handed_over(part) is expected
    if expected and BUS in devices:
        assert claim_spec(part)["devices"]["config"][1]["opaque"]["parameters"]["network"] == "Host"


def test_every_container_of_the_component_uses_the_claim_and_the_init_step_of_ours_does_not() -> None:
    further = {"initContainers": [{"name": "i", "image": "i"}], "containers": [{"name": "s", "image": "s"}]}
    app = make_app(component("driver", devices=[LIDAR], resources={"limits": {"cpu": "1"}}, template={"spec": further}))
    children = render(app)
    template = template_of(children)
    pod = template["spec"]
    own = [item for item in (*pod["initContainers"], *pod["containers"]) if item["name"] != WAITING_STEP]
    assert [item["resources"]["claims"] for item in own] == [[{"name": "devices"}]] * 3
    assert pod["containers"][0]["resources"]["limits"] == {"cpu": "1"}
    steps = [item for item in pod["initContainers"] if item["name"] == WAITING_STEP]
    assert all("claims" not in item.get("resources", {}) for item in steps)
    (claim,) = wanted_claims(app, children)
    (driver,) = (child for child in children if child.component == "driver")
    assert claim.name == named_claim(driver.spec) == driver.ref.name
    assert claim.labels == driver.labels
    body = claim.body(app)
    (owner,) = body["metadata"]["ownerReferences"]
    assert (owner["uid"], owner["controller"], owner["blockOwnerDeletion"]) == (app.uid, True, False)
    assert "finalizers" not in body["metadata"]


def test_another_wish_rolls_the_pod_and_a_component_without_pods_wants_no_claim() -> None:
    first = render(make_app(component("driver", devices=[LIDAR])))
    second = render(make_app(component("driver", devices=[LIDAR | {"usbID": "10c4:ea61"}])))
    hashes = [template_of(each)["metadata"]["annotations"][Annotation.DEVICES_HASH] for each in (first, second)]
    assert hashes[0] != hashes[1]
    app = make_app(component("driver", devices=[LIDAR]))
    assert wanted_claims(app, render(app, running=False)) == []
    stopped = make_app(component("driver", devices=[LIDAR], replicas=0))
    assert wanted_claims(stopped, render(stopped)) == []


def test_without_a_claim_the_pod_is_as_it_was() -> None:
    app = make_app(component("driver", devices=[LIDAR | {"mountAs": None}]))
    template = template_of(render(app, claiming=frozenset()))
    assert "resourceClaims" not in template["spec"]
    assert str(Annotation.DEVICES_HASH) not in template["metadata"].get("annotations", {})
    assert wanted_claims(app, render(app, claiming=frozenset())) == []


TEXTS = st.text(alphabet="\"\\'\n{}()|&$ aä\u2028", max_size=20)


@given(TEXTS, TEXTS)
def test_whatever_is_wished_for_the_claim_is_one_request_of_json(model: str, interface: str) -> None:
    device = {"name": "d", "type": "serial", "model": model, "interface": interface}
    spec = claim_spec(make_app(component("driver", devices=[device])).spec.components[0])
    assert json.loads(json.dumps(spec)) == spec
    ((request,), (config,)) = spec["devices"]["requests"], spec["devices"]["config"]
    kind = {"apiVersion": "devices.robotics.io/v1alpha1", "kind": "DeviceConfig", "env": "D"}
    assert config == {"requests": ["d"], "opaque": {"driver": "devices.robotics.io", "parameters": kind}}
    assert request.keys() == {"name", "exactly"}
    assert len(request["exactly"]["selectors"][0]["cel"]["expression"]) < 10 * 1024
