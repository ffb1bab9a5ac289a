"""Victims that free a volume: other rules than amounts decide who has to go, and on which node."""

from typing import Any

import pytest
from tests.support.scheduler.volumes import make_claim, make_csi_node, make_volume
from tests.support.scheduling import make_core, make_info, make_node, make_pod

from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore

Json = dict[str, Any]
IN_USE = (
    "node(s) unavailable due to PersistentVolumeClaim with ReadWriteOncePod access mode already in-use by another pod"
)
DISK = {"name": "disk", "rbd": {"monitors": ["m"], "pool": "p", "image": "i"}}


def claimed(name: str) -> Json:
    return {"name": name, "persistentVolumeClaim": {"claimName": name}}


def core_with_claims(*names: str) -> SchedulerCore:
    """Two nodes with room to spare that attach one volume each; each claim is bound to a volume of its own."""
    core = make_core(make_node("n0", cpu="4"), make_node("n1", cpu="4"))
    store = core.cluster.volumes
    for name in names:
        owner = {"namespace": "default", "name": name}
        store.apply_volume(make_volume(f"of-{name}", claim=owner, phase="Bound", csi=("d", name)))
        mode = "ReadWriteOncePod" if name == "once" else "ReadWriteMany"
        store.apply_claim(make_claim(name, volume=f"of-{name}", modes=(mode,)))
    for node in ("n0", "n1"):
        store.apply_csi_node(make_csi_node(node, {"d": 1}))
    return core


@pytest.mark.parametrize("held", [claimed("once"), claimed("mine"), DISK])
@pytest.mark.parametrize("cpu", ["1", "3"])
def test_only_the_pod_that_holds_the_volume_has_to_go_when_there_is_room(held: Json, cpu: str) -> None:
    core = core_with_claims("once", "mine", "other")
    wanted = claimed("other") if held == claimed("mine") else held
    core.cluster.apply_pod(make_pod("holder", node="n1", cpu="1", volumes=[held]))
    core.cluster.apply_pod(make_pod("bystander", node="n1", cpu="0"))
    core.cluster.apply_pod(make_pod("full", node="n0", cpu="4", priority=50))
    decision = core.schedule_one(make_info("vip", cpu=cpu, priority=10, volumes=[wanted]))
    assert decision.plan is not None
    assert (decision.plan.node, [victim.name for victim in decision.plan.victims]) == ("n1", ["holder"])


def test_a_claim_in_use_on_another_node_is_what_is_left_without_the_lesser_pods() -> None:
    core = core_with_claims("once")
    core.cluster.apply_pod(make_pod("holder", node="n1", cpu="1", priority=50, volumes=[claimed("once")]))
    core.cluster.apply_pod(make_pod("lesser", node="n0", cpu="1"))
    decision = core.schedule_one(make_info("vip", cpu="1", priority=10, volumes=[claimed("once")]))
    wanted = f"preemption: 0/2 nodes are available: 1 No preemption victims found for incoming pod, 1 {IN_USE}."
    assert decision.message.endswith(wanted)


def test_who_has_to_go_is_found_anew_when_the_claim_is_free_for_others() -> None:
    core = core_with_claims("once")
    holder = make_pod("holder", node="n1", cpu="1", priority=50, volumes=[claimed("once")])
    core.cluster.apply_pod(holder)
    for node in ("n0", "n1"):
        core.cluster.apply_pod(make_pod(f"lesser-{node}", node=node, cpu="3", priority=0))
    vip = make_info("vip", cpu="2", priority=10, volumes=[claimed("once")])
    assert core.schedule_one(vip, assume=False).plan is None
    core.cluster.remove_pod(holder)
    plan = core.schedule_one(vip, assume=False).plan
    assert plan is not None
    assert [victim.name for victim in plan.victims] == [f"lesser-{plan.node}"]


def test_a_claim_promised_on_one_node_is_free_until_its_pod_comes() -> None:
    core = core_with_claims("once")
    for node, volumes in (("n0", [claimed("once")]), ("n1", [])):
        guest = make_info(f"guest-{node}", cpu="1", priority=20, volumes=volumes)
        core.cluster.nominations.nominate(guest, node)
    decision = core.schedule_one(make_info("vip", cpu="1", priority=10, volumes=[claimed("once")]))
    assert decision.feasible == 2


def test_a_claim_promised_on_one_node_counts_there_for_a_pod_with_an_inline_disk_as_well() -> None:
    core = core_with_claims("once")
    for node, volumes in (("n0", [claimed("once")]), ("n1", [])):
        guest = make_info(f"guest-{node}", cpu="1", priority=20, volumes=volumes)
        core.cluster.nominations.nominate(guest, node)
    decision = core.schedule_one(make_info("vip", cpu="1", priority=10, volumes=[claimed("once"), DISK]))
    assert decision.node == "n1"


def victims_of_shared_claim(*holders: str) -> list[tuple[str, str]]:
    """Who goes where when these nodes have a pod each with the claim, one after the other until the pod has its node."""
    core = core_with_claims("once")
    for at, node in enumerate(holders):
        core.cluster.apply_pod(make_pod(f"holder-{at}", node=node, priority=-at, volumes=[claimed("once")]))
    vip = make_info("vip", cpu="1", priority=10, volumes=[claimed("once")])
    gone = []
    while (plan := core.schedule_one(vip, assume=False).plan) is not None:
        for victim in plan.victims:
            gone.append((plan.node, victim.name))
            core.cluster.remove_pod(victim.pod)
    assert core.schedule_one(vip, assume=False).placed
    return gone


def test_of_two_pods_that_share_a_claim_the_lesser_goes_first_and_then_the_other() -> None:
    assert victims_of_shared_claim("n1", "n1") == [("n1", "holder-1"), ("n1", "holder-0")]


def test_pods_that_share_a_claim_across_nodes_go_one_after_the_other() -> None:
    assert victims_of_shared_claim("n0", "n1") == [("n1", "holder-1"), ("n0", "holder-0")]
