"""`Allocated` is settled where nothing is to be claimed: a GPU comes from its device plugin, a shared device has no holder."""

import pytest

from campaigns.rigs.live import Tenant, part

pytestmark = pytest.mark.usefixtures("operator")


def test_an_app_with_a_gpu_and_a_shared_bus_does_not_wait_for_claims_that_nobody_makes(
    tenant: Tenant, ids: str
) -> None:
    devices = [{"name": "gpu", "type": "gpu"}, {"name": "tap", "type": "can", "sharing": "Cluster"}]
    tenant.apply("vision", part("detector", devices=devices), ros2={"pool": ids})
    said = tenant.wait("vision", "Allocated", "True", reason="Allocated")["message"]
    assert "devices without a claim: 1 handed out by a device plugin (gpu), 1 shared" in said
    assert tenant.app("vision")["status"]["summary"].get("devices", "") in ("", "0/0", "-")
