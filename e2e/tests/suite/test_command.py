"""The options of `scripts/test`: what they may be combined with, and what they do."""

import pytest

import suite.__main__ as command
from suite import landing


def test_a_list_writes_nothing_whatever_is_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(_waiting: object) -> None:
        pytest.fail("a list recorded a landing")

    monkeypatch.setattr(landing, "record_landing", refuse)
    assert command.main(["--list", "--landed"]) == 0
    assert "in all, if one ran after the other" in capsys.readouterr().out


@pytest.mark.parametrize("option", ["--list", "--landed"])
def test_what_runs_nothing_has_nothing_to_record(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        command.parse_arguments(["--record", option])
    assert "--list and --landed run nothing: leave one of them out" in capsys.readouterr().err


def test_options_are_written_out(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        command.parse_arguments(["--all", "--rec"])
    assert "unrecognized arguments: --rec" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["0/8", "9/8", "3", "a/b", "-1/8", "1/0"])
def test_a_share_that_does_not_exist_is_refused_with_what_to_write(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        command.parse_arguments([f"--part={text}"])
    assert "write K/N with 1 <= K <= N, for example 3/8" in capsys.readouterr().err


def test_a_part_without_tests_names_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--part", "500/500"]) == 0
    assert capsys.readouterr().out == (
        "part 500/500 holds no tests: the parts before it hold all, because no module is divided\n"
    )
