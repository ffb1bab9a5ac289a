"""Sequences: their steps, a run against a cluster in memory, and the comparison of what runs left."""

import io
import json
import tarfile
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.rigel.rigelfiles import ONE
from tests.unit.bridge.fake_cluster import app
from tests.unit.bridge.sequence_world import LIST, THREE, WISHES, SequenceCluster, read

from rigel_bridge.cluster.deployment import deploy
from rigel_bridge.cluster.kubectl import ClusterError
from rigel_bridge.cluster.results import opened
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.document.failures import BridgeError
from rigel_bridge.main import main
from rigel_bridge.sequences.comparison import table
from rigel_bridge.sequences.lease import RUN, RUN_ID
from rigel_bridge.sequences.run import Tools, annotated, read_summaries, renamed, run
from rigel_bridge.sequences.steps import Kind, actions, refuse_thesis, run_name
from rigel_bridge.verbs import sequences as verb

THESIS = (
    "application: {distro: humble}\n"
    + WISHES.replace("{name: teleop,", "{application_image: 'a/b:1', name: teleop,")
    + THREE
)
JOBS = """\
application: {distro: humble}
jobs:
  build: {plugin: rigel.plugins.core.BuildXPlugin, with: {image: acme/teleop}}
  test: {plugin: rigel.plugins.core.TestPlugin, with: {}}
  deploy: {plugin: rigel_bridge.RobotAppPlugin, with: {name: teleop, orchestration: {}}}
sequences:
  demo: {stages: [{jobs: [{name: build, with: {load: true}}, deploy, test]}]}
"""

EXAMPLE = Path(__file__).resolve().parents[4] / "examples" / "rigel" / "benchmark" / "Rigelfile"


def stepped(text: str, sequence: str = "demo") -> list[tuple[Kind, tuple[tuple[str, ...], ...]]]:
    return [(each.kind, each.commands) for each in actions(read(text, sequence).rigelfile, sequence)]


def test_rigel_does_its_jobs_and_the_bridge_deploys() -> None:
    assert stepped(LIST) == [(Kind.RIGEL, (("create",), ("build", "--push"))), (Kind.DEPLOY, ())]
    assert stepped(JOBS) == [
        (Kind.RIGEL, (("run", "job", "build"),)),
        (Kind.DEPLOY, ()),
        (Kind.RIGEL, (("run", "job", "test"),)),
    ]


def test_an_override_that_rigel_would_not_get_is_told() -> None:
    (build, *_) = actions(read(JOBS, "demo").rigelfile, "demo")
    assert "load of job build is not passed on" in build.note
    (build, *_) = actions(read(LIST, "demo").rigelfile, "demo")
    assert build.note == "", "the scheduler's name is meant for the deployment"


def test_the_thesis_file_cannot_be_built_by_rigel_and_the_message_shows_the_way() -> None:
    found = read(THESIS, "demo").rigelfile
    with pytest.raises(BridgeError, match="--no-build"):
        refuse_thesis(found, actions(found, "demo"))
    refuse_thesis(found, actions(found, "demo")[1:])


def test_a_run_builds_deploys_works_collects_and_cleans_up(tmp_path: Path) -> None:
    world = SequenceCluster()
    world.run(LIST, "benchmark_default", tmp_path)
    world.run(LIST, "benchmark_custom", tmp_path)
    assert world.built == [("create",), ("build", "--push")] * 2
    assert world.slept.count(30) == 2
    assert world.cluster.objects == {}, "nothing is left"
    runs = read_summaries(tmp_path)
    assert {each["scheduler"] for each in runs} == {"default-scheduler", "kubernetes-scheduler"}
    assert {each["app"] for each in runs} == {"teleop-benchmark-default", "teleop-benchmark-custom"}
    assert {each["outcome"] for each in runs} == {"ran"}
    assert "| scheduler | kubernetes-scheduler | default-scheduler |" in table(runs)


def test_what_fails_leaves_its_results_and_nothing_in_the_cluster(tmp_path: Path) -> None:
    world = SequenceCluster(ready=False)
    with pytest.raises(ClusterError, match="is not Ready within 5 s"):
        world.run(LIST, "demo", tmp_path)
    assert world.apps() == []
    assert [each["outcome"] for each in read_summaries(tmp_path)] == ["failed"]


@pytest.mark.parametrize("where", ["build", "apply", "sleep", "get"])
def test_ctrl_c_at_any_time_leaves_nothing_in_the_cluster(where: str, tmp_path: Path) -> None:
    world = SequenceCluster()
    interrupted: list[str] = []

    def once(name: str) -> None:
        if name == where and not interrupted and (where != "get" or world.apps()):
            interrupted.append(name)
            raise KeyboardInterrupt

    operate = world.cluster.before

    def before(call: tuple[str, ...]) -> None:
        operate(call)
        once(call[0])

    world.cluster.before = before
    tools = world.tools()
    clock = Clock(now_s=tools.clock.now_s, sleep=lambda _: once("sleep"))
    tools = Tools(world.cluster, lambda _: once("build"), str, clock, tools.limits)
    found = read(LIST, "demo")
    with pytest.raises(KeyboardInterrupt):
        run("demo", actions(found.rigelfile, "demo"), found, tools, opened(tmp_path / "r"))
    assert world.cluster.objects == {}


