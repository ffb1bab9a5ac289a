"""The history of an app: what is stored, what gives way, where a rollback goes."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from rigel_bridge.cluster.revisions import MOST, Revision, belonging, recording, same, target

SPECS = st.lists(st.integers(0, 15), min_size=1, max_size=40)


def app(image: object, uid: str = "u") -> dict[str, Any]:
    metadata = {
        "name": "teleop",
        "namespace": "fleet",
        "uid": uid,
        "annotations": {"x": "y", "rigel.robotics.io/job": "j"},
    }
    return {"metadata": metadata, "spec": {"image": image}}


def recorded(items: list[dict[str, Any]], stored: dict[str, Any]) -> list[dict[str, Any]]:
    wanted = recording(items, stored)
    left = [item for item in items if item["metadata"]["name"] not in wanted.delete]
    return [*left, wanted.create] if wanted.create else left


@given(SPECS)
def test_the_newest_revision_is_the_last_spec_and_the_last_ten_others_are_kept(images: list[int]) -> None:
    items: list[dict[str, Any]] = []
    for image in images:
        items = recorded(items, app(image))
        assert len(items) <= MOST
    kept = [revision.spec["image"] for revision in belonging(items, app(0))]
    last_first = list(dict.fromkeys(reversed(images)))
    assert kept == last_first[:MOST][::-1]
    names = [item["metadata"]["name"] for item in items]
    assert len(set(names)) == len(names)


def test_a_spec_that_is_the_newest_already_is_not_stored_again() -> None:
    items = recorded([], app(1))
    assert recording(items, app(1)).create is None


def test_a_revision_belongs_to_the_app_of_that_uid_and_keeps_the_bridges_annotations_alone() -> None:
    items = recorded([], app(1))
    assert belonging(items, app(1, uid="another")) == []
    (mine,) = belonging(items, app(1))
    assert mine.provenance == {"rigel.robotics.io/job": "j"}
    (again,) = [item for item in recorded(items, app(1, uid="another")) if item not in items]
    assert again["revision"] == 2, "the number of a deleted app's revision, which may still be there, is not used again"


def test_what_is_no_spec_is_passed_over() -> None:
    broken = recorded([], app(1))[0]
    for data in (None, [], {"spec": "x"}, {}):
        assert belonging([{**broken, "data": data}], app(1)) == []


def test_byte_for_byte_keeps_numbers_words_and_truth_apart() -> None:
    assert same({"a": 1, "b": [2]}, {"b": [2], "a": 1})
    assert not any(same({"a": 1}, {"a": other}) for other in (1.0, True, "1", None))


def test_a_rollback_goes_to_the_last_other_spec_or_the_number_given() -> None:
    past = [Revision(number, f"teleop-{number}", {"image": number}) for number in (3, 4, 5)]
    assert target(past, {"image": 5}, None) is past[1]
    assert target(past, {"image": 9}, None) is past[2], "somebody edited: the last apply is the last other one"
    assert target(past, {"image": 5}, 3) is past[0]
    assert target(past, {"image": 5}, 1) == "there is no revision 1; stored are: 3, 4, 5"
    assert target([], {"image": 5}, None) == "there is no earlier spec to go back to; stored are: none"
