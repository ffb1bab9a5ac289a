"""The history of a configuration: what is kept, and what undo brings back."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_console.tuning.versions import (
    KEPT,
    KEPT_BYTES,
    MOST_NUMBER,
    Version,
    find_previous,
    is_recorded,
    plan_addition,
    read_versions,
)

AT = "2026-01-01T00:00:00Z"


def record(*texts: str) -> tuple[Version, ...]:
    """Applies the texts one after the other."""
    data: dict[str, str] = {}
    for text in texts:
        for key, value in plan_addition(read_versions(data), text, at=AT, by="ann").items():
            if value is None:
                del data[key]
            else:
                data[key] = value
    return read_versions(data)


def test_the_last_twenty_versions_are_kept_with_author_and_time() -> None:
    versions = record(*(f"text {number}" for number in range(30)))
    assert [version.text for version in versions] == [f"text {number}" for number in range(30 - KEPT, 30)]
    assert {(version.by, version.at) for version in versions} == {("ann", AT)}
    assert versions[-1].number == 30


def test_long_texts_are_kept_as_long_as_they_fit_into_a_config_map() -> None:
    versions = record(*(str(number % 10) * 100_000 for number in range(15)))
    sizes = sum(len(version.encode()) for version in versions)
    assert sizes <= KEPT_BYTES
    assert len(versions) == 8


@given(st.dictionaries(st.text(max_size=20), st.text(max_size=40)))
def test_what_is_no_version_is_left_out(data: dict[str, str]) -> None:
    assert read_versions(data) == ()
    assert read_versions({**data, "version-000003": '{"at": 1}', "version-000004": "[]"}) == ()


@pytest.mark.parametrize(
    "value",
    [
        "[" * 100_000,
        '{"at": "", "by": "", "text": "\\ud800"}',
        '{"at": "\\udfff", "by": "", "text": ""}',
        f'{{"at": {"9" * 5000}, "by": "", "text": ""}}',
    ],
)
def test_one_entry_that_nobody_can_read_hides_no_other(value: str) -> None:
    data = {version.key: version.encode() for version in record("a", "b")}
    assert [version.text for version in read_versions({**data, "version-000003": value})] == ["a", "b"]


@pytest.mark.parametrize(
    "number", ["99999999999", "999999999999", "9" * 200, "0000000007", "\u0660\u0660\u0660\u0660\u0660\u0667"]
)
def test_after_a_number_that_somebody_else_chose_the_next_version_is_still_read(number: str) -> None:
    foreign = {f"version-{number}": json.dumps({"at": AT, "by": "eve", "text": "eve's"})}
    versions = read_versions({version.key: version.encode() for version in record("a", "b")} | foreign)
    data = {version.key: version.encode() for version in versions}
    for key, value in plan_addition(versions, "c", at=AT, by="ann").items():
        data.pop(key, None)
        if value is not None:
            data[key] = value
    after = read_versions(data)
    assert (after[-1].text, after[-1].by) == ("c", "ann")
    assert [version.text for version in after if version.by == "ann"] == ["a", "b", "c"]
    assert all(version.number < MOST_NUMBER for version in after)


@given(st.lists(st.text(max_size=200), max_size=30))
def test_versions_read_as_they_were_written(texts: list[str]) -> None:
    assert [version.text for version in record(*texts)] == texts[-KEPT:]


def test_undo_brings_back_the_version_before_the_one_in_the_config_map() -> None:
    versions = record("a", "b", "c")
    assert find_previous(versions, "c") == versions[1]
    assert find_previous(versions, "b") == versions[0]
    assert find_previous(versions, "a") is None


def test_a_text_that_is_not_recorded_goes_back_to_the_newest_version() -> None:
    versions = record("a", "b")
    assert find_previous(versions, "by kubectl") == versions[1]
    assert find_previous((), "by kubectl") is None
    assert not is_recorded(versions, "by kubectl")


def test_undo_twice_is_as_before() -> None:
    versions = record("a", "b")
    first = find_previous(versions, "b")
    assert first is not None
    assert first.text == "a"
    second = find_previous(record("a", "b", "a"), "a")
    assert second is not None
    assert second.text == "b"


def test_the_same_text_twice_in_a_row_is_passed_over() -> None:
    previous = find_previous(record("a", "b", "b"), "b")
    assert previous is not None
    assert previous.text == "a"
