"""Operators of different versions over the same objects: nobody's template is rolled by accident."""

import time
from typing import Any

import pytest

from campaigns.rigs.live import Tenant, eventually, part

pytestmark = pytest.mark.usefixtures("operator")
RENDERED_BY = "robotics.io/rendered-by"
OLD = {RENDERED_BY: "0.0.1", "robotics.io/content-hash": "of-an-older-version"}


def deployment(tenant: Tenant) -> dict[str, Any]:
    (found,) = tenant.deployments("a")
    return found


def mark(tenant: Tenant, *, links: bool, **annotations: str) -> None:
    """Make the Deployment look as if another version had rendered it, with another template."""
    name = deployment(tenant)["metadata"]["name"]
    path = f"/apis/apps/v1/namespaces/{tenant.namespace}/deployments/{name}"
    template = {"spec": {"enableServiceLinks": links}}
    tenant.cp.api.patch(path, {"metadata": {"annotations": annotations}, "spec": {"template": template}})


def template_generation(tenant: Tenant) -> tuple[bool, int]:
    found = deployment(tenant)
    return found["spec"]["template"]["spec"]["enableServiceLinks"], found["metadata"]["generation"]


def test_on_demand_waits_for_approval_of_this_version(tenant: Tenant, ids: str) -> None:
    tenant.apply("held", part("a"), ros2={"pool": ids}, update={"operator": "OnDemand"})
    tenant.wait_ready("held")
    version = deployment(tenant)["metadata"]["annotations"][RENDERED_BY]
    mark(tenant, links=True, **OLD)
    found = tenant.wait("held", "Progressing", "False", reason="UpdateHeld")
    assert "robotics.io/approve-update" in found["message"]
    assert template_generation(tenant)[0] is True
    tenant.cp.kubectl("annotate", "ra", "held", "-n", tenant.namespace, f"robotics.io/approve-update={version}")
    eventually(lambda: template_generation(tenant)[0] is False)
    tenant.wait("held", "Progressing", "False", reason="UpToDate")
    tenant.wait_ready("held")


def test_on_demand_rolls_the_users_own_edit_at_once(tenant: Tenant, ids: str) -> None:
    tenant.apply("edited", part("a"), ros2={"pool": ids}, update={"operator": "OnDemand"})
    tenant.wait_ready("edited")
    mark(tenant, links=True, **OLD)
    tenant.wait("edited", "Progressing", "False", reason="UpdateHeld")
    tenant.edit("edited", components=[part("a", args=["new"])])
    eventually(lambda: deployment(tenant)["spec"]["template"]["spec"]["containers"][0].get("args") == ["new"])
    tenant.wait_ready("edited")


def test_automatic_takes_over_from_an_older_operator(tenant: Tenant, ids: str) -> None:
    tenant.apply("taken", part("a"), ros2={"pool": ids})
    tenant.wait_ready("taken")
    mark(tenant, links=True, **OLD)
    eventually(lambda: template_generation(tenant)[0] is False)
    tenant.wait_ready("taken")


def test_a_newer_operators_template_is_left_alone(tenant: Tenant, ids: str) -> None:
    tenant.apply("ahead", part("a"), ros2={"pool": ids})
    tenant.wait_ready("ahead")
    mark(tenant, links=True, **{RENDERED_BY: "99.0.0", "robotics.io/content-hash": "of-a-newer-version"})
    tenant.wait_ready("ahead")
    before = template_generation(tenant)
    time.sleep(2)
    assert template_generation(tenant) == before
    assert before[0] is True