def test_an_app_in_use_is_never_touched_and_the_rest_of_a_killed_run_is_cleared(tmp_path: Path) -> None:
    world = SequenceCluster()
    deploy(world.cluster, app("teleop"), tell=str)
    deploy(world.cluster, app("teleop-demo"), tell=str)
    with pytest.raises(ClusterError, match="teleop-demo is there and of no earlier run"):
        world.run(LIST, "demo", tmp_path / "a")
    assert world.apps() == ["teleop", "teleop-demo"]
    world.cluster.objects["robotapps", "teleop-demo"]["metadata"]["annotations"] = {RUN: "demo"}
    world.run(LIST, "demo", tmp_path / "b")
    assert world.apps() == ["teleop"]


@pytest.mark.parametrize("moment", ["working", "waiting"])
def test_a_run_that_another_one_replaced_is_no_success_and_leaves_that_one_alone(moment: str, tmp_path: Path) -> None:
    """Two people run one sequence: the second removes the app of the first as the rest of an earlier run, and brings its own."""
    world = SequenceCluster()
    operate, other = world.cluster.before, annotated(renamed(app("teleop"), "demo"), {RUN: "demo", RUN_ID: "theirs"})

    def replaced(call: tuple[str, ...]) -> None:
        operate(call)
        present = world.cluster.objects.get(("robotapps", "teleop-demo"))
        if present and moment == "waiting" and call[0] == "get":
            world.cluster.objects["robotapps", "teleop-demo"] = {
                **present,
                "metadata": {**present["metadata"], **other["metadata"]},
            }

    world.cluster.before = replaced
    tools = world.tools(run_id="ours")

    passing = tools.clock

    def sleep(seconds: float) -> None:
        passing.sleep(seconds)
        if seconds == 30:
            world.cluster.objects["robotapps", "teleop-demo"]["metadata"] |= other["metadata"]

    tools = replace(tools, clock=Clock(now_s=passing.now_s, sleep=sleep)) if moment == "working" else tools
    found = read(LIST, "demo")
    with pytest.raises(ClusterError, match="is of another run by now"):
        run("demo", actions(found.rigelfile, "demo"), found, tools, opened(tmp_path / "r"))
    assert world.apps() == ["teleop-demo"], "it is theirs"
    (left,) = read_summaries(tmp_path)
    assert left["outcome"] == "failed"
    assert "components" not in left, "their figures are not ours"


def test_an_app_can_be_kept(tmp_path: Path) -> None:
    world = SequenceCluster()
    world.run(LIST, "demo", tmp_path, keep=True)
    assert world.apps() == ["teleop-demo"]


@given(
    st.text("abc-", min_size=1, max_size=40).filter(lambda text: text.strip("-")),
    st.text("xyz_", min_size=1, max_size=60),
)
def test_a_run_has_a_name_that_fits(name: str, sequence: str) -> None:
    assert len(run_name(name, sequence)) <= 40


def test_what_a_container_leaves_is_no_summary_and_ends_no_run(tmp_path: Path) -> None:
    world = SequenceCluster()
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w") as made:
        for name in ("summary.json", "x.csv/summary.json", "deeper/summary.json"):
            forged = json.dumps({"sequence": "forged", "outcome": "ran"}).encode()
            info = tarfile.TarInfo(name)
            info.size = len(forged)
            made.addfile(info, io.BytesIO(forged))
    labels = {"robotics.io/app-uid": "uid-teleop-files", "robotics.io/component": "ui"}
    world.cluster.objects["pods", "p"] = {
        "metadata": {"name": "p", "labels": labels},
        "spec": {"containers": []},
        "status": {"conditions": [{"type": "Ready", "status": "True"}]},
    }
    world.cluster.contents = {("exec", "p"): content.getvalue()}
    operate = world.cluster.before

    def before(call: tuple[str, ...]) -> None:
        operate(call)
        if call[:2] == ("delete", "robotapps.robotics.io"):
            world.cluster.objects.pop(("pods", "p"), None)

    world.cluster.before = before
    world.run(
        LIST.replace("{name: teleop,", "{name: teleop, results: {source_path: /r},").replace("demo", "files"),
        "files",
        tmp_path,
    )
    assert (tmp_path / "files" / "files" / "ui" / "x.csv" / "summary.json").is_file()
    assert [(each["sequence"], each["outcome"]) for each in read_summaries(tmp_path)] == [("files", "ran")]


