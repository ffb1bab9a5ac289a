"""ros2.shareWith as a user sees it: sharers go where their owner goes, without waiting and without a restart of anything."""

import time
from typing import Any

import pytest

from campaigns.rigs.live import Tenant, eventually, part

pytestmark = pytest.mark.usefixtures("operator")

PROMPT_S = 30.0
"""Half the longest back-off and far below the resync (600 s), above the time an app takes to become Ready on a busy machine."""


def share(*names: str) -> dict[str, Any]:
    return {"shareWith": [{"name": name} for name in names]}


def named(tenant: Tenant, app: str) -> set[str]:
    """Domain ids in the templates of an app's components."""
    return {
        variable["value"]
        for item in tenant.deployments()
        if item["metadata"]["labels"]["robotics.io/app"] == app
        for variable in item["spec"]["template"]["spec"]["containers"][0]["env"]
        if variable["name"] == "ROS_DOMAIN_ID"
    }


def shown(tenant: Tenant, app: str) -> str:
    found: str = tenant.app(app)["status"]["summary"].get("domain", "")
    return found


def held(tenant: Tenant) -> set[int]:
    return {claim["spec"]["domain"]["id"] for claim in tenant.claims()}


def test_a_sharer_follows_its_owner_to_another_domain(tenant: Tenant, ids: str) -> None:
    tenant.apply("mapper", part("a"), ros2={"pool": ids, "domain": 5})
    tenant.apply("teleop", part("b"), ros2=share("mapper"))
    tenant.wait_ready("teleop")
    assert (named(tenant, "teleop"), shown(tenant, "teleop")) == ({"5"}, "5")
    tenant.edit("mapper", ros2={"pool": ids, "domain": 7})
    eventually(lambda: named(tenant, "teleop") == {"7"}, timeout_s=PROMPT_S, what=lambda: named(tenant, "teleop"))
    eventually(lambda: shown(tenant, "teleop") == "7", timeout_s=PROMPT_S)
    for name in ("mapper", "teleop"):
        tenant.wait_ready(name)
    eventually(lambda: held(tenant) == {7}, what=lambda: held(tenant))


def test_an_app_whose_owner_is_created_later_becomes_ready_promptly(tenant: Tenant, ids: str) -> None:
    """Three in a chain, the last one first: each has backed off, or says that its owner does not exist."""
    tenant.apply("viewer", part("c"), ros2=share("teleop"))
    tenant.wait("viewer", "Allocated", "False", reason="InvalidSpec")
    tenant.apply("teleop", part("b"), ros2=share("mapper"))
    text = tenant.wait("teleop", "Ready", "False", reason="InvalidSpec")["message"]
    assert "mapper, which does not exist: create it or remove it" in text
    time.sleep(4)  # long enough to have backed off for some seconds
    tenant.apply("mapper", part("a"), ros2={"pool": ids})
    for name in ("mapper", "teleop", "viewer"):
        tenant.wait_ready(name, timeout_s=PROMPT_S)
    assert named(tenant, "viewer") == named(tenant, "teleop") == named(tenant, "mapper")
    assert len(tenant.claims()) == 1


def test_sharers_of_an_owner_that_is_replaced_go_to_its_successors_domain(tenant: Tenant, ids: str) -> None:
    tenant.apply("mapper", part("a"), ros2={"pool": ids, "domain": 5})
    tenant.apply("teleop", part("b"), ros2=share("mapper"))
    tenant.wait_ready("teleop")
    tenant.delete("mapper")
    tenant.wait("teleop", "Ready", "False", reason="InvalidSpec", timeout_s=PROMPT_S)
    tenant.apply("mapper", part("a"), ros2={"pool": ids, "domain": 7})
    eventually(lambda: named(tenant, "teleop") == {"7"}, timeout_s=PROMPT_S, what=lambda: named(tenant, "teleop"))
    tenant.wait_ready("teleop")
    eventually(lambda: held(tenant) == {7}, what=lambda: held(tenant))


def test_a_ring_has_one_domain_and_its_leader_follows_a_member_that_leaves(tenant: Tenant, ids: str) -> None:
    tenant.apply("b", part("b"), ros2=share("a"))
    tenant.apply("a", part("a"), ros2=share("b") | {"pool": ids})
    for name in ("a", "b"):
        tenant.wait_ready(name)
    (claim,) = tenant.claims()
    assert claim["spec"]["holder"]["name"] == "a"
    assert named(tenant, "a") == named(tenant, "b")
    tenant.edit("a", suspend=True)
    time.sleep(3)  # three sweeps: a suspended leader keeps its claim
    assert [item["metadata"]["uid"] for item in tenant.claims()] == [claim["metadata"]["uid"]]
    assert tenant.claims()[0]["status"]["phase"] == "Reserved"
    tenant.edit("a", suspend=False)
    tenant.edit("b", ros2={"pool": ids, "shareWith": None})
    eventually(lambda: [item["spec"]["holder"]["name"] for item in tenant.claims()] == ["b"], what=tenant.claims)
    for name in ("a", "b"):
        tenant.wait_ready(name)
    assert named(tenant, "a") == named(tenant, "b") == {str(number) for number in held(tenant)}
