"""A draft: its text, its changed lines, and its mistakes."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.console.tuning.documents import build_document, build_text, enable

from robotapp_console.tuning.draft import MOST_LINES, MOST_TEXT, Stored, make_draft, read_stored
from robotapp_console.tuning.form import build_form, fill_form
from robotapp_console.tuning.lines import mark_lines

TEXT = build_text()
WITH_COMMENTS = f"# ours\n{TEXT}# the end\n"


def fields_with(**changes: str) -> dict[str, str]:
    return fill_form(build_form(build_document())) | {name.replace("__", "-"): text for name, text in changes.items()}


def test_without_a_change_the_text_stays_as_it_was_written() -> None:
    draft = make_draft(read_stored(WITH_COMMENTS), WITH_COMMENTS, fields_with())
    assert (draft.text, draft.changes, draft.problems) == (WITH_COMMENTS, 0, ())
    assert not draft.may_be_applied


def test_changed_lines_are_marked() -> None:
    draft = make_draft(read_stored(WITH_COMMENTS), WITH_COMMENTS, fields_with(p0__weight__TopologyScore="10"))
    assert [line.text.strip() for line in draft.lines if line.mark == "added"] == [
        "plugins:",
        "score:",
        "enabled:",
        "- name: TopologyScore",
        "weight: 10",
    ]
    assert draft.may_be_applied
    assert "# ours" not in draft.text


def test_a_second_change_starts_from_the_first() -> None:
    stored = read_stored(TEXT)
    first = make_draft(stored, TEXT, fields_with(p0__weight__TopologyScore="10"))
    fields = fill_form(first.form) | {"p0-weight-TopologyScore": "11"}
    second = make_draft(stored, first.base, fields)
    assert "weight: 11" in second.text
    back = make_draft(stored, second.base, fill_form(second.form) | {"p0-weight-TopologyScore": "25"})
    assert "weight: 25" in back.text


def test_a_mistake_keeps_what_was_entered_and_forbids_to_apply() -> None:
    draft = make_draft(read_stored(TEXT), TEXT, fields_with(p0__weight__TopologyScore="heavy"))
    assert draft.entered == {"p0-weight-TopologyScore": "heavy"}
    assert not draft.may_be_applied
    assert list(draft.problems_by_field) == ["p0-weight-TopologyScore"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "configuration"),
        ("a: [", "yaml"),
        ("kind: Pod\napiVersion: v1\n", "apiVersion"),
        (f"{TEXT}unknown: 1\n", 'unknown field "unknown"'),
        ("- 1\n", "mapping"),
        ("x" * (MOST_TEXT + 1), "at most"),
        ("\n" * 254_000, "254000 characters"),
        ("\n" * (MOST_LINES + 1), "3001 lines"),
        (f"{TEXT}profiles: []\n", "already set"),
        (build_text(plugins={"score": enable(*(f"a{number}" for number in range(200)))}), "at most 10 and 300"),
        (TEXT + "".join(f"- schedulerName: s{number}\n" for number in range(9)), "11 profiles"),
    ],
)
def test_a_text_without_the_shape_of_a_configuration_has_no_form_but_its_mistakes(text: str, words: str) -> None:
    draft = make_draft(read_stored(TEXT), text, None)
    assert draft.form == ()
    assert words in draft.problems[0].text
    assert not draft.may_be_applied
    assert draft.text == text


@pytest.mark.parametrize("text", ["x" * (MOST_TEXT + 1), "\n" * (MOST_LINES + 1), "\n" * 254_000])
def test_a_text_that_is_too_long_is_neither_compared_nor_shown_line_by_line(text: str) -> None:
    draft = make_draft(read_stored(TEXT), text, None)
    assert (draft.lines, draft.is_compared, draft.may_be_applied) == ((), False, False)


def test_a_long_text_in_the_configmap_is_shown_as_far_as_there_is_room_and_may_be_replaced() -> None:
    stored = read_stored("#\n" * (MOST_LINES + 7))
    shown = make_draft(stored, stored.text, None)
    assert (len(shown.lines), shown.hidden, shown.changes, shown.is_compared) == (MOST_LINES, 7, 0, True)
    assert not shown.may_be_applied
    assert make_draft(stored, TEXT, None).may_be_applied


def test_a_short_text_that_is_long_when_written_out_is_not_compared_and_may_be_applied() -> None:
    names = ",".join("a" for _ in range(MOST_LINES + 1))
    text = f"{TEXT}  pluginConfig: [{{name: Foreign, args: {{names: [{names}]}}}}]\n"
    draft = make_draft(read_stored(TEXT), text, None)
    assert draft.problems == ()
    assert (draft.lines, draft.is_compared, draft.may_be_applied) == ((), False, True)


def test_a_field_that_cannot_change_while_the_scheduler_runs_is_named() -> None:
    other = TEXT.replace("kubernetes-scheduler", "another-scheduler")
    draft = make_draft(read_stored(TEXT), other, None, running=TEXT)
    assert any("profiles[].schedulerName cannot change while the scheduler runs" in text for text in draft.warnings)
    assert make_draft(read_stored(TEXT), TEXT, None, running=TEXT).warnings == ()


@settings(max_examples=80, deadline=None)
@given(st.one_of(st.text(max_size=300), st.text(alphabet="{}[]:-&* \nab", max_size=120)))
def test_no_text_breaks_the_page(text: str) -> None:
    draft = make_draft(read_stored(TEXT), f"{TEXT}{text}", None)
    assert draft.problems or draft.form
    assert make_draft(Stored(""), text, None).problems


@given(st.lists(st.sampled_from("abcd"), max_size=12), st.lists(st.sampled_from("abcd"), max_size=12))
def test_marked_lines_hold_both_texts(before: list[str], after: list[str]) -> None:
    lines = mark_lines("\n".join(before), "\n".join(after))
    assert [line.text for line in lines if line.mark != "removed"] == after
    assert [line.text for line in lines if line.mark != "added"] == before
