"""What `scripts/demo` says around its story; the story itself checks what it says."""

import io
import sys
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from journeys import demo
from journeys.stage import Stage
from robotapp_testbed import TestbedError
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.processes.detached import Cluster


def stage_on_paper() -> tuple[Stage, io.StringIO]:
    paper = io.StringIO()
    return Stage(console=Console(file=paper, width=100, soft_wrap=True, highlight=False)), paper


def test_whoever_goes_on_can_ask_the_scheduler_and_has_a_kubectl() -> None:
    stage, paper = stage_on_paper()
    cluster = SimpleNamespace(kubeconfig=lambda: Path("/run/x/admin.yaml"), run_dir=Path("/run/x"))
    scheduler = SimpleNamespace(health_url="https://127.0.0.1:20001")
    console = SimpleNamespace(address="http://127.0.0.1:20002/open?pass=word")
    demo.how_to_go_on(stage, SimpleNamespace(cluster=cluster, scheduler=scheduler, console=console))  # type: ignore[arg-type] # all it looks at
    said = paper.getvalue()
    assert "export KUBECONFIG=/run/x/admin.yaml ROBOTAPP_SCHEDULER_URL=https://127.0.0.1:20001\n" in said
    assert "/.venv/bin:$PATH:/run/x/bin\n" in said
    assert "kubectl robotapp explain teleop -n demo" in said
    assert "http://127.0.0.1:20002/open?pass=word\n" in said


def test_the_demo_gets_kube_scheduler_to_compare_with_and_no_kubelet(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted: list[str] = []

    def stop(_: Assets, names: Iterable[str]) -> None:
        wanted.extend(names)
        raise TestbedError("nothing is started")

    monkeypatch.setattr(Assets, "resolve", stop)
    monkeypatch.setattr(Cluster, "state", lambda _: None)
    monkeypatch.setattr(sys, "argv", ["demo"])
    assert demo.main() == 1
    servers = {"etcd", "kube-apiserver", "kube-controller-manager", "kube-scheduler"}
    assert set(wanted) == servers | {"kwok", "kubectl", "helm"}


def test_an_interrupted_story_ends_with_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(**_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(demo, "ControlPlane", interrupted)
    monkeypatch.setattr(sys, "argv", ["demo", "--once"])
    assert demo.main() == 130
    assert capsys.readouterr().out == "\nEnded; nothing is left running.\n"
