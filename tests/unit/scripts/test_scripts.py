"""What the scripts say to somebody who asks them for something they do not do."""

import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[3] / "scripts"


def asked(script: str, *args: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    command = [str(SCRIPTS / script), *args]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize(("script", "line"), [("build", "Builds the wheel"), ("check", "Format, lint, types")])
def test_an_argument_it_does_not_know_is_answered_with_what_it_does(script: str, line: str, tmp_path: Path) -> None:
    wrong = asked(script, "nonsense", folder=tmp_path)
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr.startswith(line)
    helped = asked(script, "--help", folder=tmp_path)
    assert (helped.returncode, helped.stdout) == (0, wrong.stderr)


@pytest.mark.parametrize("verb", ["mutan.s", "nonsense", "stub\\", "s*"])
def test_a_verb_of_bench_is_a_name_and_no_pattern(verb: str, tmp_path: Path) -> None:
    answer = asked("bench", verb, "--help", folder=tmp_path)
    assert (answer.returncode, answer.stdout) == (2, "")
    assert answer.stderr == f"scripts/bench: there is no verb '{verb}'; run scripts/bench for the list\n"


def test_the_verbs_of_bench_are_listed_in_two_columns(tmp_path: Path) -> None:
    _, *lines = asked("bench", folder=tmp_path).stdout.splitlines()
    verbs = [line[:18].strip() for line in lines]
    assert "profile_hostile" in verbs
    assert [verb for verb in verbs if not verb.isidentifier()] == []
    assert all(line[18] == " " != line[19] for line in lines)


def test_help_on_a_bench_is_given_before_anything_is_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    answer = asked("bench", "stub", "--help", folder=tmp_path)
    assert answer.returncode == 0
    assert answer.stdout.startswith("usage: scripts/bench stub")
    assert list(tmp_path.iterdir()) == []
