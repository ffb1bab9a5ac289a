"""A robot out of sight keeps its domain: its claim is parked until somebody has seen its pods end."""

import pytest
from msgspec import convert
from tests.support.claims.objects import app_holder, deployment_json, node_json, pod_holder, pod_json
from tests.unit.claims.protocol.sweep_rig import SweepRig, number

from robotapp_api.model.names import Annotation, Reason
from robotapp_claims.protocol.bind_check import check_bind_all
from robotapp_claims.protocol.claim_nodes import IDLE_S
from robotapp_claims.protocol.domains import ensure_domain, ensure_pod_domain
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.objects import Claim, Pod
from robotapp_client.api.resources import DEPLOYMENTS, NODES, PODS, ROBOTAPPS, ROBOTCLAIMS


class Robot(SweepRig):
    """An app whose only pod our scheduler has bound to the node `amr-1`."""

    claim: str

    async def start(self) -> None:
        self.claim = await self.domain()
        self.node(ready=True)
        pod = self.pod("p")
        (verdict,) = await check_bind_all(self.store.client(), [pod], nodes=["amr-1"])
        assert verdict.allowed
        self.pod("p", node="amr-1")

    def node(self, *, ready: bool) -> None:
        self.store.put(NODES, node_json("amr-1", ready=ready))

    def pod(self, name: str, *, node: str = "") -> Pod:
        body = pod_json(
            number(self.claim), name=name, uid=self.app.uid, node=node, phase="Running" if node else "Pending"
        )
        return convert(self.store.put(PODS, body), Pod)

    def pod_is_removed_unseen(self) -> None:
        self.store.remove(PODS, "p", "team")

    def stored(self) -> Claim:
        return convert(self.store.find(ROBOTCLAIMS, self.claim), Claim)

    async def parked(self) -> None:
        """The node is out of contact, its pod's object and the app are deleted."""
        await self.start()
        self.node(ready=False)
        self.pod_is_removed_unseen()
        self.delete_app()
        await self.sweep()
        assert self.phase(self.claim) == "Parked"


@pytest.fixture
def rig() -> Robot:
    return Robot()


async def test_the_claim_names_the_node_before_the_pod_is_bound(rig: Robot) -> None:
    await rig.start()
    assert rig.stored().status.nodes == ("amr-1",)


async def test_a_bind_writes_the_claim_also_when_it_names_the_node_already(rig: Robot) -> None:
    """Whoever has read the claim before, to strike the node off or to release it, must be refused."""
    await rig.start()
    before = rig.stored().metadata.resource_version
    await check_bind_all(rig.store.client(), [rig.pod("second")], nodes=["amr-1"])
    assert rig.stored().metadata.resource_version != before


async def test_pods_of_one_decision_write_their_claim_once(rig: Robot) -> None:
    await rig.start()
    pods = [rig.pod("a"), rig.pod("b")]
    writes = rig.store.version
    assert all(verdict.allowed for verdict in await check_bind_all(rig.store.client(), pods, nodes=["amr-2", "edge-1"]))
    assert rig.store.version == writes + 1
    assert rig.stored().status.nodes == ("amr-1", "amr-2", "edge-1")


async def test_a_pod_whose_claim_is_released_while_its_node_is_written_waits(rig: Robot) -> None:
    await rig.start()
    pod = rig.pod("q")

    async def drained(what: str) -> None:
        if what.startswith("replace robotclaims"):
            claim = rig.store.find(ROBOTCLAIMS, rig.claim)
            assert claim is not None
            claim["status"]["phase"] = "Draining"
            rig.store.put(ROBOTCLAIMS, claim)

    (verdict,) = await check_bind_all(rig.store.client(before=drained), [pod], nodes=["amr-2"])
    assert not verdict.allowed
    assert rig.stored().status.nodes == ("amr-1",)


async def test_no_id_of_an_unreachable_robot_is_handed_out(rig: Robot) -> None:
    await rig.parked()
    for _ in range(3):
        await rig.sweep(after_s=100)
    assert rig.phase(rig.claim) == "Parked"
    other = rig.new_app("other")
    request = DomainRequest(other, requested_id=number(rig.claim))
    assert (await ensure_domain(rig.store.client(), request)).reason == Reason.DOMAIN_TAKEN


async def test_a_parked_claim_drains_when_its_node_is_back_and_runs_none_of_its_pods(rig: Robot) -> None:
    await rig.parked()
    rig.node(ready=True)
    await rig.sweep()
    assert rig.phase(rig.claim) == "Draining"
    await rig.sweep(after_s=61)
    assert rig.phase(rig.claim) == "gone"


async def test_a_node_that_is_gone_for_good_parks_until_an_admin_says_that_its_pods_are_gone(rig: Robot) -> None:
    await rig.parked()
    rig.store.remove(NODES, "amr-1")
    await rig.sweep(after_s=100)
    assert rig.phase(rig.claim) == "Parked"
    claim = rig.store.find(ROBOTCLAIMS, rig.claim)
    assert claim is not None
    claim["metadata"]["annotations"][str(Annotation.PODS_GONE)] = str(claim["status"]["attempt"])
    await rig.sweep()
    assert rig.phase(rig.claim) == "Draining"


