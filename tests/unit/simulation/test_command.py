"""The tools as a person starts them."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.support.scheduling import node_json, pod_json
from tests.unit.simulation import broken_plugin

from robotapp_scheduler import main as program
from robotapp_scheduler.simulation import bench_command, command


@pytest.fixture
def dump(tmp_path: Path) -> Path:
    path = tmp_path / "cluster.json"
    items = [{"kind": "Node", **node_json("n1")}, {"kind": "Pod", **pod_json("p")}]
    path.write_text(json.dumps({"kind": "List", "items": items}))
    return path


def run(*argv: Any, stdin: bytes = b"") -> tuple[int, str]:
    out = io.StringIO()
    status = command.main([str(part) for part in argv], stdin=io.BytesIO(stdin), out=out)
    return status, out.getvalue()


def test_a_table_or_json_comes_out(dump: Path) -> None:
    status, text = run(dump)
    assert (status, text.splitlines()[1].split()[:3]) == (0, ["default", "p", "n1"])
    status, text = run(dump, "--json")
    assert json.loads(text)["placements"][0]["node"] == "n1"


def test_several_files_and_standard_input_are_one_cluster(dump: Path) -> None:
    more = json.dumps({"kind": "Pod", **pod_json("q")}).encode()
    _, text = run(dump, "-", "--json", stdin=more)
    assert [each["name"] for each in json.loads(text)["placements"]] == ["p", "q"]


def test_where_no_pod_waits_a_sentence_says_so(tmp_path: Path) -> None:
    (tmp_path / "quiet.json").write_text(json.dumps({"kind": "Node", **node_json("n1")}))
    status, text = run(tmp_path / "quiet.json")
    assert status == 0
    assert text.startswith("No pod waits for this scheduler.\n\n0 of 0 pods placed on 1 nodes, configuration ")
    assert "NAMESPACE" not in text


def test_another_configuration_is_checked_and_used(dump: Path, tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    head = "apiVersion: kubescheduler.config.k8s.io/v1\nkind: KubeSchedulerConfiguration\n"
    config.write_text(head + "profiles: [{schedulerName: other}]\n")
    _, text = run(dump, "--config", config)
    assert "1 pods wait for scheduler ros-aware-scheduler" in text


def test_mistakes_end_with_2_and_a_sentence(dump: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text("typo: 1\n")
    assert run(dump, "--config", bad)[0] == 2
    assert 'unknown field "typo"' in capsys.readouterr().err
    assert run(bad)[0] == 2
    assert "-o json" in capsys.readouterr().err
    assert run(tmp_path / "none")[0] == 2
    assert "No such file" in capsys.readouterr().err


def test_a_pipe_whose_other_end_had_nothing_to_say_is_told_from_one_that_is_no_json(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("-", stdin=b"\n")[0] == 2
    assert capsys.readouterr().err.startswith("error: -: nothing in it; a dump is a List of Kubernetes objects")


@pytest.mark.parametrize("number", ["some", "-3", "1.5", "²", "9" * 5000])
def test_a_number_that_is_none_is_explained(dump: Path, number: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        run(dump, "--replay", number)
    assert "is not a number from 0 to 999999999" in capsys.readouterr().err


def test_more_than_allowed_is_not_read(dump: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(dump, "-", "--max-mib", "1", stdin=b" " * (1 << 20))[0] == 2
    assert "more than 1 MiB in all" in capsys.readouterr().err


def test_words_that_are_no_tool_start_the_scheduler() -> None:
    assert program.run_tool([]) is None
    assert program.run_tool(["--config", "x"]) is None


@pytest.mark.parametrize(
    ("output", "status", "said"),
    [("/dev/full", 2, "error: standard output: No space left on device\n"), ("nobody reads", 141, "")],
)
def test_output_that_nobody_takes_ends_a_tool_without_a_stack(dump: Path, output: str, status: int, said: str) -> None:
    argv = [sys.executable, "-m", "robotapp_scheduler", "simulate", str(dump)]
    if output == "/dev/full":
        target = os.open(output, os.O_WRONLY)
    else:
        reader, target = os.pipe()
        os.close(reader)
    with os.fdopen(target, "wb") as stdout:
        done = subprocess.run(argv, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (status, said)


def test_an_interrupted_tool_ends_without_a_stack(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "main", interrupted)
    monkeypatch.setattr(program, "_discard_output", lambda status: status)
    assert program.run_tool(["simulate", "-"]) == 130


def test_the_program_itself_simulates(dump: Path) -> None:
    argv = [sys.executable, "-m", "robotapp_scheduler", "simulate", str(dump)]
    done = subprocess.run(argv, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert "1 of 1 pods placed" in done.stdout


def bench(*argv: str) -> tuple[int, str]:
    out = io.StringIO()
    return bench_command.main([*argv, "--nodes", "20", "--pods", "10"], out=out), out.getvalue()


def test_a_third_party_plugin_is_measured_with_and_without_reuse() -> None:
    status, text = bench(
        "tests.support.scheduler.third_party_plugin:PreferQuietNodes", "--args", "{quiet: very}", "--json"
    )
    assert status == 0
    reused, fresh = json.loads(text)
    assert (reused["reuse"], fresh["reuse"]) == (True, False)
    for cost in (reused, fresh):
        assert 0 < cost["plugin_us"] < cost["cycle_us"]
        assert 0 < cost["share"] < 1
        assert cost["unplaced"] == 0


def test_the_table_names_nodes_load_and_share() -> None:
    status, text = bench("NodeResourcesFit")
    assert status == 0
    assert [line.split()[0] for line in text.splitlines()[2:4]] == ["20", "20"]
    assert "replicas, class reused" in text
    assert "%" in text


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["no.such.module:Plugin"], "cannot be loaded"),
        (["tests.support.scheduler.third_party_plugin:PreferQuietNodes", "--args", "{quiet: 3}"], "args"),
        (["tests.support.scheduler.third_party_plugin:PreferQuietNodes", "--args", "[1]"], "must be a mapping"),
        (["tests.support.scheduler.third_party_plugin:PreferQuietNodes", "--args", "[]"], "must be a mapping"),
        (["tests.support.scheduler.third_party_plugin:PreferQuietNodes", "--args", "{quiet"], "--args: "),
        (["tests.support.scheduler.broken_plugins:CannotStart"], "no route to the laboratory"),
        (["ROSQueueSort"], "orders the queue"),
    ],
)
def test_a_plugin_that_cannot_be_used_is_named(argv: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench(*argv)[0] == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "flag", ["--nodes=x", "--nodes=0", "--pods=0", "--pods=-4", "--weight=-1", "--weight=99999999999"]
)
def test_amounts_nobody_can_measure_are_refused(flag: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        bench_command.main(["NodeAffinity", flag])
    assert ended.value.code == 2
    assert " are 1 to " in capsys.readouterr().err


def test_a_plugin_that_raises_ends_with_1_and_says_what(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(broken_plugin.ScoresOfOne, "score", lambda *_: 1 / 0)
    assert bench("tests.unit.simulation.broken_plugin:ScoresOfOne")[0] == 1
    assert "plugin ScoresOfOne: score raised ZeroDivisionError" in capsys.readouterr().err


def test_a_plugin_that_answers_nonsense_ends_with_1_and_says_what(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench("tests.unit.simulation.broken_plugin:ScoresOfOne")[0] == 1
    assert "score must answer a number array of shape (20,)" in capsys.readouterr().err
