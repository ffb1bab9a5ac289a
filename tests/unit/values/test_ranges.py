"""Ranges of domain ids."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.ranges import format_ids, parse_ids


def test_the_default_pool_has_119_ids() -> None:
    ids = parse_ids("1-101,215-232")
    assert (len(ids), ids[0], ids[100], ids[101], ids[-1]) == (119, 1, 101, 215, 232)


@given(st.sets(st.integers(0, 232)))
def test_parsing_what_was_formatted_gives_the_same_ids(ids: set[int]) -> None:
    assert parse_ids(format_ids(ids)) == tuple(sorted(ids))


@pytest.mark.parametrize("text", ["7-5", "1-5,5-7", "9,3", "230-233", "1-", "-1", "1,,2", " 1", "a", "1-2-3", "0001"])
def test_anything_but_ascending_ranges_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="range"):
        parse_ids(text)