async def test_a_draining_claim_parks_when_its_node_is_lost_during_the_quarantine(rig: Robot) -> None:
    await rig.start()
    rig.pod_is_removed_unseen()
    rig.delete_app()
    await rig.sweep()
    assert rig.phase(rig.claim) == "Draining"
    rig.node(ready=False)
    await rig.sweep(after_s=61)
    assert rig.phase(rig.claim) == "Parked"


async def test_pods_that_are_seen_again_take_a_parked_claim_back(rig: Robot) -> None:
    await rig.parked()
    rig.pod("p", node="amr-1")
    await rig.sweep()
    assert rig.phase(rig.claim) == "Reserved"
    assert rig.stored().status.nodes == ("amr-1",)


async def test_the_same_instance_adopts_its_own_parked_claim_and_no_pod_is_bound_before(rig: Robot) -> None:
    await rig.start()
    rig.node(ready=False)
    rig.pod_is_removed_unseen()
    app = rig.store.find(ROBOTAPPS, "teleop", "team")
    assert app is not None
    app["spec"]["ros"] = {"version": 1}
    await rig.sweep()
    assert rig.phase(rig.claim) == "Parked"
    (verdict,) = await check_bind_all(rig.store.client(), [rig.pod("q")], nodes=["amr-1"])
    assert not verdict.allowed
    assert "parked" in verdict.message
    del app["spec"]["ros"]
    assert await rig.domain() == rig.claim
    assert rig.phase(rig.claim) == "Reserved"


async def test_a_bare_pod_out_of_sight_keeps_its_domain_too(rig: Robot) -> None:
    rig.node(ready=False)
    holder = pod_holder(rig.store.put(PODS, pod_json(name="pod"))["metadata"]["uid"])
    writes = rig.store.version
    found = await ensure_pod_domain(rig.store.client(), DomainRequest(holder), node="amr-1")
    assert rig.store.version == writes + 1, "the claim names the node from the beginning"
    rig.store.remove(PODS, "pod", "team")
    await rig.sweep()
    assert rig.phase(found.claim) == "Parked"
    assert convert(rig.store.find(ROBOTCLAIMS, found.claim), Claim).status.nodes == ("amr-1",)


async def test_a_bare_pod_that_is_tried_again_elsewhere_is_out_of_sight_on_either_node(rig: Robot) -> None:
    """The binding to the first may have had no answer."""
    holder = pod_holder(rig.store.put(PODS, pod_json(name="pod"))["metadata"]["uid"])
    for node in ("amr-1", "amr-2"):
        found = await ensure_pod_domain(rig.store.client(), DomainRequest(holder), node=node)
    assert convert(rig.store.find(ROBOTCLAIMS, found.claim), Claim).nodes == ("amr-1", "amr-2")


async def test_the_sweep_names_nodes_of_pods_that_another_scheduler_has_bound(rig: Robot) -> None:
    rig.claim = await rig.domain()
    rig.node(ready=True)
    rig.pod("p", node="amr-1")
    await rig.sweep()
    assert rig.stored().status.nodes == ("amr-1",)


async def test_a_node_that_was_left_long_ago_is_struck_off_and_parks_nothing(rig: Robot) -> None:
    await rig.start()
    rig.store.put(DEPLOYMENTS, deployment_json(number(rig.claim), uid=rig.app.uid))
    rig.pod_is_removed_unseen()
    await rig.sweep()
    await rig.sweep(after_s=IDLE_S - 1)
    assert rig.stored().status.nodes == ("amr-1",)
    await rig.sweep(after_s=2)
    assert rig.stored().status.nodes == ()


@pytest.mark.parametrize("why", ["its node is not ready", "a pod is pending", "a pod was there meanwhile"])
async def test_a_node_is_not_struck_off_while(rig: Robot, why: str) -> None:
    await rig.start()
    rig.store.put(DEPLOYMENTS, deployment_json(number(rig.claim), uid=rig.app.uid))
    rig.pod_is_removed_unseen()
    await rig.sweep()
    if why == "its node is not ready":
        rig.node(ready=False)
    if why == "a pod is pending":
        rig.pod("q")
    if why == "a pod was there meanwhile":
        rig.pod("q", node="amr-1")
        await rig.sweep(after_s=IDLE_S / 2)
        rig.store.remove(PODS, "q", "team")
        await rig.sweep(after_s=1)
    await rig.sweep(after_s=IDLE_S - 2)
    await rig.sweep(after_s=1 if why == "a pod was there meanwhile" else 10)
    assert rig.stored().status.nodes == ("amr-1",)


async def test_a_pod_elsewhere_that_names_a_claim_adds_no_node_to_it(rig: Robot) -> None:
    await rig.start()
    notes = {str(Annotation.DOMAIN_CLAIM): rig.claim}
    body = pod_json(number(rig.claim), name="x", uid=app_holder().uid, node="evil", phase="Running", annotations=notes)
    body["metadata"]["namespace"] = "attacker"
    rig.store.put(PODS, body)
    await rig.sweep()
    assert rig.stored().status.nodes == ("amr-1",)
