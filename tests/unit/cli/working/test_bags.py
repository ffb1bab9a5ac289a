"""`bags`: list, info and pull, through a kubectl that runs the recorder's own program on this machine."""

import os
import stat
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.support.bags import CHATTER, TOPIC, read_numbers, serialize
from tests.unit.cli.running import ROBOTAPPS, Stage, pod, robotapp

from robotapp_recorder.store import BagStore, Limits

RECORDINGS = [{"name": "all", "topics": {"regex": ".*"}}]
KUBECTL = """\
#!{python}
import subprocess, sys
words = sys.argv[sys.argv.index("--") + 1 :]
if words[0] == "python3":
    words[0] = {python!r}
words = [word.replace("/bags/teleop/amr-07/all", {folder!r}) for word in words]
sys.exit(subprocess.run(words, check=False).returncode)
"""


@pytest.fixture
def recorded(stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a recording with two closed bags and an open one, and an app whose recorder runs."""
    folder = tmp_path / "recorded"
    store = BagStore(folder, "all", Limits(1 << 20, 8 << 20))
    store.open()
    store.add_channel(CHATTER)
    for number in range(3):
        store.add_message(TOPIC, serialize(number), published_ns=0)
        if number < 2:
            store.close()
    store.abandon()
    write_kubectl(tmp_path / "bin", KUBECTL.format(python=sys.executable, folder=str(folder)), monkeypatch)
    add_app(stage)
    return folder


def write_kubectl(folder: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.mkdir()
    program = folder / "kubectl"
    program.write_text(text)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


def add_app(stage: Stage, **spec: Any) -> None:
    stage.add(ROBOTAPPS, robotapp(recordings=RECORDINGS, **spec))
    stage.add("/pods", pod("recorder", "all", node="edge-1", phase="Running"))


def test_bags_are_listed_with_size_and_state(stage: Stage, recorded: Path) -> None:
    rows = stage.data("bags", "list", "teleop")
    assert [(row["robot"], row["recording"], row["state"]) for row in rows] == [
        ("amr-07", "all", "closed"),
        ("amr-07", "all", "closed"),
        ("amr-07", "all", "open"),
    ]
    assert [row["bytes"] for row in rows] == [path.stat().st_size for path in sorted(recorded.iterdir())]
    assert "all-000003-" in stage.text("bags", "list", "teleop", "all", "--robot", "amr-07")
    assert "all-000003-" in stage.text("-n", "fleet", "bags", "list", "teleop")


def test_a_closed_bag_shows_its_topics_and_an_open_one_says_why_not(stage: Stage, recorded: Path) -> None:
    first, *_, last = sorted(path.name for path in recorded.iterdir())
    assert f"{TOPIC}  " in stage.text("bags", "info", "teleop", first)
    refused = stage.run("bags", "info", "teleop", last)
    assert refused.exit_code == 1
    assert "is being written" in refused.output


def test_all_closed_bags_are_pulled_and_nothing_is_overwritten(stage: Stage, recorded: Path, tmp_path: Path) -> None:
    target = tmp_path / "here"
    stage.text("bags", "pull", "teleop", "--to", str(target))
    paths = sorted((target / "amr-07").iterdir())
    assert [path.name for path in paths] == sorted(path.name for path in recorded.glob("*.mcap"))
    assert [read_numbers(path) for path in paths] == [[0], [1]]
    assert stage.text("bags", "pull", "teleop", "--to", str(target)).count("is there already") == 2


def test_a_bag_that_arrives_in_part_leaves_no_file(
    stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = '[{"name": "all-000001-x.mcap", "bytes": 99, "state": "closed"}]'
    write_kubectl(tmp_path / "bin", f"#!/bin/sh\necho '{answer}'\n", monkeypatch)
    add_app(stage)
    failed = stage.run("bags", "pull", "teleop", "--to", str(tmp_path / "here"))
    assert failed.exit_code == 1
    assert "of 99 bytes arrived" in failed.output
    assert list((tmp_path / "here" / "amr-07").iterdir()) == []


def test_the_reason_of_kubectl_is_not_hidden_by_its_address(
    stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = f"https://edge-1:10250/exec/{'x' * 400}"
    script = f"#!/bin/sh\necho 'error: sending request: Post \"{address}\": dial tcp: no such host' >&2\nexit 1\n"
    write_kubectl(tmp_path / "bin", script, monkeypatch)
    add_app(stage)
    output = " ".join(stage.run("bags", "list", "teleop").output.split())
    assert "error: sending request: Post dial tcp: no such host; kubectl exec has to reach it" in output
    assert "10250" not in output


def test_a_folder_that_cannot_be_made_is_named_with_the_option(
    stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = '[{"name": "all-000001-x.mcap", "bytes": 99, "state": "closed"}]'
    write_kubectl(tmp_path / "bin", f"#!/bin/sh\necho '{answer}'\n", monkeypatch)
    add_app(stage)
    (tmp_path / "file").write_text("in the way")
    failed = stage.run("bags", "pull", "teleop", "--to", str(tmp_path / "file"))
    assert failed.exit_code == 2
    assert "cannot be written: Not a directory; give another folder as --to" in " ".join(failed.output.split())


@pytest.mark.parametrize(
    ("answer", "error"),
    [
        ('[{"name": "../../etc/passwd", "bytes": 1, "state": "closed"}]', "a name that no recorder gives"),
        ('[{"name": "a.mcap"}]', "something else than a list of bags"),
        ("{", "something else than JSON"),
    ],
)
def test_what_no_recorder_answers_is_refused(
    stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str, error: str
) -> None:
    write_kubectl(tmp_path / "bin", f"#!/bin/sh\necho '{answer}'\n", monkeypatch)
    add_app(stage)
    failed = stage.run("bags", "pull", "teleop", "--to", str(tmp_path))
    assert (failed.exit_code, error in failed.output) == (1, True)


def test_an_app_without_recordings_or_without_a_running_recorder_is_told_what_to_do(stage: Stage) -> None:
    stage.add(ROBOTAPPS, robotapp())
    assert "write spec.recordings" in stage.run("bags", "list", "teleop").output
    stage.add(ROBOTAPPS, robotapp(recordings=RECORDINGS))
    assert "no recorder of teleop is running" in stage.run("bags", "list", "teleop").output
