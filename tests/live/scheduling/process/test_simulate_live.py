"""A dump taken from the live cluster, placed without it, is what the live scheduler then does."""

import json
import secrets
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from campaigns.rigs.ports import ask, token
from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.machines.nodes import SimulatedNode, edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

PLUGIN = Path(sys.executable).parent / "kubectl-robotapp"
PROGRAM = [sys.executable, "-m", "robotapp_scheduler"]


def tool(cp: ControlPlane, *argv: str) -> str:
    done = subprocess.run(
        [*PROGRAM, *argv], capture_output=True, text=True, check=False, env={"KUBECONFIG": str(cp.kubeconfig("admin"))}
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def fleet() -> list[SimulatedNode]:
    """Names no other test uses: pods of theirs that are still being deleted must not take room here."""
    return [edge(f"paper-{number}", cpu=str(2 + number % 3)) for number in range(1, 8)]


def burst(stage: Stage) -> list[str]:
    """Thirty pods of many sizes, some too large for any node, some for one node alone."""
    names = [f"p-{number:02}" for number in range(30)]
    for number, name in enumerate(names):
        requests = {"cpu": f"{100 + 150 * (number % 5)}m" if number % 10 else "64"}
        selector = {"nodeSelector": {"kubernetes.io/hostname": f"paper-{1 + number % 7}"}} if number % 4 == 1 else {}
        stage.create_pod(pod(name, requests=requests, **selector))
    return names


def placements(text: str, stage: Stage) -> dict[str, dict[str, Any]]:
    found = json.loads(text)["placements"]
    return {each["name"]: each for each in found if each["namespace"] == stage.namespace}


def test_what_is_simulated_is_what_happens(installed_plane: ControlPlane, stage: Stage, tmp_path: Path) -> None:
    with nodes(installed_plane, *fleet()):
        names = burst(stage)
        export, dump = tmp_path / "export.json", tmp_path / "kubectl.json"
        tool(installed_plane, "export", "-o", str(export))
        dump.write_text(installed_plane.kubectl("get", "nodes,pods,pv,pvc,storageclasses,csinodes", "-A", "-o", "json"))
        expected = placements(tool(installed_plane, "simulate", str(export), "--json"), stage)
        assert placements(tool(installed_plane, "simulate", str(dump), "--json"), stage) == expected
        assert sorted(expected) == names
        scheduler = start_scheduler(installed_plane, name=f"scheduler-{secrets.token_hex(3)}", sweep_seconds=1)
        try:
            for name in names:
                if expected[name]["node"] is None:
                    assert stage.wait_refused(name, reason="Unschedulable") == expected[name]["message"]
                else:
                    stage.wait_bound(name)
            assert {name: stage.node_of(name) or None for name in names} == {
                name: expected[name]["node"] for name in names
            }
        finally:
            scheduler.stop()


@pytest.fixture
def guarded(installed_plane: ControlPlane) -> Iterator[Process]:
    """For one test only: beside it, another test's pods must wait for their own scheduler."""
    process = start_scheduler(installed_plane, name="guarded", sweep_seconds=1, log_format="text")
    yield process
    process.stop()


def robotapp(
    cp: ControlPlane, scheduler: Process, *argv: str, identity: str = "admin"
) -> subprocess.CompletedProcess[str]:
    environment = {
        "KUBECONFIG": str(cp.kubeconfig(identity)),
        "ROBOTAPP_SCHEDULER_URL": str(scheduler.health_url),
        "COLUMNS": "200",
        "PATH": "/usr/bin:/bin",
    }
    return subprocess.run([PLUGIN, *argv], env=environment, capture_output=True, text=True, check=False)


def test_the_running_scheduler_simulates_pods_of_a_file_and_places_none(
    installed_plane: ControlPlane, stage: Stage, guarded: Process, tmp_path: Path
) -> None:
    with nodes(installed_plane, edge("try-1", cpu="2"), edge("try-2", cpu="2")):
        stage.create_pod(pod("runs", requests={"cpu": "1500m"}))
        taken = stage.wait_bound("runs")
        wanted = {"apiVersion": "v1", "kind": "Pod", **pod("wanted", requests={"cpu": "1"})}
        (tmp_path / "wanted.yaml").write_text(yaml.safe_dump(wanted))
        arguments = ("simulate", str(tmp_path / "wanted.yaml"), "-n", stage.namespace, "-o", "json")
        done = robotapp(installed_plane, guarded, *arguments)
        assert done.returncode == 0, done.stderr
        found = placements(done.stdout, stage)
        assert found["wanted"]["node"] == {"try-1": "try-2", "try-2": "try-1"}[taken]
        assert [item["metadata"]["name"] for item in stage.pods()] == ["runs"]


@pytest.mark.parametrize("body", [b"", b"kind: Pod"])
def test_a_body_that_is_no_dump_is_answered_with_how_to_make_one(
    installed_plane: ControlPlane, guarded: Process, body: bytes
) -> None:
    status, text = ask(f"{guarded.health_url}/simulate", bearer=token(installed_plane, "admin"), body=body)
    assert status == 400
    told = json.loads(text)["error"]
    assert told.startswith("body of the request: no")
    assert "kubectl get nodes,pods -A -o json" in told


def test_a_tenant_may_not_simulate(installed_plane: ControlPlane, guarded: Process) -> None:
    done = robotapp(installed_plane, guarded, "simulate", identity="tenant")
    assert done.returncode == 1
    assert "you may not get /simulate" in done.stderr
