"""How full a pool is can be read off `kubectl get domainpools`."""

import time

import pytest
from tests.support.live import POOLS, Tenant, eventually, part

from robotapp_testbed import ControlPlane, audit

pytestmark = pytest.mark.usefixtures("operator")
OPERATOR = "system:serviceaccount:robotapp-system:robotapp-operator"


def test_kubectl_shows_how_full_a_pool_is_and_nothing_is_written_at_rest(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    def used() -> str:
        line = installed_plane.kubectl("get", "domainpool", ids, "--no-headers")
        return line.split()[3]

    def status_writes(after: int) -> int:
        found = audit.writes(installed_plane.audit()[after:], user=OPERATOR)
        mine = [item for item in found if item["objectRef"].get("name") == ids]
        return sum(item["objectRef"]["resource"] == "domainpools" for item in mine)

    eventually(lambda: used() == "0/119", what=used)
    before = len(installed_plane.audit())
    for number in range(10):
        tenant.apply(f"app-{number}", part("a"), dds={"pool": ids})
    for number in range(10):
        tenant.wait_ready(f"app-{number}")
    eventually(lambda: used() == "10/119", what=used)
    assert status_writes(before) <= 2, "a burst is one write, or two when it falls apart"
    before = len(installed_plane.audit())
    time.sleep(6)  # longer than the rest between two writes
    assert status_writes(before) == 0
    for number in range(10):
        tenant.delete(f"app-{number}")
    eventually(lambda: used() == "0/119", timeout_s=90, what=used)
    status = installed_plane.api.get(f"{POOLS}/{ids}")["status"]
    assert (status["capacity"], status["claimed"], status["quarantined"]) == (119, 0, 0)
