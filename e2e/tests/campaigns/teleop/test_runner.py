"""Sessions of the runner, on a site that answers at once."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from campaigns.teleop import records, teleop
from campaigns.teleop.design import SEED, Condition, Turn, plan_turns
from campaigns.teleop.metrics import Figures
from campaigns.teleop.records import Deployment, Load
from robotapp_testbed.failures import TestbedError

FIGURES = Figures(4.0, 5.0, 8.0, 9.0, missed_share=0.0, sent=160, answered=160)


class FakeSite:
    def set_condition(self, condition: Condition) -> None:
        """Stands for the change of links and ballast."""


class Rig:
    """What attempts do, by the number of their turn; all others go well."""

    def __init__(self) -> None:
        self.problems: dict[int, BaseException] = {}
        self.attempts: list[int] = []
        self.load = Load(0.1, busy_share=0.05, steal_share=0.0)

    @contextmanager
    def run_site(self) -> Iterator[FakeSite]:
        yield FakeSite()

    def attempt(self, _: FakeSite, turn: Turn, *, session: int) -> Any:
        rig = self

        class FakeAttempt:
            def run(self) -> Deployment:
                rig.attempts.append(turn.number)
                if turn.number in rig.problems:
                    raise rig.problems[turn.number]
                return Deployment(turn, session, "", node="edge-1", figures=FIGURES, load=rig.load)

        return FakeAttempt()


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    rig = Rig()
    handler = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(teleop, "run_site", rig.run_site)
    monkeypatch.setattr(teleop, "Attempt", rig.attempt)
    monkeypatch.setattr(teleop, "measure_load", lambda: rig.load)
    monkeypatch.setattr(teleop.prerequisites, "require", lambda: None)
    yield rig
    signal.signal(signal.SIGTERM, handler)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "eo2.jsonl"


def run(path: Path, *options: str) -> int:
    return teleop.main([f"--json={path}", *options])


def test_sessions_go_on_where_the_last_one_ended_until_all_is_there(
    rig: Rig, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(path, "--deployments=5") == 0
    assert run(path, "--deployments=2", "--resume") == 0
    assert rig.attempts == [1, 2, 3, 4, 5, 6, 7]
    assert capsys.readouterr().out == ""  # nothing is compared before the end
    assert run(path, "--resume", f"--plot={path.with_suffix('.svg')}") == 0
    results = records.read_file(path)
    assert [deployment.turn for deployment in results.valid] == plan_turns(SEED)
    assert [deployment.session for deployment in results.valid[4:8]] == [1, 2, 2, 3]
    assert "192 deployments, 64 complete blocks" in capsys.readouterr().out
    assert path.with_suffix(".svg").read_text().startswith("<svg")
    assert run(path, "--resume") == 0
    assert len(rig.attempts) == 192


@pytest.mark.parametrize(
    ("problem", "code", "reason"),
    [
        (KeyboardInterrupt("ended by SIGTERM"), 0, "ended by SIGTERM"),
        (KeyboardInterrupt(), 0, "the runner was interrupted"),
        (TestbedError("no API server"), 1, "no API server"),
        (ConnectionResetError("reset"), 1, "reset"),
    ],
)
def test_a_deployment_that_was_cut_is_void_and_repeated(
    rig: Rig, path: Path, problem: BaseException, code: int, reason: str
) -> None:
    rig.problems[3] = problem
    assert run(path) == code
    assert records.read_file(path).deployments[-1].void == reason
    rig.problems.clear()
    assert run(path, "--resume", "--deployments=1") == 0
    assert rig.attempts == [1, 2, 3, 3]
    assert [deployment.turn.number for deployment in records.read_file(path).valid] == [1, 2, 3]


def test_a_rig_on_which_a_deployment_is_void_again_and_again_is_not_fit(
    rig: Rig, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig.problems[1] = TestbedError("a node is not Ready")
    assert [run(path), run(path, "--resume"), run(path, "--resume"), run(path, "--resume")] == [1, 1, 1, 1]
    assert rig.attempts == [1, 1, 1]
    assert "mend the rig first" in capsys.readouterr().err


def test_no_deployment_begins_that_the_budget_may_not_suffice_for(rig: Rig, path: Path) -> None:
    assert run(path, "--budget-minutes=1") == 0
    assert rig.attempts == []


def test_a_machine_that_others_use_is_refused_or_its_results_are_marked(
    rig: Rig, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig.load = Load(3.0, busy_share=0.6, steal_share=0.0)
    assert run(path) == 1
    assert "others use 60% of the machine's CPU time" in capsys.readouterr().err
    assert run(path, "--resume", "--loaded", "--deployments=1") == 0
    assert [session.loaded for session in records.read_file(path).sessions] == [True]


def test_a_pilot_reports_what_it_has(rig: Rig, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    del rig
    assert run(path, "--pilot", "--deployments=3") == 0
    assert capsys.readouterr().out.startswith("PILOT: these deployments count for nothing.\nUNFINISHED: 3 of 192")
    assert run(path, "--analyse") == 0
    assert run(path, "--resume") == 1  # it is no part of the run that counts


def test_what_cannot_be_analysed_is_told(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(path, "--analyse") == 1
    assert "there is no file" in capsys.readouterr().err
