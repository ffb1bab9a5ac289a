"""What is refused in a cron line, and what to write instead."""

import json

import pytest
from tests.support.apiobjects import app, component

from robotapp_api.values.schedules.due_times import MACROS, parse_due_times
from robotapp_cli.lint.linter import lint


@pytest.mark.parametrize(
    ("line", "term", "cure"),
    [
        ("60 2 * * *", "'60' is not possible as minute", "write 0-59"),
        ("H 2 * * *", "'H' is not possible as minute", "write 0-59"),
        ("0 24 * * *", "'24' is not possible as hour", "write 0-23"),
        ("0 1,22-5 * * *", "'22-5' is not possible as hour", "write 22-23,0-5"),
        ("0 0 * * 5-1", "'5-1' is not possible as day of the week", "write 5-6,0-1"),
        ("0 0 * * FRI-MON", "'FRI-MON' is not possible as day of the week", "from the earlier to the later"),
        ("*/0 * * * *", "'*/0' is not possible as minute", "steps of at least 1"),
        ("0 0 0 * *", "'0' is not possible as day of the month", "write 1-31"),
        ("0 0 1 13 *", "'13' is not possible as month", "write 1-12 or JAN-DEC"),
        ("0 0 30 2 *", "no month that it names has such a day", "write a day that one of them has"),
    ],
)
def test_a_field_that_is_not_possible_is_named_with_what_it_takes(line: str, term: str, cure: str) -> None:
    with pytest.raises(ValueError, match="write") as refusal:
        parse_due_times(line, "UTC")
    assert line in str(refusal.value)
    assert term in str(refusal.value)
    assert cure in str(refusal.value)
    assert "five fields" not in str(refusal.value)


@pytest.mark.parametrize(
    ("line", "cure"),
    [
        ("@every 5m", "write for example */5 * * * *"),
        ("@reboot", "the names are @hourly, @daily"),
        ("@Daily", "in small letters"),
        ("CRON_TZ=UTC 0 2 * * *", "write it into timeZone"),
        ("TZ=UTC 0 2 * * *", "write it into timeZone"),
        ("0 2 * *", "4 fields are written; write five"),
        ("0 0 2 * * *", "6 fields are written; write five"),
        ("0 2 ? * *", "write * for every one"),
        (" 0 2 * * *", "with blanks between them"),
        ("", "0 fields are written"),
    ],
)
def test_a_line_of_another_shape_has_one_mistake_about_what_is_written(line: str, cure: str) -> None:
    findings = lint_line(line)
    assert len(findings) == 1, findings
    assert cure in findings[0]
    assert ("@every" in line) == ("intervals" in findings[0])


@pytest.mark.parametrize("name", MACROS)
def test_every_name_that_is_accepted_is_in_the_message_about_names(name: str) -> None:
    assert lint_line(name) == []
    (message,) = lint_line("@reboot")
    assert name in message


def lint_line(line: str) -> list[str]:
    """Returns what lint writes about an app with this cron line."""
    spec = app(components=[component(job={}, schedule={"cron": line})])
    return [finding.message for finding in lint(json.dumps(spec).encode()).findings]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("*/90 * * * *", "*/90 as minute is due at 0 alone, because steps begin anew with each hour"),
        ("0,5/61 * * * *", "5/61 as minute is due at 5 alone"),
        ("0 */36 * * *", "*/36 as hour is due at 0 alone, because steps begin anew with each day"),
        ("0 0 */45 * *", "*/45 as day of the month is due at 1 alone, because steps begin anew with each month"),
        ("0 0 1 */18 *", "*/18 as month is due at 1 alone, because steps begin anew with each year"),
        ("0 0 * * */14", "*/14 as day of the week is due at 0 alone, because steps begin anew with each week"),
    ],
)
def test_a_step_that_is_longer_than_its_field_has_a_note(line: str, words: str) -> None:
    (note,) = lint_line(line)
    assert note.startswith(words)
    assert "write" in note


@pytest.mark.parametrize(
    "line", ["*/60 * * * *", "0 */24 * * *", "*/15 * * * *", "10-50/20 * * * *", "@daily", "0 2 * * *"]
)
def test_a_step_that_is_due_as_often_as_written_has_no_note(line: str) -> None:
    assert lint_line(line) == []
