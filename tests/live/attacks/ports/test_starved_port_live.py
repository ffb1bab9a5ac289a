"""Strangers at the scheduler's port, on a real control plane: pods are bound all the same, by a process that has no work of it.

`scripts/bench starve` measures it per bind, beside the same load on an idle copy.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.support.work_unit import is_in_time, is_within, slowness

from campaigns.common.process_use import cpu_seconds
from campaigns.rigs.ports import ask, token
from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.binaries.pins import REPOSITORY
from robotapp_testbed.control_plane.product import start_scheduler
from robotapp_testbed.machines.nodes import edge

pytestmark = pytest.mark.live

SECONDS = 8
PODS = 20
MOST_S = 1.0
"""CPU, beside what the same pods take without strangers: 4,400 requests at 0.4 ms each would be 1.8 s."""
BOUND_S = 10.0
"""Where `slowness` is 1; alone it is a moment."""


@pytest.fixture
def stage(installed_plane: ControlPlane, namespace: str) -> Stage:
    return Stage(installed_plane, namespace)


def test_bad_tokens_and_full_explanations_are_no_work_for_the_process_that_places_pods(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, *(edge(f"edge-{number}") for number in range(10))):
        scheduler = start_scheduler(installed_plane, name="starved", sweep_seconds=1, log_format="text")
        try:
            stage.create_pod(pod("asked"))
            stage.wait_bound("asked")
            path, admin = f"/explain/{stage.namespace}/asked", token(installed_plane, "admin")
            assert ask(f"{scheduler.health_url}{path}", bearer=admin)[0] == 200
            patience_s = BOUND_S * slowness()
            alone_s = placing_s(stage, scheduler.pid, "alone", within_s=patience_s)
            before_s = cpu_seconds(scheduler.pid)
            command = ["campaigns.scheduler.port_load", str(scheduler.health_url), "--path", path, "--token", admin]
            began_s = time.monotonic()
            load = subprocess.Popen(
                [sys.executable, "-m", *command, "--seconds", str(SECONDS)], cwd=REPOSITORY, stdout=subprocess.PIPE
            )
            try:
                placing_s(stage, scheduler.pid, "meanwhile", within_s=2 * patience_s)
                assert ask(f"{scheduler.health_url}{path}", bearer=admin)[0] == 200, "who is known is served meanwhile"
                assert ask(f"{scheduler.health_url}/livez")[0] == 200
                answers = json.loads(load.communicate(timeout=600)[0])
                stretched = max(
                    1.0, (time.monotonic() - began_s) / SECONDS
                )  # a busy machine sends the same requests over more time
            finally:
                load.kill()
                load.wait()
            used_s = cpu_seconds(scheduler.pid) - before_s
        finally:
            scheduler.stop()
    assert set(answers["bad"]) == {"401", "429"}
    assert answers["bad"]["401"] < 100 * stretched, "each is a question to the API server"
    assert set(answers["full"]) == {"200", "429"}
    assert answers["full"]["200"] < 60 * stretched
    assert is_within(used_s - alone_s, MOST_S), f"{alone_s:.2f} s without strangers"


def placing_s(stage: Stage, scheduler_pid: int, name: str, *, within_s: float) -> float:
    """CPU of the scheduler while some pods are placed one after the other, each in time."""
    before_s = cpu_seconds(scheduler_pid)
    for number in range(PODS):
        stage.create_pod(pod(f"{name}-{number}"))
        stage.wait_bound(f"{name}-{number}", timeout_s=within_s)
    return cpu_seconds(scheduler_pid) - before_s


def test_the_port_is_served_again_after_its_process_died_and_no_pod_waits(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        scheduler = start_scheduler(installed_plane, name="portless", sweep_seconds=1, log_format="text")
        try:
            (server,) = Path(f"/proc/{scheduler.pid}/task/{scheduler.pid}/children").read_text().split()
            subprocess.run(["kill", "-KILL", server], check=True)
            stage.create_pod(pod("meanwhile"))
            stage.wait_bound("meanwhile", timeout_s=BOUND_S * slowness())
            began_s = time.monotonic()
            assert ask(f"{scheduler.health_url}/livez")[0] == 200
            assert is_in_time(time.monotonic() - began_s, 20)
            assert f"port {str(scheduler.health_url).rpartition(':')[2]} ended with -9" in scheduler.log_text()
        finally:
            scheduler.stop()
