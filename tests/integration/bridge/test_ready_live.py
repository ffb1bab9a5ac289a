"""Every sample Rigelfile, applied in every form, runs on the testbed."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.integration.bridge.conftest import Stage
from tests.integration.bridge.test_accepted_live import EXAMPLE, SAMPLES
from tests.integration.bridge.test_rigel03 import RIGELFILE as WITH_JOBS
from tests.support.live import pool
from tests.support.stage import IMAGE

from rigel_bridge.main import main
from robotapp_api.model.names import SCHEDULER_NAME

pytestmark = pytest.mark.live

THESIS = """\
application: {distro: humble}
orchestration:
  deploy_ros_master: false
  application_image: acme/teleop:1
  scheduler:
    name: kubernetes-scheduler
    policies: {latency_budget: "30ms", qos_class: "realtime", reliability: "reliable", deadline: "50ms"}
    topology: {preferred_zones: ["edge-zone-1"]}
"""
FILES = {**SAMPLES, "example": EXAMPLE.read_text(), "with-jobs": WITH_JOBS, "thesis": THESIS}


@pytest.fixture(scope="module")
def surroundings(stage: Stage) -> Iterator[Stage]:
    """What the samples name: the peer `mapper`, parameter files, the pool `lab`."""
    mapper = {"nodeName": "edge-1", "containers": [{"name": "main", "image": IMAGE}]}
    drv = {"amr-07.yaml": "/**: {ros__parameters: {v: 2.0}}"}
    for each in (
        {"kind": "Pod", "metadata": {"name": "mapper"}, "spec": mapper},
        {"kind": "ConfigMap", "metadata": {"name": "drv"}, "data": drv},
    ):
        stage.plane.kubectl("apply", "-n", stage.namespace, "-f", "-", stdin={"apiVersion": "v1", **each})
    with pool(stage.plane, "lab"):
        yield stage


def files(folder: Path) -> dict[str, str]:
    """The samples as files, each in a folder that is the name of its app."""
    found = {}
    for name, text in FILES.items():
        (folder / name).mkdir()
        found[name] = str(folder / name / "Rigelfile")
        # The scheduler cannot keep a component beside a volume claim yet, and says so.
        without_claims = text.replace(", pvc: [map-pvc]", "").replace(
            "sharedData: {claimNames: [map-pvc]}", "sharedData: {}"
        )
        Path(found[name]).write_text(without_claims)
    return found


def test_every_sample_becomes_ready(surroundings: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, path in files(tmp_path).items():
        assert surroundings.run("apply", path, "--name", name, identity="admin") == 0, capsys.readouterr().err
    failed = [name for name in FILES if not ready(surroundings, name)]
    assert not failed, [surroundings.app(name)["status"] for name in failed]
    surroundings.plane.kubectl("delete", "robotapps", "--all", "-n", surroundings.namespace)


def ready(stage: Stage, name: str) -> bool:
    wanted = ("--for=condition=Ready", f"robotapp/{name}", "-n", stage.namespace, "--timeout=30s")
    return "condition met" in stage.plane.kubectl("wait", *wanted, check=False)


@pytest.mark.parametrize("form", ["pods", "manifests"])
def test_every_sample_runs_without_an_operator(
    surroundings: Stage, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plane, where = surroundings.plane, surroundings.namespace
    written: list[dict[str, Any]] = []
    for name, path in files(tmp_path).items():
        assert main(["render", path, "--format", form, "--name", name, "-n", where]) == 0
        written += yaml.safe_load_all(capsys.readouterr().out)
    for each in written:
        if each["kind"] == "Deployment":  # no other scheduler runs here
            each["spec"]["template"]["spec"].setdefault("schedulerName", SCHEDULER_NAME)
    plane.kubectl("apply", "-f", "-", "--validate=strict", stdin=written)
    wait = ("wait", "--for=condition=Available", "deployments", "--all", "-n", where, "--timeout=60s")
    told = plane.kubectl(*wait, check=False)
    pods = plane.kubectl("get", "pods", "-n", where, "-o", PENDING)
    plane.kubectl("delete", "-f", "-", "--wait=false", stdin=written)
    assert "timed out" not in told, pods


PENDING = (
    'jsonpath={range .items[*]}{.metadata.name} {.status.conditions[?(@.type=="PodScheduled")].message}{"\\n"}{end}'
)
