"""However much one namespace has in a queue, another waits for one turn per namespace at most."""

from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.core.queue.namespace_turns import NamespaceTurns, TurnQueue

NAMESPACES = st.sampled_from(["a", "b", "c", "d"])


@given(st.lists(st.tuples(NAMESPACES, st.integers(0, 30)), max_size=60), NAMESPACES, st.integers(1, 7))
def test_who_has_one_item_waits_for_one_item_of_each_other_namespace(
    waiting: list[tuple[str, int]], newcomer: str, limit: int
) -> None:
    queue: TurnQueue[tuple[str, int]] = TurnQueue()
    for namespace, number in waiting:
        if namespace != newcomer:
            queue.add(namespace, (namespace, number))
    queue.pop(limit)
    queue.add(newcomer, (newcomer, 99))
    order = queue.pop(1000)
    before = [namespace for namespace, _ in order[: order.index((newcomer, 99))]]
    assert len(before) == len(set(before))


@given(st.lists(st.tuples(NAMESPACES, st.integers(0, 9)), max_size=60), st.integers(1, 5))
def test_everything_comes_out_once_and_in_order_within_its_namespace(
    waiting: list[tuple[str, int]], limit: int
) -> None:
    queue: TurnQueue[tuple[str, int]] = TurnQueue()
    for namespace, number in waiting:
        queue.add(namespace, (namespace, number))
    assert len(queue) == len(set(waiting))
    order: list[tuple[str, int]] = []
    while chosen := queue.pop(limit):
        assert len(chosen) <= limit
        order += chosen
    for name in {namespace for namespace, _ in waiting}:
        assert [item for item in order if item[0] == name] == list(
            dict.fromkeys(item for item in waiting if item[0] == name)
        )


@given(st.lists(st.sets(NAMESPACES, min_size=1), min_size=8, max_size=30))
def test_a_namespace_that_always_waits_is_chosen_at_least_every_fourth_time(rounds: list[set[str]]) -> None:
    turns = NamespaceTurns()
    chosen = [turns.choose((name, name) for name in sorted(names | {"a"})) for names in rounds]
    longest = max(map(len, "".join("1" if name == "a" else "0" for name in chosen).split("1")))
    assert longest <= 6  # each of the three others may be new once


def test_without_candidates_nobody_is_chosen() -> None:
    assert NamespaceTurns().choose(()) is None
