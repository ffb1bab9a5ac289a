"""Ranges of domain ids."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.quantities.ranges import parse_ids


def test_the_default_pool_has_119_ids() -> None:
    ids = parse_ids("1-101,215-232")
    assert (len(ids), ids[0], ids[100], ids[101], ids[-1]) == (119, 1, 101, 215, 232)


@given(st.sets(st.integers(0, 232)).map(sorted))
def test_ranges_and_single_ids_give_every_id_between_their_ends(bounds: list[int]) -> None:
    spans = list(itertools.zip_longest(bounds[::2], bounds[1::2]))
    text = ",".join(str(first) if last is None else f"{first}-{last}" for first, last in spans)
    assert parse_ids(text) == tuple(
        n for first, last in spans for n in range(first, (first if last is None else last) + 1)
    )


@pytest.mark.parametrize("text", ["7-5", "1-5,5-7", "9,3", "230-233", "1-", "-1", "1,,2", " 1", "a", "1-2-3", "0001"])
def test_anything_but_ascending_ranges_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="range"):
        parse_ids(text)
