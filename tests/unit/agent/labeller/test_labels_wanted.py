"""Which labels the labeller wants on a node, and which it leaves to others."""

from hypothesis import given
from hypothesis import strategies as st

from robotapp_agent.labeller.wanted import Wanted, free_of, keys_of_causes

CAN, VIDEO = "hardware.robotics.io/can-can0", "hardware.robotics.io/video"
KEYS = st.sampled_from(["a", "b", "c"])
LABELS = st.dictionaries(KEYS, st.sampled_from(["true", "x", "y"]))


def test_a_new_device_is_wanted_at_once_and_one_that_went_for_half_a_minute_more() -> None:
    wanted = Wanted()
    wanted.update({CAN: "true", VIDEO: "cam"}, now_s=0)
    wanted.update({VIDEO: "cam"}, now_s=100)
    assert wanted.due_s == 130
    assert wanted.at(129.9) == {CAN: "true", VIDEO: "cam"}
    assert wanted.at(130) == {VIDEO: "cam"}
    assert wanted.due_s is None


def test_a_device_that_comes_back_in_time_keeps_its_label_and_begins_anew() -> None:
    wanted = Wanted()
    wanted.update({CAN: "true"}, now_s=0)
    wanted.update({}, now_s=10)
    wanted.update({CAN: "true"}, now_s=39)
    wanted.update({}, now_s=40)
    assert wanted.at(69) == {CAN: "true"}
    assert wanted.at(70) == {}


def test_writing_the_same_again_does_not_put_the_end_off() -> None:
    wanted = Wanted()
    wanted.update({CAN: "true"}, now_s=0)
    for now_s in range(10, 40, 5):
        wanted.update({}, now_s=now_s)
    assert wanted.at(40) == {}


@given(st.lists(st.tuples(st.floats(0, 20), LABELS), min_size=1))
def test_what_is_plugged_in_is_always_wanted_and_nothing_that_is_long_gone(
    changes: list[tuple[float, dict[str, str]]],
) -> None:
    wanted, now_s, seen = Wanted(), 0.0, set[str]()
    for pause_s, labels in changes:
        now_s += pause_s
        wanted.update(labels, now_s=now_s)
        seen |= labels.keys()
        current = wanted.at(now_s)
        assert labels.items() <= current.items()
        assert current.keys() <= seen
    assert wanted.at(now_s + 31) == changes[-1][1]


def test_a_label_that_somebody_set_to_another_value_is_theirs_until_they_change_it() -> None:
    wanted = {CAN: "true", VIDEO: "cam"}
    taken = {VIDEO: "mine"}
    assert free_of(wanted, on_node={VIDEO: "mine"}, taken=taken) == {CAN: "true"}
    assert free_of(wanted, on_node={}, taken=taken) == wanted
    assert free_of(wanted, on_node={VIDEO: "other"}, taken=taken) == wanted
    assert free_of(wanted, on_node={VIDEO: "cam"}, taken=taken) == wanted


def test_the_owners_of_a_refusal_are_found_by_the_field_they_own() -> None:
    causes = [
        (f".metadata.labels.{VIDEO}", "FieldManagerConflict", 'conflict with "kubectl-label"'),
        (".metadata.annotations.a", "FieldManagerConflict", "x"),
    ]
    assert keys_of_causes(causes, [CAN, VIDEO]) == {VIDEO}
    assert keys_of_causes([], [CAN, VIDEO]) == set()
