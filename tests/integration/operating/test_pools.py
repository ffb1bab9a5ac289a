"""How full a pool is can be read off `kubectl get domainpools`."""

import time
from datetime import UTC, datetime
from itertools import pairwise

import pytest
from tests.support import quiet
from tests.support.live import POOLS, Tenant, eventually, part

from robotapp_operator.controller import POOL_REST_S
from robotapp_operator.informers import POOL_DELAY_S
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.usefixtures("operator")


def test_kubectl_shows_how_full_a_pool_is_and_nothing_is_written_at_rest(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    def used() -> str:
        line = installed_plane.kubectl("get", "domainpool", ids, "--no-headers")
        return line.split()[3]

    def written(since: datetime) -> list[datetime]:
        """When its status was written."""
        refs = [
            (item["objectRef"], item["requestReceivedTimestamp"]) for item in quiet.writes_since(installed_plane, since)
        ]
        mine = [stamp for ref, stamp in refs if (ref["resource"], ref.get("name")) == ("domainpools", ids)]
        return sorted(map(datetime.fromisoformat, mine))

    eventually(lambda: used() == "0/119", what=used)
    began = datetime.now(UTC)
    for number in range(10):
        tenant.apply(f"app-{number}", part("a"), dds={"pool": ids})
    for number in range(10):
        tenant.wait_ready(f"app-{number}")
    eventually(lambda: used() == "10/119", what=used)
    # However long a busy machine takes for the burst: a write after its beginning, and after each rest one that ends it.
    times = written(began)
    assert times
    assert all((later - sooner).total_seconds() >= POOL_REST_S for sooner, later in pairwise(times)), times
    began = datetime.now(UTC)
    time.sleep(POOL_REST_S + POOL_DELAY_S + 1.0)  # longer than a write is ever put off
    assert written(began) == []
    for number in range(10):
        tenant.delete(f"app-{number}")
    eventually(lambda: used() == "0/119", timeout_s=90, what=used)
    status = installed_plane.api.get(f"{POOLS}/{ids}")["status"]
    assert (status["capacity"], status["claimed"], status["quarantined"]) == (119, 0, 0)
