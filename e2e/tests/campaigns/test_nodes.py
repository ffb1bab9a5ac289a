"""What scripts/bench nodes holds against a run."""

import json
from pathlib import Path

import pytest

from campaigns.nodes import nodes, stability
from campaigns.nodes.nodes import Found, Kill, Life, main, summary, told, verdict

GOOD = Life(5.0, 2.0)
STRUCK = Kill(1.5, was_up=False, left={}, next_up_s=4.0)


def test_a_run_that_is_quick_and_leaves_nothing_is_fine() -> None:
    assert verdict([GOOD, GOOD], [STRUCK]) == []


def test_slowness_and_leftovers_are_problems() -> None:
    left = {"links": ["robotapp0"]}
    problems = verdict([Life(16.0, 2.0), Life(5.0, 6.0), Life(5.0, 2.0, left)], [Kill(1.0, True, left, 4.0)])
    assert problems == [
        "life 3: {'links': ['robotapp0']} stayed",
        "kill 1: {'links': ['robotapp0']} stayed",
        "life 1: up took 16.0 s",
        "life 2: down took 6.0 s",
    ]


def test_the_summary_tells_medians_and_how_many_kills_struck_a_start() -> None:
    lives = [Life(4.0, 1.0), Life(5.0, 2.0), Life(9.0, 3.0)]
    kills = [STRUCK, Kill(7.0, True, {}, 4.0)]
    assert summary(lives, kills) == (
        "3 lives: up 5.0 s (most 9.0), down 2.0 s (most 3.0); 2 kills, 1 of them during the start"
    )
    assert told(STRUCK) == "after 1.50 s while starting, left nothing, next up 4.0 s"


def test_a_run_without_lives_or_kills_has_a_summary_too() -> None:
    assert summary([], []) == "0 lives; 0 kills, 0 of them during the start"


@pytest.fixture
def minutes(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The bench without clusters; the minutes of apps it asked for."""
    asked: list[float] = []

    def stable(seconds: float) -> stability.Stable:
        asked.append(seconds / 60)
        return stability.Stable(seconds, 100_000, {}, ["app-1: it heard another app"])

    monkeypatch.setattr(nodes.prerequisites, "require", lambda: None)
    monkeypatch.setattr(nodes.parts, "prepare", lambda: None)
    monkeypatch.setattr(nodes, "live", lambda _: GOOD)
    monkeypatch.setattr(nodes, "kill", lambda *_: STRUCK)
    monkeypatch.setattr(nodes, "stable", stable)
    return asked


def test_the_long_run_has_ten_minutes_of_apps_which_can_fail_it(minutes: list[float], tmp_path: Path) -> None:
    assert main(["--long", "--json", str(tmp_path / "found.json")]) == 1
    assert minutes == [10]
    found = json.loads((tmp_path / "found.json").read_text())
    assert (len(found["lives"]), len(found["kills"])) == (20, 20)
    assert found["stable"]["problems"] == ["app-1: it heard another app"]


@pytest.mark.parametrize("options", [[], ["--long", "--stable-minutes", "0"]])
def test_the_apps_can_be_left_out(options: list[str], minutes: list[float]) -> None:
    assert main(options) == 0
    assert minutes == []


def test_the_apps_can_be_all_there_is(minutes: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--lives", "0", "--kills", "0", "--stable-minutes", "0.5"]) == 1
    assert minutes == [0.5]
    assert "app-1: it heard another app" in capsys.readouterr().err


@pytest.mark.usefixtures("minutes")
def test_what_a_cluster_is_made_from_is_made_before_the_first_life(monkeypatch: pytest.MonkeyPatch) -> None:
    done = []
    monkeypatch.setattr(nodes.parts, "prepare", lambda: done.append("prepared"))
    monkeypatch.setattr(nodes, "live", lambda _: done.append("life") or GOOD)
    assert main(["--lives", "1", "--kills", "0"]) == 0
    assert done == ["prepared", "life"]


def test_what_is_known_is_written_before_the_end(tmp_path: Path) -> None:
    Found([GOOD]).save(tmp_path / "found.json")
    assert json.loads((tmp_path / "found.json").read_text())["lives"][0]["up_s"] == 5.0


def test_progress_names_every_app() -> None:
    apps = {
        "app-0": {"answered": 1200, "missed": 3, "p99_us": 9400},
        "app-1": {"answered": 0, "missed": 0, "p99_us": None},
    }
    assert stability.progress(apps, 60.0, 600.0) == (
        "stable for 1.0 of 10 min: app-0 1200 answers, 3 late, p99 9 ms; app-1 0 answers, 0 late, p99 0 ms"
    )
