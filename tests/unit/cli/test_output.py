"""Tables: folded to the width there is, readable whatever it is."""

import io
import json

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from robotapp_cli.output import Column, Output, name_repeated, print_table, write_structured

CELL = st.text("abcdefgh -", max_size=40).map(str.strip)


@given(st.lists(st.tuples(CELL, CELL, CELL), min_size=1, max_size=4), st.integers(20, 160), st.sampled_from([0, 2]))
def test_no_name_is_cut_and_only_names_make_a_line_too_long(
    rows: list[tuple[str, str, str]], width: int, indent: int
) -> None:
    text = io.StringIO()
    columns = ["FIRST", "SECOND", Column("TEXT", wraps=True)]
    print_table(columns, rows, indent=indent, on=Console(file=text, width=width))
    assert all(name in text.getvalue() for row in rows for name in row[:2])
    names = sum(max(map(len, (heading, *(row[at] for row in rows)))) for at, heading in enumerate(("FIRST", "SECOND")))
    assert max(map(cell_len, text.getvalue().splitlines())) <= max(width, indent + names + 24 + 3 * 3)


def test_a_terminal_obeys_nothing_that_stands_in_a_cell() -> None:
    """A device's model may be anything that the holder of an agent's token wrote."""
    console = Console(file=io.StringIO(), width=80)
    print_table(["MODEL"], [["\x1b]0;mine\x07cam\u202e\x9b2J"]], on=console)
    written = console.file.getvalue()  # type: ignore[attr-defined]
    assert written.splitlines()[1] == r"\x1b]0;mine\x07cam\u202e\x9b2J"


@pytest.mark.parametrize("output", [Output.JSON, Output.YAML])
def test_a_terminal_obeys_nothing_of_structured_output_and_it_reads_back_the_same(
    output: Output, capsys: pytest.CaptureFixture[str]
) -> None:
    data = {
        "message": "\x9b2J \u202e \x7f \x1b[2J",
        "note": "größer → 30 µs",
        "lines": "a\nb",
        "far": "\U0001f916\U000e0001",
    }
    write_structured(data, output)
    text = capsys.readouterr().out
    assert text.replace("\n", "").isprintable()
    assert (json.loads(text) if output is Output.JSON else yaml.safe_load(text)) == data


def test_structured_output_has_letters_of_all_languages_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    for output in (Output.JSON, Output.YAML):
        write_structured({"note": "größer → 30 µs"}, output)
        assert "größer → 30 µs" in capsys.readouterr().out


def test_a_cause_that_several_rows_share_is_printed_once() -> None:
    cause, other = "amr-07: didn't have the required hardware (asked for: usb 8086:0b3a)", "short"
    texts = [cause, other, cause, "", cause + "!", other]
    assert name_repeated(list("abcdef"), texts) == [cause, other, "as a", "", cause + "!", other]
