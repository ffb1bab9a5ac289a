"""The options of `scripts/test`: what they may be combined with, and what they do."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import pytest

import suite.__main__ as command
from suite import durations, landing
from suite.lanes import Lanes
from suite.plan import Group
from suite.summary import GroupResult

ESSENTIAL: Final = ["tests/live/cli/test_commands_live.py", "tests/live/crds/test_lint_live.py::test_one"]


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


def plan(*arguments: str) -> command.Plan:
    return command.make_plan(command.parse_arguments(arguments), ESSENTIAL)


@pytest.fixture
def landed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Three groups in their last landing of a round; returns the list of changed files, for the test to fill."""
    changed_files: list[str] = []
    modules = ["tests/live/bridge/test_a.py", "tests/live/cli/test_b.py", "tests/live/cli/test_c.py"]
    waiting = ("tests/live/bridge/test_a.py",)
    monkeypatch.setattr(landing, "list_test_modules", lambda: modules)
    monkeypatch.setattr(durations, "load_durations", lambda: dict.fromkeys(modules, 500.0))
    monkeypatch.setattr(landing, "read_landing", lambda: landing.Landing("0" * 40, waiting))
    monkeypatch.setattr(landing, "list_changed_files", lambda _landed: changed_files)
    return changed_files


def test_the_last_line_names_what_ran_what_waits_and_what_is_next(landed: list[str]) -> None:
    landed += ["tests/live/cli/test_b.py", "rigel_bridge/x.py", "tests/live/cli/test_c.py"]
    last_line = plan("--ci")
    assert last_line.ran == (
        "essential tests; in turn: tests/live/bridge; 1 modules that changed files concern (1 more wait for their turn)"
    )
    assert last_line.next_turn == (
        "property tests with all examples + e2e/tests/testbed + e2e/tests/campaigns + e2e/tests/ros_nodes"
        " + e2e/tests/suite + tests/live/bridge"
    )


def test_only_the_rest_takes_all_samples_unless_everything_runs(landed: list[str]) -> None:
    landed.append("cli/robotapp_cli/main.py")

    def list_variables(*arguments: str) -> dict[str, tuple[tuple[str, str], ...]]:
        return {group.name: group.variables for group in plan(*arguments).list_groups()}

    essential: dict[str, tuple[tuple[str, str], ...]] = {
        command.QUICK: command.FEW_EXAMPLES,
        "tests/live/cli": (),
        "tests/live/crds": (),
    }
    assert list_variables() == essential
    rest = dict.fromkeys(["tests/live/bridge, rest", "tests/live/cli, rest"], command.ALL_SAMPLES)
    assert list_variables("--ci") == essential | rest
    assert set(list_variables("--part", "1/1").values()) == {command.ALL_SAMPLES}
    assert set(list_variables("--all").values()) == {command.ALL_SAMPLES}
    assert {"tests/live/cli", "tests/live/crds"} < set(list_variables("--all"))


@pytest.mark.parametrize(("status", "recorded_names"), [(0, {"it", "test_it.py"}), (1, set())])
def test_only_durations_of_what_succeeded_are_recorded(
    status: int, recorded_names: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pytest.ini").write_text("[pytest]\njunit_family = xunit1\n")
    (tmp_path / "test_it.py").write_text(f"def test_it(): assert {status} == 0\n")
    settings = (f"--rootdir={tmp_path}", "-c", str(tmp_path / "pytest.ini"))
    lanes = Lanes(tmp_path)
    lanes.run([Group("it", (str(tmp_path / "test_it.py"), *settings), 1.0)], {})
    recorded: dict[str, float] = {}

    def save(seconds_by_name: dict[str, float], _names: Sequence[str]) -> None:
        recorded.update(seconds_by_name)

    monkeypatch.setattr(durations, "save_durations", save)
    command._record(lanes, command.Plan([], "it", is_everything=True), [])
    assert set(recorded) == recorded_names


def test_a_module_is_recorded_only_when_its_essential_tests_succeeded_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lanes = Lanes(tmp_path, results=[GroupResult("tests/live/crds", Counter(failed=1), ("x",), 1.0, 1)])
    monkeypatch.setattr(durations, "read_reports", lambda *_: {"tests/live/crds/test_lint_live.py": 1.0})
    recorded: dict[str, float] = {}
    monkeypatch.setattr(durations, "save_durations", lambda seconds_by_name, _names: recorded.update(seconds_by_name))
    command._record(lanes, command.Plan([], "everything", is_everything=True), ESSENTIAL)
    assert recorded == {}
