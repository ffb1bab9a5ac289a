"""`migrate --apply` as a whole: what it leaves when it fails halfway, is ended, or others write at the same time."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from tests.unit.bridge.fake_cluster import FakeCluster

from rigel_bridge.cluster.kubectl import ClusterError, Refusal
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.main import main
from rigel_bridge.verbs import migrate as verb

PREFIX = "scheduler.robotics.io/"


def workload(name: str) -> dict[str, Any]:
    """A Deployment whose pods never met those of the others: each is in a domain of its own."""
    container = {
        "name": "c",
        "image": f"ros:humble-{name}",
        "env": [{"name": "ROS_DOMAIN_ID", "value": str(len(name))}],
    }
    template = {
        "metadata": {"annotations": {f"{PREFIX}policies": "{}"}},
        "spec": {"containers": [container]},
    }
    metadata = {"name": name, "namespace": "fleet", "uid": f"uid-{name}"}
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": metadata, "spec": {"template": template}}


def pod(name: str) -> dict[str, Any]:
    owner = {"kind": "Deployment", "uid": f"uid-{name}", "controller": True}
    metadata = {"name": f"{name}-1", "namespace": "fleet", "uid": f"pod-of-{name}", "ownerReferences": [owner]}
    return {"kind": "Pod", "metadata": metadata, "spec": {"containers": [{"name": "c"}]}}


class MigratedCluster(FakeCluster):
    """Deployments `arm` and `base`, each with a pod that holds a domain of node n1. Apps become Ready, except those `failing`."""

    def __init__(self, *, failing: tuple[str, ...] = ()) -> None:
        super().__init__()
        self.annotated: list[tuple[str, ...]] = []
        self.records = {"1": "pod-of-arm", "2": "pod-of-base"}
        self.version = 7
        for name in ("arm", "base"):
            self.objects["deployments", name] = workload(name)
            self.objects["pods", f"{name}-1"] = pod(name)
        self.failing = failing
        self.before = self.operate

    def operate(self, call: tuple[str, ...]) -> None:
        for (kind, name), stored in list(self.objects.items()):
            if kind == "robotapps":
                state = {"type": "Ready", "status": str(name not in self.failing), "observedGeneration": 9}
                stored["status"] = {"conditions": [state]}
        annotations = {f"{PREFIX}dds-claims": json.dumps(self.records)}
        metadata = {"name": "n1", "annotations": annotations, "resourceVersion": str(self.version)}
        self.objects["nodes", "n1"] = {"kind": "Node", "metadata": metadata}
        if call[0] == "annotate":
            if call[-1] != f"--resource-version={self.version}":
                raise ClusterError("Operation cannot be fulfilled", reason=Refusal.CONFLICT)
            self.annotated.append(call)


def run(world: MigratedCluster, folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    now = [0.0]
    clock = Clock(now_s=lambda: now[0], sleep=lambda seconds: now.__setitem__(0, now[0] + seconds))
    monkeypatch.setattr(verb, "kubectl_of", lambda _: world)
    monkeypatch.setattr(verb, "Clock", lambda: clock)
    return main(["migrate", "--apply", "--backup", str(folder / "backup")])


def names(world: MigratedCluster, kind: str) -> list[str]:
    return sorted(name for each, name in world.objects if each == kind)


def test_records_of_the_apps_that_were_done_are_cleared_when_a_later_one_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = MigratedCluster(failing=("base",))
    assert run(world, tmp_path, monkeypatch) == 75
    assert names(world, "robotapps") == ["arm"]
    assert names(world, "deployments") == ["base"]
    assert [call[3] for call in world.annotated] == [PREFIX + 'dds-claims={"2": "pod-of-base"}']


def test_entries_that_others_wrote_meanwhile_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = MigratedCluster()
    operate = world.before

    def before(call: tuple[str, ...]) -> None:
        if call[:2] == ("delete", "deployment"):
            world.records["9"] = "pod-of-somebody-else"
        if call[0] == "annotate" and world.version < 9:
            world.version += 1
            world.records[str(world.version)] = "pod-of-a-third"
        operate(call)

    world.before = before
    assert run(world, tmp_path, monkeypatch) == 0
    kept = {"9": "pod-of-a-third", "8": "pod-of-a-third"}
    assert [json.loads(call[3].partition("=")[2]) for call in world.annotated] == [kept]


def test_what_will_no_longer_meet_stops_the_take_over_until_the_user_accepts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    world = MigratedCluster()
    stays = workload("arm") | {"metadata": {"name": "rviz", "namespace": "fleet", "uid": "uid-rviz"}}
    del stays["spec"]["template"]["metadata"]["annotations"]
    world.objects["deployments", "rviz"] = stays
    assert run(world, tmp_path, monkeypatch) == 72
    assert names(world, "deployments") == ["arm", "base", "rviz"]
    told = capsys.readouterr().err
    assert "APART: deployment fleet/rviz stays in domain 3, which the app keeps" in told
    assert "1 pair of workloads would no longer meet" in told


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_request_to_end_brings_the_old_workload_back(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    world = MigratedCluster()
    before = signal.getsignal(number)
    if before is signal.SIG_IGN:
        pytest.skip("this signal is ignored here")
    operate, sent = world.before, list[int]()

    def ended(call: tuple[str, ...]) -> None:
        operate(call)
        if call[0] == "apply" and "--dry-run=server" not in call and not sent:
            sent.append(1)
            os.kill(os.getpid(), number)

    world.before = ended
    assert run(world, tmp_path, monkeypatch) == 130
    assert names(world, "deployments") == ["arm", "base"]
    assert names(world, "robotapps") == []
    assert "the old workloads come back" in capsys.readouterr().err
    assert signal.getsignal(number) is before
