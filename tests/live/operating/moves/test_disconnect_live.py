"""What happens to a component whose node falls silent, as `onDisconnect` has it: never two pods of it at once, but by `Failover`."""

import secrets
import threading
from collections.abc import Iterator
from typing import Any, Self

import pytest

from campaigns.operating.out_of_sight import Fleet
from campaigns.rigs.live import Tenant, eventually, part
from robotapp_api.model.names import Label
from robotapp_operator.plan.render.node_affinity import DISCONNECTED
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines import topology

GRACE_S = 2


@pytest.fixture(scope="module")
def edges(installed_plane: ControlPlane) -> Iterator[topology.Topology]:
    """Two edge servers, an operator and a scheduler."""
    nodes = topology.fleet(0, 2, 0)
    topology.apply(installed_plane, nodes)
    scheduler = product.start_scheduler(installed_plane, sweep_seconds=1)
    operator = product.start_operator(
        installed_plane, name=f"operator-{secrets.token_hex(2)}", sweep_seconds=1, no_leader_election=True
    )
    yield nodes
    operator.stop()
    scheduler.stop()
    topology.remove(installed_plane, nodes)


@pytest.fixture
def fleet(installed_plane: ControlPlane, edges: topology.Topology, namespace: str) -> Fleet:
    return Fleet(installed_plane, edges, Tenant(installed_plane, namespace), seed=0)


class Publishers:
    """Counts, beside everything else, the most pods of the app that were on nodes at once."""

    def __init__(self, tenant: Tenant) -> None:
        self.most = 0
        self._tenant = tenant
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(0.05):
            self.most = max(self.most, len(bound(self._tenant)))


def drivers(tenant: Tenant) -> list[dict[str, Any]]:
    return [pod for pod in tenant.listed("pods") if pod["metadata"]["labels"].get(Label.COMPONENT.value) == "driver"]


def bound(tenant: Tenant) -> dict[str, str]:
    """Uids of the driver's pods on nodes, ending ones included."""
    found = {pod["metadata"]["uid"]: pod["spec"].get("nodeName", "") for pod in drivers(tenant)}
    return {uid: node for uid, node in found.items() if node}


def start(fleet: Fleet, on_disconnect: str) -> tuple[str, str]:
    """A driver on an edge server. Returns its pod's uid and its node."""
    driver = part("driver", runsOn=["Edge"], onDisconnect=on_disconnect)
    fleet.tenant.apply("cut", driver, connectivity={"grace": f"{GRACE_S}s"})
    fleet.tenant.wait_ready("cut")
    ((uid, node),) = bound(fleet.tenant).items()
    return uid, node


def message(tenant: Tenant) -> str:
    (instance,) = tenant.instances("cut")
    return " ".join(part.get("message", "") for part in instance["status"].get("components", ()))


def ending(tenant: Tenant) -> set[str]:
    return {pod["metadata"]["uid"] for pod in drivers(tenant) if "deletionTimestamp" in pod["metadata"]}


def test_stop_ends_the_pod_and_starts_the_next_one_when_the_node_is_back(fleet: Fleet) -> None:
    first, node = start(fleet, "Stop")
    tenant = fleet.tenant
    with Publishers(tenant) as publishers:
        fleet.ready(node, "Unknown")
        try:
            eventually(lambda: ending(tenant) == {first}, what=lambda: drivers(tenant))
            wanted = f"stopped, because node {node} is not Ready (onDisconnect: Stop)"
            eventually(lambda: wanted in message(tenant), what=lambda: message(tenant))
            assert set(bound(tenant)) == {first}
        finally:
            fleet.ready(node, "True")
        tenant.wait_ready("cut")
        eventually(lambda: first not in bound(tenant) and bound(tenant), what=lambda: drivers(tenant))
    assert publishers.most == 1


def test_failover_starts_the_next_pod_elsewhere_and_the_returning_node_ends_the_first(fleet: Fleet) -> None:
    first, node = start(fleet, "Failover")
    tenant = fleet.tenant
    fleet.ready(node, "Unknown")
    try:
        eventually(lambda: {*bound(tenant).values()} - {node}, what=lambda: drivers(tenant))
        assert first in ending(tenant)
    finally:
        fleet.ready(node, "True")
    eventually(lambda: first not in bound(tenant), what=lambda: drivers(tenant))
    tenant.wait_ready("cut")
    assert len(bound(tenant)) == 1


def test_keep_leaves_the_pod_alone_until_its_node_is_back(fleet: Fleet) -> None:
    first, node = start(fleet, "Keep")
    tenant = fleet.tenant
    with Publishers(tenant) as publishers:
        fleet.ready(node, "Unknown")
        try:
            eventually(lambda: f"node {node} is not Ready" in message(tenant), what=lambda: message(tenant))
            (pod,) = drivers(tenant)
            assert (pod["metadata"]["uid"], pod["metadata"].get("deletionTimestamp")) == (first, None)
            lost = [one for one in pod["spec"]["tolerations"] if one["key"] in DISCONNECTED]
            assert len(lost) == len(DISCONNECTED)
            assert not any("tolerationSeconds" in one for one in lost), "for ever, not for the grace alone"
        finally:
            fleet.ready(node, "True")
        runs = [{"type": kind, "status": "True"} for kind in ("Ready", "ContainersReady")]  # as its kubelet has it now
        path = f"/api/v1/namespaces/{tenant.namespace}/pods/{pod['metadata']['name']}/status"
        tenant.cp.api.patch(path, {"status": {"conditions": runs}})
        tenant.wait_ready("cut")
    assert (set(bound(tenant)), publishers.most) == ({first}, 1)
