"""Robots come and go: what runs for a robot goes with it, and its domain comes back."""

import re
import secrets
from collections.abc import Iterator
from typing import Any

import pytest

from campaigns.rigs.appwatch import condition
from campaigns.rigs.live import Tenant, eventually, part
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.usefixtures("operator")
ALLOWED = "robotics.io/allowed-namespaces"


@pytest.fixture
def robot(installed_plane: ControlPlane) -> Iterator[str]:
    """edge-2 as a robot of this test."""
    name = f"amr-{secrets.token_hex(2)}"
    installed_plane.kubectl("label", "node", "edge-2", f"robotics.io/robot={name}")
    yield name
    installed_plane.kubectl("label", "node", "edge-2", "robotics.io/robot-")
    installed_plane.kubectl("annotate", "node", "edge-2", f"{ALLOWED}-")


def test_a_robot_with_two_computers_waits_until_one_of_them_is_its_primary_one(
    installed_plane: ControlPlane, tenant: Tenant, ids: str, robot: str
) -> None:
    both = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}
    installed_plane.kubectl("label", "node", "edge-1", f"robotics.io/robot={robot}")
    try:
        tenant.apply("fleet", part("driver", runsOn=["Robot"]), robots=both, ros2={"pool": ids})

        def told() -> dict[str, Any]:
            found = tenant.app("fleet")["status"].get("troubled", [])
            return next((item for item in found if item["instance"] == robot), {})

        eventually(lambda: told().get("reason") == "RobotNodeUnclear", what=lambda: tenant.app("fleet"))
        assert "robotics.io/robot-primary" in told()["message"]
        assert {"edge-1", "edge-2"} <= set(re.findall(r"edge-\d", told()["message"]))
        wanted = {robot: ["False", "False"], "robot-1": ["True", "True"], "robot-2": ["True", "True"]}

        def said() -> dict[str, list[str]]:
            """Accepted and Ready of each RobotAppInstance, by its robot."""
            return {
                item["spec"]["robot"]: [str(condition(item, kind).get("status")) for kind in ("Accepted", "Ready")]
                for item in tenant.instances("fleet")
            }

        eventually(lambda: said() == wanted, what=said)
        assert robot not in {claim["spec"]["holder"]["instance"] for claim in tenant.claims()}
        installed_plane.kubectl("label", "node", "edge-1", "robotics.io/robot-primary=true")
        tenant.wait_ready("fleet")
        eventually(lambda: not tenant.app("fleet")["status"].get("troubled"), what=lambda: tenant.app("fleet"))
    finally:
        installed_plane.kubectl("label", "node", "edge-1", "robotics.io/robot-", "robotics.io/robot-primary-")


def test_a_revoked_robot_stops_the_apps_pods_says_why_and_gives_the_domain_back(
    installed_plane: ControlPlane, tenant: Tenant, ids: str, robot: str
) -> None:
    selector = {"nodeSelector": {"matchLabels": {"robotics.io/robot": robot}}}
    tenant.apply("guest", part("driver", runsOn=["Robot"]), robots=selector, ros2={"pool": ids})
    tenant.wait_ready("guest")
    assert len(tenant.claims()) == 1
    installed_plane.kubectl("annotate", "node", "edge-2", f"{ALLOWED}=other")
    said = tenant.wait("guest", "Accepted", "False", reason="NoMatchingRobot")["message"]
    assert f"no robot that admits namespace {tenant.namespace} matches" in said
    assert robot not in said
    assert '"other"' not in said
    eventually(lambda: not tenant.listed("pods") and not tenant.deployments(), what=tenant.children)
    eventually(lambda: not tenant.claims(), what=tenant.claims)
    installed_plane.kubectl("annotate", "node", "edge-2", f"{ALLOWED}-")
    tenant.wait_ready("guest")
    assert len(tenant.claims()) == 1


def test_a_robot_is_closed_by_the_annotation_of_any_of_its_computers(
    installed_plane: ControlPlane, tenant: Tenant, ids: str, robot: str
) -> None:
    installed_plane.kubectl("label", "node", "edge-1", f"robotics.io/robot={robot}")
    installed_plane.kubectl("label", "node", "edge-2", "robotics.io/robot-primary=true")
    installed_plane.kubectl("annotate", "node", "edge-1", f"{ALLOWED}=other")
    try:
        selector = {"nodeSelector": {"matchLabels": {"robotics.io/robot-primary": "true", "robotics.io/robot": robot}}}
        tenant.apply("guest", part("driver", runsOn=["Robot"]), robots=selector, ros2={"pool": ids})
        tenant.wait("guest", "Accepted", "False", reason="NoMatchingRobot")
        assert tenant.claims() == []
        assert tenant.deployments() == []
        installed_plane.kubectl("annotate", "node", "edge-1", f"{ALLOWED}=other,{tenant.namespace}", "--overwrite")
        tenant.wait_ready("guest")
    finally:
        installed_plane.kubectl("annotate", "node", "edge-1", f"{ALLOWED}-")
        installed_plane.kubectl("label", "node", "edge-1", "robotics.io/robot-")
        installed_plane.kubectl("label", "node", "edge-2", "robotics.io/robot-primary-")


def test_a_robot_that_leaves_gives_back_its_own_domain_and_no_other(
    installed_plane: ControlPlane, tenant: Tenant, ids: str, robot: str
) -> None:
    selector = {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}
    tenant.apply("fleet", part("driver", runsOn=["Robot"]), robots={"nodeSelector": selector}, ros2={"pool": ids})
    tenant.wait_ready("fleet")
    before = {claim["spec"]["holder"]["instance"] for claim in tenant.claims()}
    assert robot in before
    installed_plane.kubectl("annotate", "node", "edge-2", f"{ALLOWED}=other")
    eventually(
        lambda: {claim["spec"]["holder"]["instance"] for claim in tenant.claims()} == before - {robot},
        what=tenant.claims,
    )
    tenant.wait_ready("fleet")
