"""Operators without the flag for access to the node: such an app is not accepted, and one that ran before runs on."""

import secrets
from collections.abc import Iterator
from typing import Any

import pytest
from tests.live.operating.fields.test_host_access_live import REACHES, deployment

from campaigns.rigs.live import HandBinder, Tenant, eventually, part
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created

Json = dict[str, Any]


@pytest.fixture
def own(installed_plane: ControlPlane) -> Iterator[Tenant]:
    """A namespace of the test's own operators: no other one runs beside this module."""
    with created(installed_plane, f"own-{secrets.token_hex(3)}") as name, HandBinder(installed_plane, name):
        yield Tenant(installed_plane, name)


@pytest.mark.usefixtures("nodes")
def test_without_the_flag_such_an_app_is_not_accepted_and_one_that_ran_runs_on(
    installed_plane: ControlPlane, own: Tenant
) -> None:
    common: Json = {"namespaces": own.namespace, "no_leader_election": True, "sweep_seconds": 1}
    with_flag = product.start_operator(installed_plane, name=f"with-{secrets.token_hex(2)}", **common)
    own.apply("before", part("driver", **REACHES))
    own.wait_ready("before")
    with_flag.stop()
    before = deployment(own, "driver")
    without = product.start_operator(
        installed_plane, name=f"without-{secrets.token_hex(2)}", host_access=False, **common
    )
    try:
        own.apply("after", part("late", template={"spec": {"hostNetwork": True}}))
        refusal = own.wait("after", "Accepted", "False", reason="HostAccessOff")
        assert "component late uses the network of its node (hostNetwork)" in refusal["message"]
        assert "policies.enabled: true" in refusal["message"]
        own.wait("before", "Accepted", "False", reason="HostAccessOff")
        kept = deployment(own, "driver")
        assert kept["metadata"]["uid"] == before["metadata"]["uid"]
        assert kept["spec"] == before["spec"]
        names = [item["metadata"]["labels"].get("robotics.io/component") for item in own.listed("apps/deployments")]
        assert "late" not in names
        own.edit("before", suspend=True)
        assert eventually(lambda: deployment(own, "driver")["spec"]["replicas"] == 0, what=lambda: "suspend acts")
    finally:
        without.stop()
