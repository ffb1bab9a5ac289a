"""What the token of a node's agent is good for: that node's telemetry, as long as its pod lives; the labeller's for its labels."""

from collections.abc import Iterator
from typing import Any

import pytest
from tests.live.attacks import agent_tokens
from tests.live.attacks.table.kinds import CRD, NODE, POD, SECRET, TELEMETRY

from robotapp_api.model.telemetry import node_owner
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane.api import APPLY, Api
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.nodes import robot
from robotapp_testbed.machines.telemetry import node_uids

pytestmark = pytest.mark.live

MINE, OTHERS = "agents-own-node", "agents-other-node"
STATUS = {"intervalSeconds": 10, "seq": 3, "arch": "arm64"}
Json = dict[str, Any]


@pytest.fixture(scope="module")
def plane(installed_plane: ControlPlane) -> Iterator[ControlPlane]:
    nodes = [robot(MINE), robot(OTHERS)]
    topology.apply(installed_plane, nodes)
    yield installed_plane
    topology.remove(installed_plane, nodes)


@pytest.fixture(scope="module")
def agent(plane: ControlPlane) -> Iterator[Api]:
    found = agent_tokens.api(plane, agent_tokens.bound_token(plane, MINE))
    yield found
    found.close()
    agent_tokens.remove(plane, MINE)


@pytest.fixture
def clean(plane: ControlPlane) -> Iterator[ControlPlane]:
    yield plane
    plane.kubectl("delete", "nodetelemetry", MINE, OTHERS, "--ignore-not-found")


def telemetry(plane: ControlPlane, name: str = MINE) -> Json:
    owner = node_owner(name=name, uid=node_uids(plane)[name])
    return {
        "apiVersion": TELEMETRY.version,
        "kind": "NodeTelemetry",
        "metadata": {"name": name, "ownerReferences": [owner]},
    }


def refused(call: Any, *arguments: Any) -> ApiStatusError:
    with pytest.raises(ApiStatusError) as caught:
        call(*arguments)
    return caught.value


def test_an_agent_creates_its_telemetry_owned_by_its_node_and_writes_the_status(
    clean: ControlPlane, agent: Api
) -> None:
    agent.create(TELEMETRY.path(""), telemetry(clean))
    path = TELEMETRY.path("", MINE, "status")
    assert agent.patch(path, {"status": STATUS})["status"]["seq"] == 3
    assert agent.get(TELEMETRY.path("", MINE))["status"]["seq"] == 3


def test_a_write_of_the_status_carries_nothing_else(clean: ControlPlane, agent: Api) -> None:
    """The API server drops it, so there is no refusal that the table of attacks could look for."""
    agent.create(TELEMETRY.path(""), telemetry(clean))
    metadata = {"labels": {"a": "b"}, "annotations": {"a": "b"}, "finalizers": ["a.b/c"], "ownerReferences": None}
    body = {"metadata": metadata, "spec": {"probe": [OTHERS]}, "status": STATUS}
    stored = agent.patch(TELEMETRY.path("", MINE, "status"), body)
    assert stored["status"] == STATUS
    assert not {"labels", "annotations", "finalizers"} & stored["metadata"].keys()
    assert stored["metadata"]["ownerReferences"] == telemetry(clean)["metadata"]["ownerReferences"]
    assert not stored.get("spec", {}).get("probe")


def test_a_token_that_names_no_node_writes_nothing(clean: ControlPlane) -> None:
    unbound = agent_tokens.api(clean, agent_tokens.token(clean))
    error = refused(unbound.create, TELEMETRY.path(""), telemetry(clean))
    assert "this token is bound to no node: use the one the kubelet mounts" in error.message
    clean.api.create(TELEMETRY.path(""), telemetry(clean))
    assert "bound to no node" in refused(unbound.patch, TELEMETRY.path("", MINE, "status"), {"status": STATUS}).message
    unbound.close()


