"""Gated pods are found by the changes that may open their gates, and by no other."""

from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.queue.unschedulable_pods import GatedPods

CHANGES = st.sampled_from([Change.NONE, Change.POD_REMOVED, Change.NODE_ADDED, Change.POD_REMOVED | Change.LABELS])
GROUPS = st.sampled_from(["", "app", "claim"])
STEPS = st.lists(st.tuples(st.sampled_from("abcd"), st.none() | CHANGES, GROUPS), max_size=30)


@given(STEPS, CHANGES, st.sets(GROUPS.filter(bool)))
def test_a_change_concerns_exactly_the_gates_that_wait_for_it(
    steps: list[tuple[str, Change | None, str]], change: Change, groups: set[str]
) -> None:
    gated, model = GatedPods(), dict[str, tuple[Change, str]]()
    for uid, events, group in steps:
        model.pop(uid, None)
        if events is None:
            gated.discard(uid)
        else:
            gated.add(uid, events, group)
            model[uid] = (events, group)
    assert list(gated) == list(model)
    assert len(gated) == len(model)
    assert all(uid in gated for uid in model)
    assert sorted(gated.concerned(change, groups)) == sorted(
        uid for uid, (events, group) in model.items() if events & change and (not group or group in groups)
    )


def test_a_gate_that_nothing_opens_is_never_tested() -> None:
    gated = GatedPods()
    gated.add("preemptor", Change.NONE)
    assert gated.concerned(Change.ALL) == []
