"""What a node's agent may do with the driver beside it: slices of its own node and driver, and reading by name."""

from collections.abc import Iterator
from typing import Any

import pytest
from tests.live.attacks import agent_tokens

from robotapp_agent.driver.rules.slices import slices_of
from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.nodes import robot
from robotapp_testbed.machines.telemetry import node_uids

pytestmark = pytest.mark.live

MINE, OTHERS = "drivers-own-node", "drivers-other-node"
SLICES = "/apis/resource.k8s.io/v1/resourceslices"
POLICY = "robotapp-agent-driver"
POLICY_S = 120.0
Json = dict[str, Any]


@pytest.fixture(scope="module")
def plane(installed_plane: ControlPlane) -> Iterator[ControlPlane]:
    nodes = [robot(MINE), robot(OTHERS)]
    topology.apply(installed_plane, nodes)
    product.install(installed_plane, values={"agent": {"driver": {"enabled": True}}})
    yield installed_plane
    for kind in ("validatingadmissionpolicybinding", "validatingadmissionpolicy"):
        installed_plane.kubectl("delete", kind, POLICY)
    installed_plane.kubectl("delete", "deviceclass", DRIVER)
    product.install(installed_plane)
    topology.remove(installed_plane, nodes)


@pytest.fixture(scope="module")
def driver(plane: ControlPlane) -> Iterator[Api]:
    api = agent_tokens.api(plane, agent_tokens.bound_token(plane, MINE))
    # The API server compiles a new policy in the background.
    assert wait_until(lambda: is_refused(api, resource_slice(plane, OTHERS)), timeout_s=POLICY_S)
    yield api
    api.close()
    agent_tokens.remove(plane, MINE)


@pytest.fixture(autouse=True)
def _no_slices(plane: ControlPlane) -> Iterator[None]:
    yield
    plane.kubectl("delete", "resourceslices", "--all")


def resource_slice(plane: ControlPlane, node: str = MINE, **spec: Any) -> Json:
    (body,) = slices_of(node, [{"name": "can-can0"}], node_uid=node_uids(plane)[node], generation=1)
    return {"apiVersion": "resource.k8s.io/v1", "kind": "ResourceSlice", **body, "spec": {**body["spec"], **spec}}


def is_refused(api: Api, body: Json) -> bool:
    try:
        api.create(f"{SLICES}?dryRun=All", body)
    except ApiStatusError as error:
        return error.status == 403
    return False


def refused(call: Any, *arguments: Any) -> str:
    with pytest.raises(ApiStatusError) as caught:
        call(*arguments)
    assert caught.value.status == 403
    return caught.value.message


def test_a_driver_publishes_changes_and_removes_the_slices_of_its_node(plane: ControlPlane, driver: Api) -> None:
    stored = driver.create(SLICES, resource_slice(plane))
    path = f"{SLICES}/{stored['metadata']['name']}"
    stored["spec"]["devices"] = []
    assert driver.request("PUT", path, stored)["spec"].get("devices", []) == []
    driver.delete(path)


def test_a_driver_touches_no_slice_of_another_node(plane: ControlPlane, driver: Api) -> None:
    assert f"this token is bound to node {MINE}" in refused(driver.create, SLICES, resource_slice(plane, OTHERS))
    stored = plane.api.create(SLICES, resource_slice(plane, OTHERS))
    path = f"{SLICES}/{stored['metadata']['name']}"
    assert "of its own node alone" in refused(driver.delete, path)
    assert "of its own node alone" in refused(
        driver.request, "PUT", path, {**stored, "spec": {**stored["spec"], "devices": []}}
    )


OWN_NODE = "of the driver devices.robotics.io and of its own node"
OWN_POOL = "write spec.nodeName, the same name as spec.pool.name"


@pytest.mark.parametrize(
    "spec",
    [
        {"driver": "gpu.example.org"},
        {"nodeName": None, "allNodes": True},
        {"pool": {"name": "everybody", "generation": 1, "resourceSliceCount": 1}},
    ],
)
def test_a_driver_writes_no_slice_of_another_driver_pool_or_all_nodes(
    plane: ControlPlane, driver: Api, spec: Json
) -> None:
    """Two policies refuse the last two, and the API server answers with the words of either."""
    refusal = refused(driver.create, SLICES, resource_slice(plane, **spec))
    assert any(words in refusal for words in (OWN_NODE, OWN_POOL)), refusal


def test_a_driver_names_only_its_own_node_as_owner(plane: ControlPlane, driver: Api) -> None:
    body = resource_slice(plane)
    body["metadata"]["ownerReferences"][0]["uid"] = node_uids(plane)[OTHERS]
    assert "may name its own Node with its uid" in refused(driver.create, SLICES, body)


@pytest.mark.parametrize(
    "path",
    [
        SLICES,
        "/apis/resource.k8s.io/v1/resourceclaims",
        "/apis/resource.k8s.io/v1/deviceclasses",
        "/api/v1/nodes",
        "/api/v1/pods",
        "/api/v1/namespaces/robotapp-agent/secrets",
        "/apis/robotics.io/v1alpha1/robotclaims",
    ],
)
def test_a_driver_lists_nothing(driver: Api, path: str) -> None:
    refused(driver.get, path)


def test_a_driver_changes_no_claim(plane: ControlPlane, driver: Api) -> None:
    claims = "/apis/resource.k8s.io/v1/namespaces/default/resourceclaims"
    body = {
        "apiVersion": "resource.k8s.io/v1",
        "kind": "ResourceClaim",
        "metadata": {"name": "drivers-prey"},
        "spec": {"devices": {"requests": [{"name": "a", "exactly": {"deviceClassName": DRIVER}}]}},
    }
    refused(driver.create, claims, body)
    plane.api.create(claims, body)
    try:
        assert driver.get(f"{claims}/drivers-prey")["metadata"]["name"] == "drivers-prey"
        refused(driver.patch, f"{claims}/drivers-prey/status", {"status": {"allocation": None}})
        refused(driver.delete, f"{claims}/drivers-prey")
    finally:
        plane.api.delete(f"{claims}/drivers-prey")
