"""Sequences and migrations on the real control plane."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.integration.bridge.conftest import USER, Stage
from tests.support.live import HandBinder
from tests.support.stage import IMAGE

from rigel_bridge.sequences.run import read_summaries

pytestmark = pytest.mark.live

BENCHMARK = """\
application: {{distro: humble}}
jobs:
  deploy:
    plugin: rigel_bridge.RobotAppPlugin
    with:
      name: teleop
      image: acme/teleop:1
      orchestration:
        scheduler: {{policies: {{qos_class: realtime}}}}
        robotapp: {{ros2: {{pool: {pool}}}}}
sequences:
  benchmark_default: {{stages: [{{jobs: [{{name: deploy, with: {{scheduler_name: default-scheduler}}}}]}}]}}
  benchmark_custom: {{stages: [{{jobs: [{{name: deploy, with: {{scheduler_name: kubernetes-scheduler}}}}]}}]}}
"""
OLD = "scheduler.robotics.io/"


def test_two_schedulers_are_compared_and_nothing_is_left(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "Rigelfile").write_text(BENCHMARK.format(pool=stage.pool))
    wanted = ("--run", "benchmark_default", "benchmark_custom", "--duration", "0s", "--results", str(tmp_path / "r"))
    with HandBinder(stage.plane, stage.namespace):  # the default scheduler does not run here
        assert stage.run("sequences", str(tmp_path / "Rigelfile"), *wanted) == 0, capsys.readouterr().err
    runs = {each["sequence"]: each for each in read_summaries(tmp_path / "r")}
    assert {name: run["scheduler"] for name, run in runs.items()} == {
        "benchmark_default": "default-scheduler",
        "benchmark_custom": "kubernetes-scheduler",
    }
    assert all(run["components"][0]["ready"] and run["components"][0]["node"] for run in runs.values())
    assert "| node of ros-app |" in capsys.readouterr().out
    assert not stage.listed("robotapps,pods,deployments,controllerrevisions")


def annotated(name: str) -> dict[str, Any]:
    """A Deployment as Rigel's orchestration plugin made it for the thesis' scheduler."""
    annotations = {f"{OLD}policies": '{"latency_budget":"90ms","qos_class":"realtime"}', f"{OLD}dds-domain": "auto"}
    template = {
        "metadata": {"labels": {"app": name}, "annotations": annotations},
        "spec": {
            "schedulerName": "kubernetes-scheduler",
            "containers": [{"name": "ros-app", "image": f"{IMAGE}-humble"}],
        },
    }
    spec = {"replicas": 1, "selector": {"matchLabels": {"app": name}}, "template": template}
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": {"name": name}, "spec": spec}


def test_a_deployment_of_the_thesis_is_taken_over_with_its_records(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plane, where = stage.plane, stage.namespace
    plane.kubectl("apply", "-n", where, "-f", "-", stdin=annotated("arm"))
    plane.kubectl("rollout", "status", "deployment/arm", "-n", where, "--timeout=60s")
    (pod,) = json.loads(plane.kubectl("get", "pods", "-l", "app=arm", "-n", where, "-o", "json"))["items"]
    uid, node = pod["metadata"]["uid"], pod["spec"]["nodeName"]
    record = json.dumps({"5": uid, "6": "of-another-namespace"})
    plane.kubectl(
        "annotate", "node", node, f"{OLD}dds-claims={record}", f"{OLD}device-claims={json.dumps({'can': uid})}"
    )

    assert stage.run("migrate", identity="admin") == 0
    shown = capsys.readouterr()
    (app,) = yaml.safe_load_all(shown.out)
    assert app["spec"]["components"][0]["policies"] == {"latencyBudget": "90ms"}
    assert f"domain 5 held by pod {uid} of deployment {where}/arm" in shown.err

    backup = tmp_path / "old"
    assert stage.run("migrate", "--apply", "--backup", str(backup), identity="admin") == 0, capsys.readouterr().err
    assert "arm: Ready, in place of" in capsys.readouterr().out
    assert not plane.kubectl("get", "deployment", "arm", "-n", where, "--ignore-not-found")
    notes = json.loads(plane.kubectl("get", "node", node, "-o", "json"))["metadata"]["annotations"]
    assert json.loads(notes[f"{OLD}dds-claims"]) == {"6": "of-another-namespace"}
    assert f"{OLD}device-claims" not in notes
    assert json.loads((backup / "deployment-arm.json").read_text())["metadata"]["name"] == "arm"
    assert stage.run("migrate") == 0, f"{USER} may list no workloads: told, and nothing is found"
    assert stage.run("delete", "arm", identity="admin") == 0
