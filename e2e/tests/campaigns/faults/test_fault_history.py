"""The judge of the fault campaign sees each broken rule, and none where there is none."""

from campaigns.faults.history import History, Known, Room


def history(*, pods: int = 2, cpu_milli: int = 300) -> History:
    return History({"n0": Room(pods, cpu_milli), "n1": Room(pods, cpu_milli)})


def known(name: str, node: str = "", *, cpu_milli: int = 100, reported: str = "") -> Known:
    return Known(name, cpu_milli, node, reported)


def test_a_pod_bound_once_is_no_problem_and_one_that_moves_is() -> None:
    seen = history()
    seen.seen("u", known("p"))
    seen.seen("u", known("p", "n0"))
    seen.seen("u", known("p", "n0"))
    assert (seen.binds, seen.problems) == (1, [])
    seen.seen("u", known("p", "n1"))
    assert seen.problems == ["p moved from n0 to n1"]


def test_a_node_is_overfull_by_pods_or_by_cpu_and_is_named_once() -> None:
    seen = history()
    for number in range(4):
        seen.seen(f"u{number}", known(f"p{number}", "n0"))
    seen.seen("big", known("big", "n1", cpu_milli=301))
    assert seen.problems == [
        "n0 holds 3 pods of 2 and 300m of 300m CPU",
        "n1 holds 1 pods of 2 and 301m of 300m CPU",
    ]


def test_a_place_that_became_free_may_be_taken_again() -> None:
    seen = history(pods=1)
    seen.seen("a", known("a", "n0"))
    seen.gone("a")
    seen.seen("b", known("b", "n0"))
    assert seen.problems == []
    assert seen.bound_uids() == ["b"]


def test_after_a_list_whose_changes_have_no_order_the_node_is_judged_once_all_are_known() -> None:
    seen = history(pods=1)
    seen.seen("a", known("a", "n0"))
    seen.seen("b", known("b", "n0"), ordered=False)
    seen.gone("a")
    seen.settle()
    assert seen.problems == []
    seen.seen("c", known("c", "n0"), ordered=False)
    seen.settle()
    assert seen.problems == ["n0 holds 2 pods of 1 and 200m of 300m CPU"]


def test_at_rest_every_pod_is_bound_or_told_that_nothing_fits() -> None:
    seen = history()
    seen.seen("a", known("a", cpu_milli=100, reported="Unschedulable"))
    assert seen.unsettled() == ["a would fit and is not bound (Unschedulable)"]
    seen.seen("a", known("a", cpu_milli=400))
    assert seen.unsettled() == ["a is neither bound nor reported (nothing)"]
    seen.seen("a", known("a", cpu_milli=400, reported="SchedulerError"))
    assert seen.unsettled() == ["a is neither bound nor reported (SchedulerError)"]
    seen.seen("a", known("a", cpu_milli=400, reported="Unschedulable"))
    assert seen.unsettled() == []
    seen.seen("a", known("a", "n0"))
    assert (seen.unsettled(), seen.unbound, seen.bound) == ([], [], 1)
