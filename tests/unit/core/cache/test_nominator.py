"""Nominated pods: who keeps a place, who respects it, and what the watch may and may not undo."""

from tests.support.scheduling import make_core, make_info, make_node, make_pod

from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.pods.pod_info import PodInfo


def waiting_for(node: str, name: str = "w", *, priority: int = 5, cpu: str = "1") -> PodInfo:
    pod = make_pod(name, priority=priority, cpu=cpu)
    pod.status.nominated_node_name = node
    return PodInfo(pod)


def core_with(*nominated: PodInfo, nodes: int = 1) -> SchedulerCore:
    core = make_core(*(make_node(f"n{i}", cpu="1") for i in range(nodes)))
    for info in nominated:
        core.cluster.nominations.see(info)
    return core


def test_a_pod_of_lower_or_equal_priority_leaves_the_promised_place_alone() -> None:
    core = core_with(waiting_for("n0"))
    refused = core.schedule_one(make_info("same", priority=5, cpu="500m"))
    assert refused.message.startswith("0/1 nodes are available: 1 Insufficient cpu.")
    assert core.schedule_one(make_info("higher", priority=6, cpu="500m")).node == "n0"


def test_a_pod_takes_its_own_promised_place_though_others_score_better() -> None:
    core = core_with(nodes=3)
    core.cluster.apply_pod(make_pod("other", node="n1", cpu="100m"))
    info = waiting_for("n1", cpu="500m")
    core.cluster.nominations.see(info)
    assert core.schedule_one(info).node == "n1"
    assert core.cluster.nominations.node_of(info.uid) == ""


def test_a_pod_goes_elsewhere_when_its_promised_place_is_taken() -> None:
    info = waiting_for("n1")
    core = core_with(info, nodes=2)
    core.cluster.apply_pod(make_pod("other", node="n1", cpu="1", priority=9))
    assert core.schedule_one(info).node == "n0"


def test_the_pass_without_nominated_pods_counts_as_well() -> None:
    core = make_core(make_node("n0", pods="1"))
    core.cluster.nominations.see(waiting_for("n0", cpu="0"))
    core.cluster.apply_pod(make_pod("full", node="n0", priority=9))
    assert core.schedule_one(make_info("p", priority=1)).message.startswith("0/1 nodes are available: 1 Too many pods.")


def test_news_without_a_node_leave_a_promise_in_memory_alone_and_news_that_clear_it_count() -> None:
    core = core_with()
    found = core.cluster.nominations
    info = make_info("w", priority=5)
    found.nominate(info, "n0")
    assert not found.see(make_info("w", priority=5, labels={"our": "own patch is on its way"}))
    assert found.node_of("uid-w") == "n0"
    assert not found.see(waiting_for("n0"))
    assert found.see(make_info("w", priority=5))
    assert found.node_of("uid-w") == ""


def test_a_promise_moves_with_the_status() -> None:
    core = core_with(waiting_for("n0"), nodes=2)
    assert core.cluster.nominations.see(waiting_for("n1"))
    assert [pod.name for pod in core.cluster.nominations.below(6, "n1")] == ["w"]
    assert core.cluster.nominations.below(6, "n0") == []
    assert core.cluster.nominations.discard("uid-w")
    assert not core.cluster.nominations.discard("uid-w")


def test_many_promises_are_counted_together() -> None:
    core = core_with(*(waiting_for(f"n{i}", f"w{i}") for i in range(9)), nodes=10)
    assert core.schedule_one(make_info("p", cpu="1")).node == "n9"
    assert not core.schedule_one(make_info("q", cpu="1")).placed
