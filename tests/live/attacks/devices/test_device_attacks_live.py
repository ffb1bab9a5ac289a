"""Attacks on devices that need more than one write: allocations past the schedulers, and a namespace with admin access."""

import secrets
from collections.abc import Iterator
from typing import Any

import pytest
from tests.live.attacks.attackers import Attackers, attacked
from tests.live.attacks.table.attack import Stop
from tests.live.attacks.table.devices import SLICES, claim_body
from tests.live.attacks.table.kinds import NAMESPACE, RESOURCE_CLAIM, RESOURCE_SLICE
from tests.live.attacks.table.stolen_agents import NODE, OTHER

from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.api import APPLY
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.live
Json = dict[str, Any]
ADMIN_ACCESS = {"metadata": {"labels": {"resource.kubernetes.io/admin-access": "true"}}}


@pytest.fixture(scope="module")
def attackers(installed_plane: ControlPlane) -> Iterator[Attackers]:
    end = secrets.token_hex(3)
    with attacked(installed_plane, f"devices-{end}", f"devices-victim-{end}") as attackers:
        yield attackers


@pytest.fixture(scope="module")
def claim(attackers: Attackers) -> str:
    """Path of a tenant's own claim, which nobody has allocated."""
    body = claim_body() | {"apiVersion": RESOURCE_CLAIM.version, "kind": RESOURCE_CLAIM.kind}
    body["metadata"] = {"name": "own"}
    attackers.apis["tenant"].create(RESOURCE_CLAIM.path(attackers.namespaces["own"]), body)
    return RESOURCE_CLAIM.path(attackers.namespaces["own"], "own")


def refusal(call: Any, *arguments: Any, **options: Any) -> str:
    with pytest.raises(ApiStatusError) as caught:
        call(*arguments, **options)
    assert caught.value.status == 403
    return caught.value.message


def allocation(device: str) -> Json:
    result = {"request": "arm", "driver": DRIVER, "pool": OTHER, "device": device}
    return {"status": {"allocation": {"devices": {"results": [result]}}}}


@pytest.mark.parametrize("who", ["tenant", "clerk", "deputy", "operator", "agent", "labeller", "kubelet", "vendor"])
def test_only_schedulers_and_controllers_allocate_a_claim(attackers: Attackers, claim: str, who: str) -> None:
    body = allocation("serial-0403-6001-a50285bi")
    api = attackers.apis[who]
    assert "cannot patch resource" in refusal(api.patch, f"{claim}/status", body)
    applied = {"apiVersion": RESOURCE_CLAIM.version, "kind": RESOURCE_CLAIM.kind, "metadata": {"name": "own"}, **body}
    path = f"{claim}/status?fieldManager=attacker&force=true"
    assert "cannot patch resource" in refusal(api.patch, path, applied, content_type=APPLY)
    stored = attackers.admin.get(claim)
    assert "cannot update resource" in refusal(api.request, "PUT", f"{claim}/status", stored | body)
    assert "allocation" not in attackers.admin.get(claim).get("status", {})


def test_a_claim_is_not_born_with_an_allocation(attackers: Attackers) -> None:
    body = claim_body() | allocation("serial-0403-6001-a50285bi")
    body |= {"apiVersion": RESOURCE_CLAIM.version, "kind": RESOURCE_CLAIM.kind, "metadata": {"name": "born"}}
    stored = attackers.apis["tenant"].create(RESOURCE_CLAIM.path(attackers.namespaces["own"]), body)
    assert "allocation" not in stored.get("status", {})


def test_the_claim_of_an_app_stays_one_whatever_a_single_write_takes_away(attackers: Attackers) -> None:
    """Without label and owner nobody would give its device back any more."""
    labels = {"robotics.io/app-uid": "u", "robotics.io/instance": "robot-1", "robotics.io/component": "driver"}
    body = claim_body() | {"apiVersion": RESOURCE_CLAIM.version, "kind": RESOURCE_CLAIM.kind}
    body["metadata"] = {"name": "of-app", "labels": labels}
    attackers.apis["operator"].create(RESOURCE_CLAIM.path(attackers.namespaces["own"]), body)
    path = RESOURCE_CLAIM.path(attackers.namespaces["own"], "of-app")
    text = refusal(attackers.apis["tenant"].patch, path, {"metadata": {"labels": None}})
    assert "labels app-uid, instance and component of a RobotApp's ResourceClaim never change" in text
    assert attackers.admin.get(path)["metadata"]["labels"] == labels


def test_the_admin_of_a_namespace_cannot_allow_it_admin_access(attackers: Attackers) -> None:
    path = NAMESPACE.path("", attackers.namespaces["own"])
    assert "cannot patch resource" in refusal(attackers.apis["tenant"].patch, path, ADMIN_ACCESS)


def test_the_kubelet_and_the_admin_publish_a_nodes_own_pool(attackers: Attackers) -> None:
    """The policy about slices refuses nothing that a node needs."""
    honest = next(attack.good for attack in SLICES if attack.stop is Stop.SLICE)
    body = {**honest, "apiVersion": RESOURCE_SLICE.version, "kind": RESOURCE_SLICE.kind}
    assert body["spec"]["nodeName"] == NODE
    for who, api in {"kubelet": attackers.apis["kubelet"], "admin": attackers.admin}.items():
        body["metadata"] = {**honest["metadata"], "name": f"honest-{who}"}
        api.create(RESOURCE_SLICE.path(""), body)
        attackers.admin.delete(RESOURCE_SLICE.path("", f"honest-{who}"))
