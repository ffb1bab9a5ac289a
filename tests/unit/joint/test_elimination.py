from itertools import product
from random import Random

import numpy as np

from robotapp_scheduler.joint.elimination import Factor, minimum, pruned

INF = float("inf")


def tables(random: Random, sizes: list[int], scopes: list[tuple[int, ...]]) -> list[Factor]:
    return [
        Factor(scope, np.array([random.uniform(0, 9) for _ in range(int(np.prod([sizes[v] for v in scope])))]).reshape(
            [sizes[v] for v in scope]
        ))
        for scope in scopes
    ]  # fmt: skip


def brute(sizes: list[int], factors: list[Factor]) -> float:
    return min(
        sum(float(factor.table[tuple(values[v] for v in factor.scope)]) for factor in factors)
        for values in product(*map(range, sizes))
    )


def test_a_chain_a_ring_and_a_clique_give_the_true_minimum_and_values_that_attain_it() -> None:
    random = Random(1)
    sizes = [3, 4, 2, 3]
    for scopes in (
        [(0, 1), (1, 2), (2, 3)],
        [(0, 1), (1, 2), (2, 3), (0, 3)],
        [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3), (1,)],
    ):
        factors = tables(random, sizes, scopes)  # type: ignore[arg-type]  # scopes of several lengths
        found = minimum(sizes, factors)
        assert found.exact
        assert abs(found.bound - brute(sizes, factors)) < 1e-9
        attained = sum(float(f.table[tuple(found.values[v] for v in f.scope)]) for f in factors)
        assert abs(attained - found.bound) < 1e-9


def test_a_scope_in_any_order_means_its_own_axes() -> None:
    table = np.arange(6.0).reshape(3, 2)
    other = np.array([[9.0, 0.0, 9.0], [9.0, 9.0, 9.0]])
    found = minimum([2, 3], [Factor((1, 0), table), Factor((0, 1), other)])
    assert (found.bound, found.values) == (2.0, [0, 1])


def test_tables_that_would_grow_too_large_are_split_and_bound_from_below() -> None:
    random = Random(2)
    sizes = [4] * 5
    scopes = [(a, b) for a in range(5) for b in range(a + 1, 5)]
    factors = tables(random, sizes, scopes)  # type: ignore[arg-type]  # pairs
    found = minimum(sizes, factors, most_cells=20)
    assert not found.exact
    assert found.bound <= brute(sizes, factors) + 1e-9


def test_a_variable_nobody_mentions_and_no_variables_at_all() -> None:
    assert minimum([2], []) == (0.0, [0], True)
    assert minimum([], []) == (0.0, [], True)


def test_pruning_keeps_every_assignment_that_costs_no_more_than_allowed() -> None:
    alone = [np.array([0.0, 5.0, INF]), np.array([1.0, 2.0])]
    pair = Factor((0, 1), np.array([[0.0, 9.0], [0.0, 0.0], [0.0, 0.0]]))
    kept, left = pruned(alone, [pair], most=4.0)
    assert [list(values) for values in kept] == [[0], [0, 1]]
    assert minimum([len(values) for values in kept], left).bound == 1.0
    assert [list(values) for values in pruned(alone, [pair], INF)[0]] == [[0, 1], [0, 1]]


def test_pruning_says_when_nothing_can_be() -> None:
    kept, _ = pruned([np.array([INF]), np.array([1.0])], [], INF)
    assert [len(values) for values in kept] == [0, 1]
    never = Factor((0, 1), np.full((1, 1), INF))
    kept, _ = pruned([np.array([1.0]), np.array([1.0])], [never], INF)
    assert [len(values) for values in kept] == [0, 0]
