"""The command line: what is written where, and the exit codes."""

import errno
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from tests.support.rigel.jobfiles import G3
from tests.support.rigel.rigelfiles import ONE, orchestration

from rigel_bridge.main import _arguments, _parser, main
from rigel_bridge.verbs.table import VERBS
from rigel_bridge.verbs.verb import Verb

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "rigel" / "teleop" / "Rigelfile"


@pytest.fixture
def rigelfile(tmp_path: Path) -> Path:
    path = tmp_path / "my_robot" / "Rigelfile"
    path.parent.mkdir()
    path.write_text(ONE)
    return path


def test_the_app_goes_to_standard_output_named_after_the_folder(
    rigelfile: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", str(rigelfile)]) == 0
    app = yaml.safe_load(capsys.readouterr().out)
    assert (app["apiVersion"], app["kind"], app["metadata"]["name"]) == ("robotics.io/v1alpha1", "RobotApp", "my-robot")
    assert set(app["metadata"]["annotations"]) == {
        "rigel.robotics.io/bridge-version",
        "rigel.robotics.io/generation",
        "rigel.robotics.io/rigelfile-sha256",
    }


def test_equal_input_gives_equal_text(rigelfile: Path, capsys: pytest.CaptureFixture[str]) -> None:
    texts = [(main(["render", str(rigelfile)]), capsys.readouterr().out) for _ in range(2)]
    assert texts[0] == texts[1]


def test_equal_input_gives_equal_text_in_every_process(rigelfile: Path) -> None:
    rigelfile.write_text(G3)
    command = [
        sys.executable,
        "-m",
        "rigel_bridge.main",
        "render",
        str(rigelfile),
        "--sequence",
        "sweep",
        "--format",
        "pods",
    ]
    texts = [
        subprocess.run(command, env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, check=True).stdout
        for seed in ("1", "2")
    ]
    assert texts[0] == texts[1]


def test_a_file_can_be_written_instead(rigelfile: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "app.yaml"
    assert main(["render", str(rigelfile), "-o", str(target), "--name", "x", "-n", "fleet"]) == 0
    assert capsys.readouterr().out == ""
    assert yaml.safe_load(target.read_text())["metadata"]["namespace"] == "fleet"


def test_a_dash_reads_standard_input_and_mistakes_name_it(
    rigelfile: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(rigelfile.parent)
    for text, code in ((ONE, 0), ("packages: [", 71)):
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
        assert main(["render", "-"]) == code
    told = capsys.readouterr()
    assert yaml.safe_load(told.out)["metadata"]["name"] == "my-robot", "named after the folder one is in"
    assert told.err.startswith("standard input:")


def test_without_a_name_the_rigelfile_of_the_folder_is_read(
    rigelfile: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(rigelfile.parent)
    assert main(["render"]) == 0
    assert "name: my-robot" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, (70, "Rigelfile: cannot be read: No such file or directory")),
        ("a: *b\n", (71, "Rigelfile:1: alias *b is not allowed")),
        ("packages: []\n", (72, "Rigelfile:1: packages needs at least one entry")),
        (
            "jobz: {}\n",
            (73, "Rigelfile:1: packages (Rigel 0.2), application and jobs (0.3), or orchestration is missing"),
        ),
    ],
)
def test_each_kind_of_mistake_has_its_exit_code_and_one_line(
    text: str | None,
    expected: tuple[int, str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, message = expected
    if text is not None:
        Path("Rigelfile").write_text(text)
    assert main(["render"]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(message)
    assert captured.err.count("\n") == 1


def test_an_output_that_cannot_be_written_is_one_line(
    rigelfile: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", str(rigelfile), "-o", str(tmp_path / "no" / "dir.yaml")]) == 70
    assert "cannot be written: No such file or directory" in capsys.readouterr().err


def test_a_full_disk_behind_standard_output_is_one_line(
    rigelfile: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(_: str) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys.stdout, "write", full)
    assert main(["render", str(rigelfile)]) == 70
    assert capsys.readouterr().err == "standard output: cannot be written: No space left on device\n"


def test_notes_go_to_standard_error_and_fail_only_when_strict(
    rigelfile: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rigelfile.write_text(orchestration("namespace: fleet"))
    assert main(["render", str(rigelfile)]) == 0
    assert "note: " in capsys.readouterr().err
    assert main(["render", str(rigelfile), "--strict"]) == 72
    assert capsys.readouterr().out == ""


def test_of_the_environment_only_what_was_named_is_taken(
    rigelfile: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TAG", "9")
    rigelfile.write_text(ONE.replace(":1", ":{{ TAG }}"))
    assert main(["render", str(rigelfile), "--env", "TAG"]) == 0
    assert "acme/driver:9" in capsys.readouterr().out
    assert main(["render", str(rigelfile)]) == 72


def test_help_shows_examples_and_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["render", "--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert "rigel-bridge render ws/Rigelfile | kubectl apply -f -" in text
    assert "exit codes" in text


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb.name)
def test_every_command_has_examples_of_its_own_within_80_columns(
    verb: Verb, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main([verb.name, "--help"])
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    assert f"rigel-bridge {verb.name}" in shown.partition("examples:")[2]
    for line, effect in verb.examples:
        assert effect
        assert line in shown


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb.name)
def test_every_example_is_a_command_line_that_is_understood(verb: Verb, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TAG", "1.4.0")
    for line, _ in verb.examples:
        for part in re.split(r" [|>] ?| && ", line):
            words = shlex.split(part)
            if "rigel-bridge" in words:
                typed = words[words.index("rigel-bridge") + 1 :]
                assert not _parser()[0].parse_known_args(typed)[1], line


def test_the_name_of_an_app_may_stand_behind_a_flag() -> None:
    for typed in (["collect", "out", "-n", "fleet", "amr"], ["collect", "out", "amr", "-n", "fleet"]):
        arguments = _arguments(typed)
        assert (str(arguments.folder), arguments.app, arguments.namespace) == ("out", "amr", "fleet")


def test_an_unknown_flag_is_told_by_its_command_with_the_nearest_one(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["render", "--fromat", "pods"])
    assert caught.value.code == 2
    assert "rigel-bridge render: error: --fromat is not known here (did you mean --format?)" in capsys.readouterr().err


def test_wrong_usage_has_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["rendr"])
    assert caught.value.code == 2
    assert capsys.readouterr().err == (
        "rigel-bridge: error: there is no command rendr (did you mean render?); `rigel-bridge --help` shows what is allowed\n"
    )


@pytest.mark.parametrize(
    "typed",
    [
        [],
        ["x\x1b[2J"],
        ["render", "--format", "x"],
        ["status", "A\x1b"],
        ["collect"],
        ["rollback", "--to", "-3"],
        ["render", "a", "b"],
    ],
)
def test_wrong_usage_is_one_line_that_a_terminal_can_show(typed: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(typed)
    assert caught.value.code == 2
    found = capsys.readouterr()
    (line,) = found.err.splitlines()
    assert line.isprintable()
    assert line.startswith("rigel-bridge")
    assert "--help` shows what is allowed" in line
    assert found.out == ""


def test_every_command_stands_on_the_line_of_its_summary(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    for verb in VERBS:
        assert any(line.split(maxsplit=1) == [verb.name, verb.summary] for line in lines), verb.name


def test_the_shipped_example_renders_without_a_note(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", str(EXAMPLE), "--strict"]) == 0
    app = yaml.safe_load(capsys.readouterr().out)
    assert [component["name"] for component in app["spec"]["components"]] == ["operator-ui", "base-driver"]


def test_the_bridge_needs_nothing_but_yaml() -> None:
    """It is installed into Rigel's own environment, whose pydantic is another."""
    code = "import sys, rigel_bridge.main; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"pydantic", "msgspec", "aiohttp", "kubernetes", "kopf", "robotapp_api"} & set(output)


def test_a_full_disk_is_one_line_and_a_code_for_every_command(tmp_path: Path) -> None:
    (tmp_path / "Rigelfile").write_text(ONE)
    for verb in ("render", "check"):
        with Path("/dev/full").open("w") as full:
            command = [sys.executable, "-m", "rigel_bridge.main", verb, str(tmp_path / "Rigelfile")]
            done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
        assert done.returncode == 70
        assert done.stderr.splitlines()[-1].endswith(b": No space left on device")
        assert b"Traceback" not in done.stderr
