"""Two operators, killed operators, late operators: one domain per instance, and nothing lost or left."""

import secrets
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

import pytest

from campaigns.rigs import quiet
from campaigns.rigs.appwatch import condition
from campaigns.rigs.live import Tenant, eventually, instances_of, part, pool
from robotapp_api.model.names import Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.usefixtures("nodes")


@contextmanager
def running(cp: ControlPlane, **flags: object) -> Iterator[Process]:
    given = {"sweep_seconds": 1, "no_leader_election": True, **flags}
    process = product.start_operator(cp, name=f"operator-{secrets.token_hex(2)}", **given)
    try:
        yield process
    finally:
        process.kill()


def domains(tenant: Tenant) -> list[int]:
    """Ids of all instances that say they are ready."""
    found = [item for app in tenant.apps() for item in instances_of(tenant.cp, app)]
    return [item["status"]["domain"] for item in found if condition(item, "Ready").get("status") == "True"]


def all_ready(tenant: Tenant, count: int) -> Callable[[], bool]:
    return lambda: len(domains(tenant)) == count


def test_an_operator_killed_in_the_middle_of_a_burst_loses_nothing(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    with running(installed_plane) as first:
        for number in range(10):
            tenant.apply(f"app-{number}", part("a"), ros2={"pool": ids})
        eventually(tenant.claims)
        first.kill()
    with running(installed_plane):
        eventually(all_ready(tenant, 10), timeout_s=120, what=lambda: domains(tenant))
        assert len(set(domains(tenant))) == len(tenant.claims()) == 10


def test_deletion_needs_no_operator_and_the_next_one_frees_the_domain(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    with running(installed_plane):
        tenant.apply("gone", part("a"), ros2={"pool": ids})
        tenant.wait_ready("gone")
    tenant.delete("gone")
    assert tenant.apps() == []
    with running(installed_plane):
        eventually(lambda: not tenant.claims(), timeout_s=90, what=tenant.claims)


def test_an_app_whose_id_went_to_another_stops_and_is_served_again_once_it_is_free(
    installed_plane: ControlPlane, tenant: Tenant
) -> None:
    """As after a restored backup. The stopped template must not keep the other's claim in use."""
    with pool(installed_plane, f"p-{secrets.token_hex(3)}", ids="7") as ids:
        with running(installed_plane):
            tenant.apply("first", part("a"), ros2={"pool": ids})
            tenant.wait_ready("first")
        (claim,) = tenant.claims()
        second = tenant.apply("second", part("a"), ros2={"pool": ids})
        hand_over(installed_plane, claim, to=second)
        with running(installed_plane):
            tenant.wait_ready("second")
            eventually(lambda: stopped(tenant, "first"), what=tenant.deployments)
            tenant.delete("second")
            tenant.wait_ready("first")


def hand_over(cp: ControlPlane, claim: dict[str, Any], *, to: dict[str, Any]) -> None:
    """The claim as another app's, made anew: claims cannot be changed."""
    meta, holder = claim["metadata"], claim["spec"]["holder"]
    holder |= {"name": to["metadata"]["name"], "uid": to["metadata"]["uid"]}
    body = {
        "apiVersion": claim["apiVersion"],
        "kind": claim["kind"],
        "metadata": {
            "name": meta["name"],
            "labels": meta["labels"] | {Label.HOLDER_UID: holder["uid"]},
            "annotations": meta["annotations"],
        },
        "spec": claim["spec"],
    }
    cp.kubectl("delete", "robotclaim", meta["name"])
    cp.kubectl("create", "-f", "-", stdin=body)


def stopped(tenant: Tenant, app: str) -> bool:
    return [d["spec"]["replicas"] for d in tenant.deployments() if d["metadata"]["labels"][Label.APP] == app] == [0]


def test_two_operators_at_work_agree_then_rest_and_their_successor_finds_everything_in_place(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    """One alone at rest is in journeys/test_many_apps.py: a rest takes more than a minute."""
    with running(installed_plane), running(installed_plane):
        for number in range(8):
            tenant.apply(f"app-{number}", part("a"), part("b"), ros2={"pool": ids})
        eventually(all_ready(tenant, 8), timeout_s=120, what=lambda: domains(tenant))
        assert len(set(domains(tenant))) == len(tenant.claims()) == 8
        assert len(tenant.deployments()) == 16
        rests(tenant)
        assert written(tenant, seconds=5.0) == {}
    began = datetime.now(UTC)
    with running(installed_plane):
        time.sleep(3)  # what must not happen has no event to wait for
        found = quiet.writes_since(installed_plane, began, namespace=tenant.namespace)
    assert quiet.by_object(found) == {}


def test_an_operator_that_wakes_up_late_does_not_revive_a_dead_apps_children(
    installed_plane: ControlPlane, tenant: Tenant
) -> None:
    """Stopped between apply and write, its app is deleted and re-created: the late write must name the new app only."""
    with pool(installed_plane, f"p-{secrets.token_hex(3)}", ids="7") as ids, running(installed_plane) as late:
        late.pause()
        first = tenant.apply("twin", part("a"), ros2={"pool": ids})
        tenant.delete("twin")
        second = tenant.apply("twin", part("a"), ros2={"pool": ids})
        late.resume()
        tenant.wait_ready("twin")
        owners = {item["metadata"]["ownerReferences"][0]["uid"] for item in tenant.deployments()}
        assert owners == {second["metadata"]["uid"]}
        assert first["metadata"]["uid"] not in {claim["spec"]["holder"]["uid"] for claim in tenant.claims()}


def test_an_app_created_again_under_its_name_gets_running_again(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    with running(installed_plane):
        old = tenant.apply("phoenix", part("a"), ros2={"pool": ids})
        tenant.wait_ready("phoenix")
        tenant.delete("phoenix")
        new = tenant.apply("phoenix", part("a"), ros2={"pool": ids})
        tenant.wait_ready("phoenix", timeout_s=90)
        assert new["metadata"]["uid"] != old["metadata"]["uid"]
        eventually(lambda: [c["spec"]["holder"]["uid"] for c in tenant.claims()] == [new["metadata"]["uid"]])


def test_the_lease_lets_one_work_and_the_other_take_over(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    space = {"no_leader_election": False, "lease_namespace": "robotapp-system"}
    with running(installed_plane, **space) as first, running(installed_plane, **space) as second:
        tenant.apply("one", part("a"), ros2={"pool": ids})
        tenant.wait_ready("one")
        leaders = ["starts to work" in process.log_text() for process in (first, second)]
        assert sum(leaders) == 1
        leader, other = (first, second) if leaders[0] else (second, first)
        assert leader.stop() == 0
        eventually(lambda: "starts to work" in other.log_text(), what=other.log_text)
        tenant.apply("two", part("a"), ros2={"pool": ids})
        tenant.wait_ready("two")


def rests(tenant: Tenant) -> None:
    """Wait until nothing was written to the namespace for longer than an operator puts off any write."""
    came = quiet.until_quiet(tenant.cp, quiet_s=quiet.REST_S, within_s=120, namespace=tenant.namespace)
    assert came, written(tenant, seconds=3.0)


def written(tenant: Tenant, *, seconds: float) -> Counter[str]:
    """How often operators wrote each object of the namespace meanwhile."""
    return quiet.by_object(quiet.writes_during(tenant.cp, seconds, namespace=tenant.namespace))
