"""Preemption in upstream's words: who is eligible, what is said, who is spared. The choice itself has a property test."""

import msgspec
import pytest
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import app_object, chain, make_core, make_info, make_node, make_pod, member_pod, pod_json

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.disruption_budgets import DisruptionBudget
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.profiles import ProfileError
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.queue.queued_pod_info import Rejection

FULL = "0/1 nodes are available: 1 Insufficient cpu. preemption: "


def full_core(*, nodes: int = 1, priority: int = 0) -> SchedulerCore:
    core = make_core(*(make_node(f"n{i}", cpu="1") for i in range(nodes)))
    for i in range(nodes):
        core.cluster.apply_pod(make_pod(f"old{i}", node=f"n{i}", cpu="1", priority=priority))
    return core


def disrupted(name: str, node: str) -> Pod:
    raw = pod_json(name, node=node, cpu="1")
    raw["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    raw["status"]["conditions"] = [{"type": "DisruptionTarget", "status": "True", "reason": "PreemptionByScheduler"}]
    return msgspec.convert(raw, Pod)


def budget(
    selector: dict[str, object] | None, *, allowed: int = 0, disrupted_pods: tuple[str, ...] = ()
) -> DisruptionBudget:
    status = {"disruptionsAllowed": allowed, "disruptedPods": dict.fromkeys(disrupted_pods, "2026-01-01T00:00:00Z")}
    raw = {"metadata": {"name": "b", "namespace": "default"}, "spec": {"selector": selector}, "status": status}
    return msgspec.convert(raw, DisruptionBudget)


def test_a_place_is_found_and_the_message_says_where_and_how_many_go() -> None:
    decision = full_core().schedule_one(make_info("vip", cpu="1", priority=10))
    assert decision.message == FULL + "found a potential placement for pod on node n0, preempting 1 victims"
    assert decision.nominate == "n0"
    assert decision.plan is not None
    assert [victim.name for victim in decision.plan.victims] == ["old0"]


def test_a_pod_never_drives_out_the_one_it_must_share_its_node_with_whichever_declares_it() -> None:
    """The partner would have no place beside it afterwards, and the pair would stay broken."""
    core = make_core(make_node("n0", cpu="2"), make_node("n1", cpu="8"))
    core.cluster.apply_app(app_object({"name": "camera", "colocateWith": ["driver"]}, {"name": "driver"}))
    for owned in (*chain("camera"), *chain("driver")):
        core.cluster.apply_owner(owned)
    core.cluster.apply_pod(member_pod("camera", node="n0", cpu="1"))
    core.cluster.apply_pod(make_pod("old", node="n0", cpu="1", priority=5))
    driver = member_pod("driver", cpu="1", priority=10)
    core.cluster.apply_pod(driver)
    decision = core.schedule_one(PodInfo(driver))
    assert decision.plan is not None
    assert [victim.name for victim in decision.plan.victims] == ["old"]
    assert decision.nominate == "n0", "there is room on n1, but the camera is not there"


def test_a_polite_pod_preempts_nobody_and_keeps_its_nomination() -> None:
    decision = full_core().schedule_one(make_info("vip", cpu="1", priority=10, preemptionPolicy="Never"))
    assert decision.message == FULL + "not eligible due to preemptionPolicy=Never."
    assert (decision.nominate, decision.plan) == (None, None)


def test_while_victims_end_on_the_promised_node_nobody_else_has_to_go() -> None:
    core = full_core(nodes=2)
    core.cluster.apply_pod(disrupted("old0", "n0"))
    vip = make_info("vip", cpu="1", priority=10)
    core.cluster.nominations.nominate(vip, "n0")
    decision = core.schedule_one(vip)
    assert decision.message.endswith("preemption: not eligible due to a terminating pod on the nominated node.")
    assert (decision.nominate, decision.plan) == (None, None)


def test_a_promised_node_that_can_no_longer_help_does_not_hold_the_pod() -> None:
    core = full_core(nodes=2)
    core.cluster.apply_pod(disrupted("old0", "n0"))
    core.cluster.apply_node(make_node("n0", cpu="500m"))
    vip = make_info("vip", cpu="1", priority=10)
    core.cluster.nominations.nominate(vip, "n0")
    assert core.schedule_one(vip).nominate == "n1"


def test_a_pod_that_cannot_be_helped_loses_its_nomination() -> None:
    core = full_core(priority=20)
    decision = core.schedule_one(make_info("vip", cpu="1", priority=10))
    assert decision.message == FULL + "0/1 nodes are available: 1 No preemption victims found for incoming pod."
    assert decision.nominate == ""


def test_what_stays_too_little_with_all_lesser_pods_gone_is_named() -> None:
    core = make_core(make_node("n0", cpu="1"))
    core.cluster.apply_pod(make_pod("big", node="n0", cpu="900m", priority=20))
    core.cluster.apply_pod(make_pod("small", node="n0", cpu="100m"))
    decision = core.schedule_one(make_info("vip", cpu="500m", priority=10))
    assert decision.message == FULL + "0/1 nodes are available: 1 Insufficient cpu."


@pytest.mark.parametrize(
    ("spec", "violations"),
    [
        (budget({"matchLabels": {"app": "a"}}), 1),
        (budget({"matchLabels": {"app": "a"}}, allowed=1), 0),
        (budget({"matchLabels": {"app": "b"}}), 0),
        (budget({"matchLabels": {"app": "a"}}, disrupted_pods=("old",)), 0),
        (budget({}), 1),
        (budget(None), 0),
    ],
)
def test_disruption_budgets_are_counted(spec: DisruptionBudget, violations: int) -> None:
    core = make_core(make_node("n0", cpu="1"))
    core.cluster.apply_pod(make_pod("old", node="n0", cpu="1", labels={"app": "a"}))
    core.cluster.budgets.apply(spec)
    decision = core.schedule_one(make_info("vip", cpu="1", priority=10))
    assert decision.plan is not None
    assert decision.plan.violations == violations
    core.cluster.budgets.remove(spec)
    again = core.schedule_one(make_info("vip2", cpu="1", priority=10))
    assert again.plan is not None
    assert again.plan.violations == 0


def test_the_pod_is_held_while_its_victims_are_evicted_and_goes_on_afterwards() -> None:
    core = full_core()
    core.queue.add(make_info("vip", cpu="1", priority=10))
    (queued,) = core.queue.pop()
    (decision,) = core.schedule([queued])
    core.preempts("uid-vip")
    core.queue.requeue(queued, Rejection(decision.rejected_by))
    core.queue.move(core.cluster.remove_pod(make_pod("old0", node="n0", cpu="1")))
    assert core.queue.pop() == []
    assert core.queue.pending()["gated"] == 1
    core.preempted("uid-vip", failed=False)
    (queued,) = core.queue.pop()
    assert core.schedule([queued])[0].node == "n0"
    check_queue(core.queue)


def test_after_failed_evictions_the_pod_is_tried_at_once() -> None:
    core = full_core()
    core.queue.add(make_info("vip", cpu="1", priority=10))
    (queued,) = core.queue.pop()
    core.preempts("uid-vip")
    core.queue.requeue(queued, Rejection(frozenset({"NodeResourcesFit"})))
    core.preempted("uid-vip", failed=True)
    assert core.queue.pending()["active"] == 1


def test_without_the_plugin_nothing_is_preempted_and_nothing_is_said_of_it() -> None:
    core = full_core()
    profile = core.runner("ros-aware-scheduler").profile
    profile.post_filters = ()
    assert core.schedule_one(make_info("vip", cpu="1", priority=10)).message == FULL.removesuffix(" preemption: ")


@pytest.mark.parametrize(
    ("args", "text"),
    [
        ({"minCandidateNodesPercentage": 101}, "not in valid range [0, 100]"),
        ({"minCandidateNodesAbsolute": -1}, "not in valid range [0, inf)"),
        ({"minCandidateNodesPercentage": 0, "minCandidateNodesAbsolute": 0}, "cannot be zero at the same time"),
    ],
)
def test_arguments_upstream_refuses_are_refused_in_its_words(args: dict[str, int], text: str) -> None:
    with pytest.raises(ProfileError) as caught:
        make_core(args={"DefaultPreemption": args})
    assert text in str(caught.value)


def test_a_search_stops_at_the_wanted_number_of_candidates() -> None:
    core = make_core(*(make_node(f"n{i}", cpu="1") for i in range(20)), args={
        "DefaultPreemption": {"minCandidateNodesPercentage": 0, "minCandidateNodesAbsolute": 1}
    })  # fmt: skip
    for i in range(20):
        core.cluster.apply_pod(make_pod(f"old{i}", node=f"n{i}", cpu="1", priority=i % 3))
    nodes = {core.schedule_one(make_info(f"vip{i}", cpu="1", priority=10)).nominate for i in range(30)}
    assert len(nodes) > 5  # each pod begins its search elsewhere, and takes what it finds first


def test_pods_placed_together_do_not_make_room_at_each_others_cost() -> None:
    core = full_core()
    core._together = frozenset({"uid-old0"})
    assert core.schedule_one(make_info("vip", cpu="1", priority=10)).plan is None


def test_a_pod_that_terminates_can_still_be_a_victim() -> None:
    core = make_core(make_node("n0", cpu="1"))
    core.cluster.apply_pod(disrupted("old", "n0"))
    decision = core.schedule_one(PodInfo(make_pod("vip", cpu="1", priority=10)))
    assert decision.plan is not None
