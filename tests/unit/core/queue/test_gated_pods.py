"""Gated pods are found by the changes that may open their gates, and by no other."""

from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.queue.unschedulable_pods import GatedPods

CHANGES = st.sampled_from([Change.NONE, Change.POD_REMOVED, Change.NODE_ADDED, Change.POD_REMOVED | Change.LABELS])
STEPS = st.lists(st.tuples(st.sampled_from("abcd"), st.none() | CHANGES), max_size=30)


@given(STEPS, CHANGES)
def test_a_change_concerns_exactly_the_gates_that_wait_for_it(
    steps: list[tuple[str, Change | None]], change: Change
) -> None:
    gated, model = GatedPods(), dict[str, Change]()
    for uid, events in steps:
        model.pop(uid, None)
        if events is None:
            gated.discard(uid)
        else:
            gated.add(uid, events)
            model[uid] = events
    assert list(gated) == list(model)
    assert len(gated) == len(model)
    assert all(uid in gated for uid in model)
    assert sorted(gated.concerned(change)) == sorted(uid for uid, events in model.items() if events & change)


def test_a_gate_that_nothing_opens_is_never_tested() -> None:
    gated = GatedPods()
    gated.add("preemptor", Change.NONE)
    assert gated.concerned(Change.ALL) == []
