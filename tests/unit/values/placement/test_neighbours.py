"""Who shares a node and who must not: symmetric, transitive, and the same whoever declares it."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.placement.neighbours import NO_NEIGHBOURS, NeighbourRules, Neighbours, neighbours

NAMES = "abcdef"
PAIRS = st.lists(st.tuples(st.sampled_from(NAMES), st.sampled_from(NAMES)), max_size=6)


def parts(together: list[tuple[str, str]], apart: list[tuple[str, str]]) -> list[NeighbourRules]:
    return [
        NeighbourRules(
            name,
            tuple(b for a, b in together if a == name and b != name),
            tuple(b for a, b in apart if a == name and b != name),
        )
        for name in NAMES
    ]


@pytest.mark.parametrize("declared", [[("a", "b")], [("b", "a")], [("a", "b"), ("b", "a")]])
def test_it_does_not_matter_who_declares_it(declared: list[tuple[str, str]]) -> None:
    assert neighbours(parts(declared, [])) == {"a": Neighbours(("b",)), "b": Neighbours(("a",))}
    assert neighbours(parts([], declared)) == {"a": Neighbours(apart=("b",)), "b": Neighbours(apart=("a",))}


def test_who_shares_a_node_shares_its_enemies() -> None:
    found = neighbours(parts([("a", "b"), ("c", "b")], [("c", "d"), ("e", "d")]))
    assert found["a"] == Neighbours(("b", "c"), ("d",))
    assert found["d"] == Neighbours((), ("a", "b", "c", "e"))
    assert found.get("f", NO_NEIGHBOURS) == NO_NEIGHBOURS


def test_names_of_no_component_are_ignored() -> None:
    assert neighbours([NeighbourRules("a", ("ghost",), ("ghost",))]) == {}


@given(PAIRS, PAIRS)
def test_equals_following_the_declarations_one_by_one(
    together: list[tuple[str, str]], apart: list[tuple[str, str]]
) -> None:
    found = neighbours(parts(together, apart))
    same = {(a, b) for a, b in together if a != b} | {(b, a) for a, b in together if a != b} | {(n, n) for n in NAMES}
    for middle, a, b in product(NAMES, repeat=3):
        if (a, middle) in same and (middle, b) in same:
            same.add((a, b))
    foes = {(a, b) for a, b in apart if a != b} | {(b, a) for a, b in apart if a != b}
    for one, other in product(NAMES, repeat=2):
        own = found.get(one, NO_NEIGHBOURS)
        assert (other in own.together) == (one != other and (one, other) in same)
        hostile = any((one, x) in same and (other, y) in same for x, y in foes)
        assert (other in own.apart) == (one != other and hostile)
