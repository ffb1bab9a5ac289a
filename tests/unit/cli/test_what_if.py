"""what-if: what is asked, and the difference as tables."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.unit.cli.running import Json, Stage

from robotapp_cli.commands import what_if

MOVED = {
    "namespace": "fleet",
    "pod": "teleop-ui-1",
    "app": "teleop",
    "component": "ui",
    "instance": "amr-07",
    "outcome": "Moves",
    "from": "edge-1",
    "to": "edge-2",
    "code": "",
    "reason": "best of 2 feasible nodes, score 454",
}
PENDING = {**MOVED, "pod": "big", "app": "", "component": "", "instance": "", "outcome": "Pending", "to": "",
           "code": "Unschedulable", "reason": "0/2 nodes are available: 2 Insufficient cpu."}  # fmt: skip
MET = {"rttMs": 8.0, "source": "measured", "verdict": "Met"}
EXCEEDED = {"rttMs": 40.5, "source": "estimated", "verdict": "Exceeded"}
CUT = {"rttMs": None, "source": "measured", "verdict": "Exceeded"}
EDGE = {
    "namespace": "fleet",
    "app": "teleop",
    "instance": "amr-07",
    "edge": "/cmd_vel",
    "from": "ui",
    "to": "driver",
    "budgetMs": 30.0,
    "percentile": 95,
    "before": MET,
    "after": EXCEEDED,
}
ANSWER: Json = {
    "pods": [MOVED, PENDING],
    "edges": [EDGE, {**EDGE, "edge": "/odom", "before": None, "after": CUT}],
    "edgesUnchanged": 7,
    "hidden": {"pods": 3, "edges": 1},
    "notes": ["not tried: time"],
    "decidedMs": 12.5,
}
APP = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "metadata": {"name": "teleop"},
       "spec": {"ros": {"distro": "jazzy"}, "components": [{"name": "driver", "image": "registry.example/driver:1"}]}}  # fmt: skip


@pytest.fixture
def cluster(stage: Stage) -> Stage:
    stage.scheduler.outcome = ANSWER
    return stage


def url(stage: Stage) -> tuple[str, str]:
    return "--scheduler-url", stage.scheduler.tls_url


def sent(stage: Stage) -> Json:
    (found,) = stage.scheduler.posted
    body: Json = json.loads(found)
    return body


def test_pods_and_edges_are_shown_with_before_and_after(cluster: Stage) -> None:
    lines = cluster.text("what-if", "--node-loss", "edge-1", *url(cluster), COLUMNS="250").splitlines()
    assert lines[0].split() == ["NAMESPACE", "APP", "INSTANCE", "COMPONENT", "POD", "WHAT", "FROM", "TO", "WHY"]
    assert lines[1].split()[:8] == ["fleet", "teleop", "amr-07", "ui", "teleop-ui-1", "Moves", "edge-1", "edge-2"]
    assert lines[2].split()[:8] == ["fleet", "-", "-", "-", "big", "Pending", "edge-1", "-"]
    assert "Insufficient cpu" in lines[2]
    assert lines[4].split() == ["NAMESPACE", "APP", "INSTANCE", "EDGE", "BUDGET", "BEFORE", "AFTER"]
    assert "30ms p95" in lines[5]
    assert lines[5].endswith("Met (8ms)   Exceeded (40.5ms, estimated)")
    assert lines[6].endswith("Exceeded (no answer)")
    assert lines[8:] == [
        "7 more edges were looked at: their verdict stays",
        "3 pods and 1 edges of other namespaces would change, too",
        "not tried: time",
        "Nothing was changed.",
    ]


def test_where_nothing_changes_that_is_said_and_json_is_the_answer(cluster: Stage) -> None:
    assert cluster.data("what-if", "--node-loss", "edge-1", *url(cluster)) == ANSWER
    cluster.scheduler.outcome = {**ANSWER, "pods": [], "edges": [], "hidden": {"pods": 0, "edges": 0}}
    text = cluster.text("what-if", "--node-loss", "edge-1", *url(cluster))
    assert text.startswith("No pod would move.\n\nNo edge would get another verdict.\n")
    assert "\n7 edges were looked at: their verdict stays\n" in text
    assert "other namespaces" not in text


def test_everything_is_asked_at_once_for_the_users_namespace(cluster: Stage, tmp_path: Path) -> None:
    app, config = tmp_path / "app.yaml", tmp_path / "config.yaml"
    others = {"kind": "ConfigMap", "metadata": {"name": "x"}}
    stored = {**APP, "metadata": {"name": "there", "namespace": "other"}, "status": {"phase": "Running"}}
    app.write_text(yaml.safe_dump_all([APP, others, {"kind": "List", "items": [stored]}]))
    config.write_text("{kind: KubeSchedulerConfiguration}")
    cluster.text("what-if", "--node-loss", "e1", "--node-loss", "e2", "--rtt", "e1:e2=1m30s", "--app", str(app),
                 "--config", str(config), *url(cluster))  # fmt: skip
    assert sent(cluster) == {
        "nodeLoss": ["e1", "e2"],
        "rtt": [{"one": "e1", "other": "e2", "rtt": "1m30s"}],
        "apps": [
            {**APP, "metadata": {"name": "teleop", "namespace": "fleet"}},
            {**APP, "metadata": {"name": "there", "namespace": "other"}},
        ],
        "config": {"kind": "KubeSchedulerConfiguration"},
    }
    assert cluster.scheduler.queries == ["namespace=fleet"]


def test_a_replay_asks_for_placements_under_a_configuration_and_says_how_many_were_judged(
    cluster: Stage, tmp_path: Path
) -> None:
    config = tmp_path / "config.yaml"
    config.write_text("{kind: KubeSchedulerConfiguration}")
    cluster.scheduler.outcome = {**ANSWER, "pods": [], "edges": [], "replayed": 42}
    text = cluster.text("what-if", "--replay", "200", "--config", str(config), *url(cluster))
    asked = {"nodeLoss": [], "rtt": [], "apps": [], "config": {"kind": "KubeSchedulerConfiguration"}, "replay": 200}
    assert sent(cluster) == asked
    assert text.startswith("No pod would sit elsewhere.\n")
    assert "42 placements were judged, each as if that pod alone was not placed\n" in text


def test_a_replay_supposes_a_configuration_and_nothing_else(cluster: Stage, tmp_path: Path) -> None:
    config = tmp_path / "config.yaml"
    config.write_text("{kind: KubeSchedulerConfiguration}")
    done = cluster.run("what-if", "--replay", "5", "--config", str(config), "--node-loss", "e1", *url(cluster))
    assert (done.exit_code, "leave --node-loss, --rtt and --app out" in done.stderr) == (2, True), done.stderr
    assert cluster.scheduler.posted == []


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--replay", "5"), "--replay 5: give --config FILE, the configuration to judge them with"),
        (("--replay", "501"), "Input should be less than or equal to 500"),
        ((), "nothing is supposed: give --node-loss, --rtt, --app or --config"),
        (("--rtt", "a:b"), "--rtt a:b: write a pair of nodes and its round-trip time, such as edge-1:amr-07=40ms"),
        (("--rtt", "a=40ms"), "write a pair of nodes"),
        (("--rtt", "a:a=40ms"), "the two nodes are one"),
        (("--rtt", "a:b=40"), "--rtt a:b=40: '40' is not a duration; write for example 250us, 30ms"),
        (("--rtt", "a:B/=40ms"), "'B/' is no name of a node"),
        (("--node-loss", "-"), "'-' is no name of a node"),
        (("--app", "/nowhere.yaml"), "/nowhere.yaml cannot be read"),
    ],
)
def test_wrong_usage_is_a_sentence_and_nobody_is_asked(cluster: Stage, arguments: tuple[str, ...], text: str) -> None:
    done = cluster.run("what-if", *arguments, *url(cluster))
    assert (done.exit_code, text in done.stderr) == (2, True), done.stderr
    assert cluster.scheduler.posted == []


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("{kind: Pod, metadata: {name: x}}", "holds no RobotApp of robotics.io/v1alpha1, but Pod"),
        ("", "holds no RobotApp of robotics.io/v1alpha1, but nothing"),
        ("{kind: List, items: 5}", "holds something that is no Kubernetes object"),
        ("{kind: List, items: []}", "holds no RobotApp of robotics.io/v1alpha1, but nothing"),
        ("[{kind: RobotApp}]", "holds something that is no Kubernetes object"),
        ("{kind: RobotApp}", "holds a RobotApp without metadata.name"),
        ("# " + "x" * (1 << 20), "larger than 1 MiB"),
    ],
)
def test_a_file_that_is_no_app_is_named_with_what_it_holds(
    cluster: Stage, tmp_path: Path, content: str, text: str
) -> None:
    (tmp_path / "app.yaml").write_text(content)
    done = cluster.run("what-if", "--app", str(tmp_path / "app.yaml"), *url(cluster))
    assert (done.exit_code, text in done.stderr) == (2, True), done.stderr


def test_an_app_that_could_not_be_applied_is_refused_with_the_words_of_lint(cluster: Stage, tmp_path: Path) -> None:
    driver = {"name": "driver", "image": "registry.example/driver:1"}
    app = {**APP, "spec": {**APP["spec"], "components": [{**driver, "replicas": -1, "comand": []}, driver]}}
    (tmp_path / "app.yaml").write_text(yaml.safe_dump(app))
    done = cluster.run("what-if", "--app", str(tmp_path / "app.yaml"), *url(cluster))
    assert done.exit_code == 1
    first, *lines = done.stderr.splitlines()
    assert first.startswith(
        f"error: --app {tmp_path}/app.yaml: RobotApp teleop would be refused; kubectl robotapp lint "
    )
    assert [line.partition(":")[0].strip() for line in lines] == [
        "spec.components[0].comand",
        "spec.components[0].replicas",
        "spec.components[1]",
    ]
    assert cluster.scheduler.posted == []


def test_of_many_mistakes_the_first_are_shown(cluster: Stage, tmp_path: Path) -> None:
    unnamed = [{"image": "registry.example/driver:1"}] * 9
    (tmp_path / "app.yaml").write_text(yaml.safe_dump({**APP, "spec": {**APP["spec"], "components": unnamed}}))
    done = cluster.run("what-if", "--app", str(tmp_path / "app.yaml"), *url(cluster))
    assert (done.exit_code, len(done.stderr.splitlines())) == (1, 7), done.stderr
    assert done.stderr.splitlines()[-1].startswith("  and ")


def test_a_scheduler_that_is_busy_is_asked_again(cluster: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(what_if, "_TURN_S", 0.0)
    cluster.scheduler.busy = 2
    assert "edge-2" in cluster.text("what-if", "--node-loss", "edge-1", *url(cluster))
    assert len(cluster.scheduler.posted) == 3


def test_a_scheduler_that_stays_busy_is_left_alone_in_the_end(cluster: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(what_if, "_MOST_TURN_S", 0.0)
    cluster.scheduler.busy = 9
    done = cluster.run("what-if", "--node-loss", "edge-1", *url(cluster))
    assert (done.exit_code, "the scheduler refuses: who are you (429)" in done.stderr) == (1, True), done.stderr


@pytest.mark.parametrize(("status", "code"), [(400, 2), (422, 4), (403, 1), (500, 1)])
def test_a_refusal_of_the_scheduler_ends_with_the_code_of_its_kind(cluster: Stage, status: int, code: int) -> None:
    cluster.scheduler.status = status
    cluster.scheduler.refusal = {"error": "there is no node 'e9'", "problems": ["really"]}
    done = cluster.run("what-if", "--node-loss", "e9", *url(cluster))
    assert (done.exit_code, "there is no node 'e9'; really" in done.stderr) == (code, True), done.stderr


def test_a_refusal_without_a_reason_still_is_a_sentence(cluster: Stage) -> None:
    cluster.scheduler.status, cluster.scheduler.refusal = 400, {"detail": "?"}
    done = cluster.run("what-if", "--node-loss", "e9", *url(cluster))
    assert (done.exit_code, "answers 400" in done.stderr) == (2, True), done.stderr


def test_times_of_any_length_are_shown(cluster: Stage) -> None:
    long = {**EDGE, "budgetMs": 1.08e9, "after": {**EXCEEDED, "rttMs": 1.08e9}}
    cluster.scheduler.outcome = {**ANSWER, "edges": [long]}
    text = cluster.text("what-if", "--rtt", "edge-1:amr-07=300h", *url(cluster), COLUMNS="250")
    assert "999999s p95" in text
    assert "Exceeded (999999s, estimated)" in text


def test_help_has_examples(stage: Stage) -> None:
    text: Any = stage.text("what-if", "--help")
    assert "kubectl robotapp what-if --node-loss edge-1" in text
    assert "--rtt edge-1:amr-07=40ms" in " ".join(text.split())