@pytest.mark.parametrize(
    "text",
    [
        '{"sequence": "s", "components": 5}',
        '{"sequence": "s", "edges": [{}]}',
        '{"sequence": "s", "samples": {"x": 1}}',
        '{"sequence": 1}',
        "[" * 100_000,
    ],
)
def test_a_file_that_is_no_summary_is_passed_over(text: str, tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(text)
    assert read_summaries(tmp_path) == []


def test_names_of_columns_do_nothing_to_the_terminal_or_the_table() -> None:
    text = table([{"sequence": "a|b", "samples": {"\x1b[2J\n_ms": {"count": 1}}}])
    assert text.replace("\n", "").isprintable()
    assert "| \\u001b[2J\\u000a_ms count | 1 |\n" in text
    assert "|  | a\\|b |\n" in text


def test_runs_stand_side_by_side_with_what_each_of_them_has() -> None:
    edge = {"topic": "/cmd_vel", "p95": "60ms", "budget": "30ms", "met": False}
    first = {"sequence": "a", "components": [{"name": "driver", "node": "n1"}], "edges": [edge], "ready_after_s": 1.234}
    second = {"sequence": "b", "samples": {"x.csv rtt_ms": {"p95": 2.5}}}
    text = table([first, second])
    for row in (
        "|  | a | b |",
        "| node of driver | n1 | - |",
        "| p95 of /cmd_vel | 60ms of 30ms (over) | - |",
        "| Ready after (s) | 1.23 | - |",
        "| x.csv rtt_ms p95 | - | 2.5 |",
    ):
        assert f"{row}\n" in text


def test_rigel_that_is_missing_or_fails_ends_the_run_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(BridgeError, match=r"no-such-rigel is not an installed program.*--no-build") as caught:
        verb.run_rigel(["build"], folder=tmp_path, timeout_s=5, program="no-such-rigel")
    assert caught.value.code == 77
    with pytest.raises(BridgeError, match="`false build` ended with 1"):
        verb.run_rigel(["build"], folder=tmp_path, timeout_s=5, program="false")


def test_the_command_lists_runs_and_compares(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("Rigelfile").write_text(LIST)
    assert main(["sequences"]) == 0
    assert "benchmark_default: build -> deploy\n" in capsys.readouterr().out
    assert main(["sequences", "--run", "demoo"]) == 72
    assert "did you mean demo" in capsys.readouterr().err
    world = SequenceCluster()
    monkeypatch.setattr(verb, "kubectl_of", lambda _: world.cluster)
    monkeypatch.setattr(verb, "Clock", lambda: world.tools().clock)
    wanted = ["--run", "benchmark_default", "benchmark_custom", "--no-build", "--duration", "0"]
    assert main(["sequences", *wanted, "--results", "r"]) == 0
    assert "|  | benchmark_custom | benchmark_default |" in capsys.readouterr().out
    assert main(["sequences", "--compare", "r"]) == 0
    assert main(["sequences", "--compare", "nothing-here"]) == 77


def test_a_file_without_sequences_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("Rigelfile").write_text(ONE)
    assert main(["sequences"]) == 0
    assert capsys.readouterr().err.startswith("Rigelfile: has no sequences; ")


def test_the_shipped_benchmark_builds_once_and_runs_under_both_schedulers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    world = SequenceCluster()
    monkeypatch.setattr(verb, "kubectl_of", lambda _: world.cluster)
    monkeypatch.setattr(verb, "Clock", lambda: world.tools().clock)
    monkeypatch.setattr(verb, "run_rigel", lambda words, **_: world.built.append(tuple(words)))
    wanted = ["--run", "benchmark_default", "benchmark_custom", "--duration", "0", "--results", str(tmp_path / "r")]
    assert main(["sequences", str(EXAMPLE), *wanted]) == 0
    assert world.built == [("run", "job", "dockerfile"), ("run", "job", "build")]
    assert world.cluster.objects == {}
    assert "| scheduler | kubernetes-scheduler | default-scheduler |" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["../evil", "/evil", "..", "a/../../evil", "a\\e[2Jb"])
def test_results_of_a_sequence_with_any_name_stay_in_their_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("Rigelfile").write_text(LIST.replace("  demo:", f'  "{name}":'))
    world = SequenceCluster()
    monkeypatch.setattr(verb, "kubectl_of", lambda _: world.cluster)
    assert main(["sequences", "--run", name.replace("\\e", "\x1b"), "--no-build", "--results", "deep/r"]) == 72
    assert "is no name for a folder of results" in capsys.readouterr().err
    assert world.cluster.calls == []
    assert [each.name for each in tmp_path.iterdir()] == ["Rigelfile"]


def test_a_job_is_never_a_flag_of_rigel() -> None:
    found = read(JOBS.replace("build", "--help"), "demo").rigelfile
    with pytest.raises(BridgeError, match="'--help' would be a flag"):
        actions(found, "demo")


def test_ctrl_c_is_one_word_and_code_130(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(verb, "objects", interrupted)
    assert main(["sequences"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_notes_end_a_run_before_it_begins_when_it_is_strict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("Rigelfile").write_text(LIST.replace("{name: teleop,", "{name: teleop, namespace: lab,"))
    world = SequenceCluster()
    monkeypatch.setattr(verb, "kubectl_of", lambda _: world.cluster)
    assert main(["sequences", "--run", "demo", "--no-build", "--strict"]) == 72
    assert "has notes, and --strict allows none" in capsys.readouterr().err
    assert world.cluster.calls == []
    with pytest.raises(SystemExit):
        main(["sequences", "--sequence", "demo"])