def test_a_refusal_names_the_node_of_the_token(clean: ControlPlane, agent: Api) -> None:
    error = refused(agent.create, TELEMETRY.path(""), telemetry(clean, OTHERS))
    assert f"NodeTelemetry {OTHERS} is written by the robotapp agent on that node alone" in error.message
    assert f"this token is bound to node {MINE}" in error.message


def test_a_token_ends_with_its_pod(clean: ControlPlane) -> None:
    stolen = agent_tokens.api(clean, agent_tokens.bound_token(clean, OTHERS))
    stolen.create(TELEMETRY.path(""), telemetry(clean, OTHERS))
    agent_tokens.remove(clean, OTHERS)

    def ended() -> bool:
        try:
            stolen.get(TELEMETRY.path("", OTHERS))
        except ApiStatusError as error:
            return error.status == 401
        return False

    assert wait_until(ended, timeout_s=90)  # the API server remembers a token it has checked for ten seconds
    stolen.close()


def test_an_agent_of_a_node_that_was_replaced_does_not_speak_for_the_new_one(clean: ControlPlane) -> None:
    """Its token names the uid of the node it ran on: what it creates could not be owned by the new node."""
    name = "agents-replaced-node"
    topology.apply(clean, [robot(name)])
    old = agent_tokens.api(clean, agent_tokens.bound_token(clean, name))
    topology.remove(clean, [robot(name)])
    topology.apply(clean, [robot(name)])
    try:
        error = refused(old.create, TELEMETRY.path(""), telemetry(clean, name))
        assert "may name its own Node with its uid" in error.message or error.status == 401
    finally:
        old.close()
        agent_tokens.remove(clean, name)
        topology.remove(clean, [robot(name)])


@pytest.mark.parametrize(
    "path",
    [
        SECRET.path(agent_tokens.NAMESPACE),
        SECRET.path(agent_tokens.NAMESPACE, "robotapp-agent-key"),
        POD.path(agent_tokens.NAMESPACE),
        NODE.path(""),
        NODE.path("", MINE),
        TELEMETRY.path(""),
        CRD.path(""),
        "/api/v1/configmaps",
        "/apis/discovery.k8s.io/v1/endpointslices",
    ],
)
def test_an_agent_reads_nothing_but_telemetry_by_name_and_the_addresses_of_the_others(agent: Api, path: str) -> None:
    assert refused(agent.get, path).status == 403


def test_an_agent_reads_the_addresses_of_the_others(agent: Api) -> None:
    assert (
        agent.get(f"/apis/discovery.k8s.io/v1/namespaces/{agent_tokens.NAMESPACE}/endpointslices")["items"] is not None
    )


def test_an_agent_deletes_nothing(clean: ControlPlane, agent: Api) -> None:
    clean.api.create(TELEMETRY.path(""), telemetry(clean))
    for path in (
        TELEMETRY.path("", MINE),
        TELEMETRY.path(""),
        NODE.path("", MINE),
        POD.path(agent_tokens.NAMESPACE, f"agent-{MINE}"),
    ):
        assert refused(agent.delete, path).status == 403


def test_the_labeller_writes_and_removes_its_labels(plane: ControlPlane) -> None:
    config = plane.kubectl("config", "view", "--raw", "-o", "jsonpath={.users[0].user.token}", identity="labeller")
    labeller = agent_tokens.api(plane, config)
    path = f"{NODE.path('', MINE)}?fieldManager=labeller"
    body = {
        "apiVersion": "v1",
        "kind": "Node",
        "metadata": {"name": MINE, "labels": {"hardware.robotics.io/can": "true"}},
    }
    stored = labeller.patch(path, body, content_type=APPLY)
    assert stored["metadata"]["labels"]["hardware.robotics.io/can"] == "true"
    body["metadata"] = {"name": MINE}
    labels = labeller.patch(path, body, content_type=APPLY)["metadata"]["labels"]
    assert "hardware.robotics.io/can" not in labels
    assert labels["robotics.io/robot"] == MINE
    labeller.close()
