"""Access links: where a pod fits beside its peers, and that the planner's rule and the filter's are one."""

from random import Random

import numpy as np
from tests.support.scheduler.joint_problems import small_problem

from robotapp_scheduler.joint.link_limits import LinkLimits, overloading
from robotapp_scheduler.joint.problem import INF, UNPLACED


def free(*left: float) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    return np.array(left, dtype=np.float64)


def test_a_pod_fits_where_its_flows_fit_the_link_and_beside_a_peer_they_take_nothing() -> None:
    assert list(overloading(free(5, 4, INF), {2: 5})) == [False, True, False]
    assert list(overloading(free(0, INF, 7), {0: 9})) == [False, True, True], "the peer's link is full: only beside it"
    assert list(overloading(free(0, 0, INF), {0: 9, 1: 9})) == [True, True, True], "two such peers: nowhere"
    assert list(overloading(free(3, INF), {0: 9, 1: 4})) == [True, True], "beside one it still talks to the other"
    assert list(overloading(free(4, INF), {0: 9, 1: 4})) == [False, True]


def test_a_link_that_carries_too_much_already_keeps_nobody_away_who_adds_nothing() -> None:
    assert list(overloading(free(-3, INF), {})) == [False, False]
    assert list(overloading(free(-3, INF), {0: 2})) == [False, True], "beside its only peer it adds nothing"


def test_both_ends_pay_and_flows_inside_a_row_are_free() -> None:
    links = LinkLimits(free(10, 10, INF), ((0, 1, 6), (0, 2, 6)), ((1, 0, 5),))
    assert links.over([0, 0, 0]) == []
    assert links.over([0, 1, 0]) == [0, 1], "6 to the pod and 5 to the placed end"
    assert links.over([0, UNPLACED, 1]) == []
    assert links.over([0, 2, 1]) == [0]
    assert links.near(0, [0, 1, 2]) == [1, 2]


def test_a_row_is_blocked_exactly_when_the_plan_with_the_pod_there_overloads_a_link() -> None:
    seen = set[bool]()
    for seed in range(300):
        random = Random(seed)
        problem = small_problem(random)
        links = problem.links
        if links is None:
            continue
        plan = [random.choice((UNPLACED, *range(problem.rows))) for _ in range(problem.pods)]
        pod = random.randrange(problem.pods)
        plan[pod] = UNPLACED
        if links.over(plan):
            continue
        blocked = links.blocked(plan, pod)
        for row in range(problem.rows):
            assert bool(blocked[row]) == bool(links.over([*plan[:pod], row, *plan[pod + 1 :]])), (seed, row)
            seen.add(bool(blocked[row]))
    assert seen == {True, False}
