"""The commands that reach the cluster: what they print, and their exit codes."""

import argparse
import io
import json
from pathlib import Path
from typing import Any

import pytest
from tests.support.rigel.rigelfiles import ONE, orchestration
from tests.unit.bridge.fake_cluster import FakeCluster

from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal
from rigel_bridge.main import main
from rigel_bridge.verbs import lifecycle, status
from rigel_bridge.verbs.cluster_options import kubectl_of, seconds

STORAGE = "persistent_storage: {volumes: [{name: logs, size: 1Gi, storage_class: fast, mount_path: /logs}]}"


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeCluster:
    """Behind every command, in a folder with a Rigelfile of the app `teleop`."""
    made = FakeCluster()
    for module in (lifecycle, status):
        monkeypatch.setattr(module, "kubectl_of", lambda _: made)
    monkeypatch.chdir(tmp_path)
    Path("Rigelfile").write_text(orchestration("{name: teleop}"))
    return made


def conditioned(cluster: FakeCluster, **states: str) -> None:
    stored = cluster.objects["robotapps", "teleop"]
    conditions = [
        {"type": kind, "status": state, "reason": "Why", "message": "words\x1b[2J", "observedGeneration": 9}
        for kind, state in states.items()
    ]
    stored["status"] = {"phase": "Running", "summary": {"ready": "1/1"}, "conditions": conditions}


