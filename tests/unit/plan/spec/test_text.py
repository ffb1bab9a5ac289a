"""Room that texts take."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_operator.plan.spec.text import clip, stored_bytes


def test_short_texts_stay_and_long_ones_show_that_they_were_cut() -> None:
    assert clip("abc", 3) == "abc"
    assert clip("abcdefgh", 6) == "abc…"


@pytest.mark.parametrize(("text", "size"), [("a", 1), ("ä", 2), ("…", 3), ("<", 6), ('"', 2), ("\n", 2), ("\x01", 6)])
def test_characters_count_as_the_server_stores_them(text: str, size: int) -> None:
    assert stored_bytes(text) == size + 2


@given(st.text(max_size=80), st.integers(3, 60))
def test_a_clipped_text_fits_and_is_a_beginning(text: str, limit: int) -> None:
    found = clip(text, limit)
    assert stored_bytes(found) - 2 <= limit
    assert len(found) <= limit
    assert text.startswith(found.removesuffix("…") if found != text else text)


@given(st.text(st.sampled_from('ab "\\<>&\x7f\n~ä'), max_size=9) | st.text(max_size=9))
def test_a_text_is_cut_when_it_takes_more_than_there_is_room_for(text: str) -> None:
    room = stored_bytes(text) - 2
    assert clip(text, room) == text
    assert room == 0 or clip(text, room - 1) != text


@given(
    st.recursive(st.text(max_size=9) | st.integers(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner))
)
def test_an_object_takes_at_least_its_json(value: object) -> None:
    assert stored_bytes(value) >= len(
        json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode(errors="replace")
    )
