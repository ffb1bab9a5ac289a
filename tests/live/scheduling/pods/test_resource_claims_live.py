"""ResourceClaims of a real API server: refused while nobody allocated them, honoured and shared once somebody did."""

from typing import Any

import pytest

from campaigns.rigs.stage import Json, Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("scheduler")]

DEVICES = {"requests": [{"name": "camera", "exactly": {"deviceClassName": "camera.example.com"}}]}


def path(stage: Stage, kind: str = "resourceclaims") -> str:
    return f"/apis/resource.k8s.io/v1/namespaces/{stage.namespace}/{kind}"


def allocate(stage: Stage, name: str, node: str) -> None:
    """What an allocating scheduler writes: the devices can be reached from this node."""
    term = {"matchFields": [{"key": "metadata.name", "operator": "In", "values": [node]}]}
    allocation = {"devices": {}, "nodeSelector": {"nodeSelectorTerms": [term]}}
    stage.cp.api.patch(f"{path(stage)}/{name}/status", {"status": {"allocation": allocation}})


def users(stage: Stage, name: str) -> set[str]:
    claim: Json = stage.cp.api.get(f"{path(stage)}/{name}")
    return {user["name"] for user in claim["status"].get("reservedFor", ())}


def wishing(name: str, **source: Any) -> Json:
    return pod(name, resourceClaims=[{"name": "camera", **source}])


def test_a_claim_is_waited_for_until_it_is_allocated_and_then_followed_and_shared(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1"), edge("edge-2"), edge("edge-3")):
        stage.create_pod(wishing("early", resourceClaimName="shared"))
        refused = "resource claim 'shared' is not allocated; this scheduler does not allocate devices"
        assert stage.wait_refused("early", reason="Unschedulable", saying=refused)
        stage.cp.api.create(path(stage), {"metadata": {"name": "shared"}, "spec": {"devices": DEVICES}})
        allocate(stage, "shared", "edge-2")
        assert stage.wait_bound("early") == "edge-2"
        assert users(stage, "shared") == {"early"}
        for number in range(5):
            stage.create_pod(wishing(f"late-{number}", resourceClaimName="shared"))
        assert {stage.wait_bound(f"late-{number}") for number in range(5)} == {"edge-2"}
        assert users(stage, "shared") == {"early", *(f"late-{number}" for number in range(5))}


def test_a_claim_made_from_a_template_is_followed_once_it_is_allocated(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1"), edge("edge-2")):
        body = {"metadata": {"name": "cameras"}, "spec": {"spec": {"devices": DEVICES}}}
        stage.cp.api.create(path(stage, "resourceclaimtemplates"), body)
        stage.create_pod(wishing("own", resourceClaimTemplateName="cameras"))

        def made() -> str:
            told = stage.pod("own")["status"].get("resourceClaimStatuses", ())
            return next((each.get("resourceClaimName", "") for each in told), "")

        stage.wait(made, what=lambda: f"no claim was made: {stage.pod('own')['status']}")
        allocate(stage, made(), "edge-1")
        assert stage.wait_bound("own") == "edge-1"
        assert users(stage, made()) == {"own"}