def test_apply_and_diff_tell_what_changed(cluster: FakeCluster, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diff"]) == 1
    assert main(["apply"]) == 0
    assert main(["diff"]) == 0
    capsys.readouterr()
    Path("Rigelfile").write_text(orchestration("{name: teleop}", ONE.replace(":1", ":2")))
    assert main(["diff"]) == 1
    assert "-  image: acme/driver:1\n+  image: acme/driver:2\n" in capsys.readouterr().out
    assert main(["apply"]) == 0
    assert capsys.readouterr().out == (
        "robotapp/teleop in namespace fleet: changed\n  spec.components[0].image: acme/driver:1 -> acme/driver:2\n"
    )
    assert ("robotapps", "teleop") in cluster.objects


def test_apply_waits_and_ends_with_75_when_the_app_is_refused(
    cluster: FakeCluster, capsys: pytest.CaptureFixture[str]
) -> None:
    def operate(_: tuple[str, ...]) -> None:
        if ("robotapps", "teleop") in cluster.objects:
            conditioned(cluster, Accepted="False")

    cluster.before = operate
    assert main(["apply", "--wait", "1m"]) == 75
    told = capsys.readouterr().err
    assert "is not accepted: Why: words\\u001b[2J" in told, "nothing of the cluster acts on a terminal"


def test_status_in_lines_and_as_json(cluster: FakeCluster, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status"]) == 76
    main(["apply"])
    conditioned(cluster, Ready="True", Accepted="True", Allocated="True", Placed="True", BudgetMet="False")
    component = {"name": "driver", "node": "n1", "ready": True}
    cluster.objects["robotappinstances", "i"] = {
        "metadata": {"name": "i", "labels": {"robotics.io/app": "teleop"}},
        "spec": {"appUID": "uid-teleop"},
        "status": {"phase": "Running", "components": [component]},
    }
    capsys.readouterr()
    assert main(["status", "teleop"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "robotapp/teleop in namespace fleet: Running, ready 1/1"
    assert lines[1].startswith("  BudgetMet False: Why: words")
    assert lines[2:4] == ["  instance i: Running", "    driver on n1: ready"]
    assert lines[4].endswith("(present)")
    assert main(["status", "-o", "json"]) == 0
    shown: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert shown["revisions"][0]["present"] is True


class Terminal(io.StringIO):
    """Standard input of somebody who answers."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("answer", "code"),
    [(Terminal("y\n"), 0), (Terminal("\n"), 1), (Terminal(""), 1), (io.StringIO("y\n"), 1)],
    ids=["yes", "return", "end of input", "no terminal"],
)
def test_a_rollback_asks_before_it_adds_an_image(
    cluster: FakeCluster,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    answer: io.StringIO,
    code: int,
) -> None:
    main(["apply"])
    Path("Rigelfile").write_text(orchestration("{name: teleop}", ONE.replace(":1", ":2")))
    main(["apply"])
    capsys.readouterr()
    monkeypatch.setattr("sys.stdin", answer)
    assert main(["rollback"]) == code
    told = capsys.readouterr().out
    assert "-  image: acme/driver:2\n+  image: acme/driver:1\n" in told, "the difference comes first"
    assert "revision 1 adds:\n  component base-driver: image acme/driver:1\n" in told
    assert cluster.objects["robotapps", "teleop"]["spec"]["components"][0]["image"] == (
        "acme/driver:1" if code == 0 else "acme/driver:2"
    )


def test_rollback_names_its_revision(cluster: FakeCluster, capsys: pytest.CaptureFixture[str]) -> None:
    main(["apply"])
    assert main(["rollback"]) == 76
    Path("Rigelfile").write_text(orchestration("{name: teleop}", ONE.replace(":1", ":2")))
    main(["apply"])
    capsys.readouterr()
    assert main(["rollback", "--yes"]) == 0
    assert "changed, spec of revision 1\n  spec.components[0].image: acme/driver:2 -> acme/driver:1\n" in (
        capsys.readouterr().out
    )
    assert ("robotapps", "teleop") in cluster.objects


def test_delete_keeps_volume_claims_unless_told(cluster: FakeCluster, capsys: pytest.CaptureFixture[str]) -> None:
    Path("Rigelfile").write_text(orchestration(f"{{name: teleop, {STORAGE}}}"))
    assert main(["apply"]) == 0
    assert main(["delete"]) == 0
    assert list(cluster.objects) == [("persistentvolumeclaims", "logs-pvc")]
    assert main(["delete", "--storage"]) == 0
    assert cluster.objects == {}
    assert capsys.readouterr().out.endswith("is not there\npersistentvolumeclaim/logs-pvc: deleted\n")


def test_collect_fills_a_new_folder_alone(cluster: FakeCluster, capsys: pytest.CaptureFixture[str]) -> None:
    main(["apply"])
    assert main(["collect", "out"]) == 0
    assert "3 files in out" in capsys.readouterr().out
    assert main(["collect", "out"]) == 72
    assert ("robotapps", "teleop") in cluster.objects


@pytest.mark.parametrize(
    ("text", "wanted"), [("120s", 120.0), ("2m", 120.0), ("500ms", 0.5), ("7", 7.0), ("1h", 3600.0)]
)
def test_durations_are_those_of_kubernetes(text: str, wanted: float) -> None:
    assert seconds(text) == wanted


@pytest.mark.parametrize("text", ["", "soon", "-1s", "25h", "1d", "1e9", "9" * 30])
def test_other_durations_are_wrong_usage(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is no duration"):
        seconds(text)


def test_flags_of_the_cluster_go_on_to_kubectl(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(Kubectl, "__init__", lambda _, program, *, flags: seen.extend([program, *flags]))
    kubectl_of(argparse.Namespace(kubectl="k", context="c", kubeconfig=None, namespace="n"))
    assert seen == ["k", "--context=c", "--namespace=n"]


@pytest.mark.parametrize("name", ["", "-A", "--all", "a,b", "nope,!foo", "a/b", "A", "a b", "../a", "a\n"])
@pytest.mark.parametrize("verb", ["status", "rollback", "delete", "collect"])
def test_what_is_no_name_reaches_no_kubectl(
    verb: str, name: str, cluster: FakeCluster, capsys: pytest.CaptureFixture[str]
) -> None:
    """`delete "$APP"` with an empty variable deleted what the Rigelfile of this folder becomes."""
    assert main(["apply"]) == 0
    cluster.calls.clear()
    folder = ["out"] if verb == "collect" else []
    with pytest.raises(SystemExit, match="2"):
        main([verb, *folder, "--", name])
    assert cluster.calls == []
    assert "is no name of a RobotApp" in capsys.readouterr().err


def test_apps_before_the_one_that_is_refused_are_told(cluster: FakeCluster, capsys: pytest.CaptureFixture[str]) -> None:
    job = "{{plugin: rigel_bridge.RobotAppPlugin, with: {{name: {0}, image: x, orchestration: {{}}}}}}"
    jobs = "".join(f"  {name}: {job.format(name)}\n" for name in ("first", "second"))
    both = "sequences: {s: {stages: [{jobs: [first, second]}]}}\n"
    Path("Rigelfile").write_text(f"application: {{distro: humble}}\njobs:\n{jobs}{both}")

    def refuse(call: tuple[str, ...]) -> None:
        if call[:3] == ("get", "robotapps.robotics.io", "second"):
            raise ClusterError("the connection is gone", reason=Refusal.UNREACHABLE)

    cluster.before = refuse
    assert main(["apply", "--sequence", "s"]) == 74
    told = capsys.readouterr()
    assert told.out == "robotapp/first in namespace fleet: created\n"
    assert "the connection is gone" in told.err
