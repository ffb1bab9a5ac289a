"""How full a pool is can be read off `kubectl get domainpools`."""

import secrets
import time
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

import pytest

from campaigns.rigs import quiet
from campaigns.rigs.appwatch import condition
from campaigns.rigs.live import POOLS, Tenant, eventually, part, pool
from robotapp_operator.reconcile.controller import POOL_REST_S
from robotapp_operator.watch.informers import POOL_DELAY_S
from robotapp_testbed import ControlPlane

pytestmark = pytest.mark.usefixtures("operator")


def test_a_quota_of_zero_means_none_an_absent_one_no_limit_and_a_pool_that_serves_no_namespace_has_a_condition(
    installed_plane: ControlPlane, tenant: Tenant
) -> None:
    tag = secrets.token_hex(3)
    with (
        pool(installed_plane, f"open-{tag}") as unlimited,
        pool(installed_plane, f"none-{tag}", quota={"default": 0}) as none,
        pool(installed_plane, f"named-{tag}", quota={"default": 0, "namespaces": {tenant.namespace: 1}}) as named,
    ):

        def usable() -> dict[str, Any]:
            return dict(condition(installed_plane.api.get(f"{POOLS}/{none}"), "Usable"))

        most = {unlimited: 2, none: 0, named: 1}
        for name, served in most.items():
            for number in range(2):
                app = f"{name}-{number}"
                tenant.apply(app, part("a"), ros2={"pool": name})
                if number < served:
                    tenant.wait_ready(app)
        for name, served in most.items():
            for number in range(served, 2):
                told = tenant.wait(f"{name}-{number}", "Allocated", "False", reason="QuotaExceeded")["message"]
                assert f"DomainPool {name}" in told
        eventually(lambda: usable().get("status") == "False", what=usable)
        assert usable()["reason"] == "QuotaIsZero"
        assert "leave it out for no limit" in usable()["message"]
        installed_plane.api.patch(f"{POOLS}/{none}", {"spec": {"quota": {"default": None}}})
        tenant.wait_ready(f"{none}-0")
        for name in most:
            for number in range(2):
                tenant.delete(f"{name}-{number}")
        eventually(lambda: usable().get("status") == "True", what=usable)
        eventually(lambda: not tenant.claims(), timeout_s=90, what=tenant.claims)


def test_a_reserved_id_is_not_accepted_until_the_pool_gives_it_and_then_stays_with_its_holder(
    installed_plane: ControlPlane, tenant: Tenant
) -> None:
    with pool(installed_plane, f"reserved-{secrets.token_hex(3)}", reserved=[0, 7]) as name:
        tenant.apply("greedy", part("a"), ros2={"pool": name, "domain": 7})
        said = tenant.wait("greedy", "Accepted", "False", reason="InvalidSpec")["message"]
        assert f"domain 7 is reserved in pool {name}" in said
        assert "leave spec.ros2.domain out" in said
        assert tenant.claims() == []
        assert tenant.deployments() == []
        installed_plane.api.patch(f"{POOLS}/{name}", {"spec": {"reserved": [0]}})
        tenant.wait_ready("greedy")
        before = tenant.deployments()[0]["metadata"]["generation"]
        installed_plane.api.patch(f"{POOLS}/{name}", {"spec": {"reserved": [0, 7]}})
        tenant.apply("late", part("a"), ros2={"pool": name, "domain": 7})
        tenant.wait("late", "Accepted", "False", reason="InvalidSpec")
        assert tenant.condition("greedy", "Accepted")["status"] == "True"
        assert tenant.deployments("a")[0]["metadata"]["generation"] == before, "what drives is not touched"
        for app in ("late", "greedy"):
            tenant.delete(app)
        eventually(lambda: not tenant.claims(), timeout_s=90, what=tenant.claims)


def test_zero_needs_leave_in_the_spec_and_in_the_pool(installed_plane: ControlPlane, tenant: Tenant) -> None:
    with pool(installed_plane, f"reserved-{secrets.token_hex(3)}") as name:
        tenant.apply("zero", part("a"), ros2={"pool": name, "domain": 0, "allowUnsafeDomain": True})
        tenant.wait("zero", "Accepted", "False", reason="InvalidSpec")
        installed_plane.api.patch(f"{POOLS}/{name}", {"spec": {"reserved": []}})
        tenant.wait_ready("zero")
        tenant.delete("zero")
        eventually(lambda: not tenant.claims(), timeout_s=90, what=tenant.claims)


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
        tenant.apply(f"app-{number}", part("a"), ros2={"pool": ids})
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
