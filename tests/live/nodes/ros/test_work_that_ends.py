"""Work that ends on real nodes with real rclpy: a map saver takes a map from its mapper, and a sweep of twelve writes twelve results.

`pytest --log-cli-level=INFO` on this file prints the seconds that it measures.
"""

import json
import logging
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import product as combinations
from pathlib import Path
from typing import Any, Final

import pytest
from tests.support.work_unit import slowness

from campaigns.nodes import teleop_app as teleop
from campaigns.operating.sweep import Report, count_live_pods
from campaigns.reference.robotapps import make_volume
from campaigns.rigs.live import Tenant, eventually, part, pool
from campaigns.storm.history import Judge
from campaigns.storm.recorder import PATHS, Recorder
from robotapp_testbed import images
from robotapp_testbed.binaries import pins
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import edge, robot
from robotapp_testbed.real import RealNodes

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(pins.platform_names()["arch"] != "amd64", reason="wheels of rclpy are for amd64 alone"),
]

logger = logging.getLogger(__name__)

PLACE: Final = "ends"
HOME: Final = "edge-1"
"""The node that has the volume, so the jobs run there."""
PROGRAMS: Final = Path(__file__).with_name("programs_that_end.py")
KUBECTL_ROBOTAPP: Final = Path(sys.executable).parent / "kubectl-robotapp"
IMAGE: Final = {"image": images.reference("fleet-ros2"), "imagePullPolicy": "IfNotPresent"}
"""Of those with nav_msgs the one with the least besides."""
ENDS_S: Final = 60.0
"""Time within which a map is saved, where `slowness` is 1."""
PER_RUN_S: Final = 10.0
SPEEDS, SEEDS, PARALLELISM = ("0.5", "1.0", "1.5", "2.0"), ("1", "2", "3"), 3
MATRIX: Final = {
    "parameters": [{"name": "speed", "values": list(SPEEDS)}, {"name": "seed", "values": list(SEEDS)}],
    "parallelism": PARALLELISM,
}
CLAIM: Final = {
    "apiVersion": "v1",
    "kind": "PersistentVolumeClaim",
    "metadata": {"name": "results"},
    "spec": {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": "10Mi"}}},
}
VOLUME: Final = make_volume(CLAIM, PLACE, HOME)
FOLDER: Final = VOLUME["spec"]["local"]["path"]


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes, delays = [robot("robot-1"), edge(HOME)], {("robot-1", HOME): 2}
    with real_machine(nodes, delays=delays, images=("fleet-ros2",), kube_scheduler=True) as cp:
        product.install(cp)
        product.start_operator(cp, sweep_seconds=1)
        product.start_scheduler(cp, sweep_seconds=1)
        yield cp


@pytest.fixture(scope="module")
def tenant(cluster: RealNodes) -> Iterator[Tenant]:
    """A namespace with the programs and with a volume for what they write."""
    with created(cluster, PLACE):
        cluster.node(HOME).box.run("/bin/mkdir", "-p", FOLDER)
        programs = {"metadata": {"name": "programs"}, "data": {PROGRAMS.name: PROGRAMS.read_text()}}
        cluster.api.create(f"/api/v1/namespaces/{PLACE}/configmaps", programs)
        teleop.apply(cluster, PLACE, [VOLUME, CLAIM])
        yield Tenant(cluster, PLACE)


@pytest.fixture(scope="module")
def ros2(cluster: RealNodes) -> Iterator[dict[str, Any]]:
    with pool(cluster, PLACE) as ids:
        yield {"pool": ids, "discovery": IMAGE}


def make_part(name: str, *args: str, node: str = "", writes: str = "", **fields: Any) -> dict[str, Any]:
    """Returns a component that runs one of the programs. `writes`: path in the volume of the folder that is its /results."""
    mounts = [{"name": "programs", "mountPath": "/programs"}]
    pod: dict[str, Any] = {"volumes": [{"name": "programs", "configMap": {"name": "programs"}}]}
    if writes:
        mounts.append({"name": "results", "mountPath": "/results", "subPathExpr": writes})
        pod["volumes"].append({"name": "results", "persistentVolumeClaim": {"claimName": "results"}})
        pod["securityContext"] = {"fsGroup": 65532}
    if node:
        pod["nodeSelector"] = {"kubernetes.io/hostname": node}
    program = ["python3", f"/programs/{PROGRAMS.name}", *args]
    return part(name, **IMAGE, args=program, volumeMounts=mounts, template={"spec": pod}, **fields)


def read_results(tenant: Tenant, app: str) -> dict[str, dict[str, Any]]:
    """Returns what the runs of an app wrote, by folder."""
    box = tenant.cp.node(HOME).box
    paths = box.run("/usr/bin/find", f"{FOLDER}/{app}", "-type", "f").split()
    return {Path(path).parent.name: json.loads(box.run("/bin/cat", path)) for path in paths}


def read_status(tenant: Tenant, app: str) -> tuple[Any, ...]:
    """Returns what explains an app that does not end."""
    pods = {pod["metadata"]["name"]: pod["status"] for pod in tenant.listed("pods")}
    return tenant.app(app).get("status"), pods


def run_runs(tenant: Tenant, *arguments: str) -> str:
    """Returns what `kubectl robotapp runs …` prints."""
    command = [KUBECTL_ROBOTAPP, "runs", *arguments, "-n", PLACE, f"--kubeconfig={tenant.cp.kubeconfig('admin')}"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_a_map_saver_takes_one_grid_from_the_mapper_and_the_app_is_completed(
    tenant: Tenant, ros2: dict[str, Any]
) -> None:
    mapper = make_part("mapper", "mapper", node="robot-1")
    after = [{"component": "mapper"}]
    save = make_part("save", "save", "/results", writes="$(ROBOTAPP_APP)", job={"backoffLimit": 0}, dependsOn=after)
    limit_s, began_s = ENDS_S * slowness(), time.monotonic()
    tenant.apply("mapping", mapper, save, ros={"distro": "jazzy"}, ros2=ros2, completion={})
    eventually(
        lambda: tenant.app("mapping").get("status", {}).get("phase") == "Completed",
        timeout_s=limit_s,
        what=lambda: read_status(tenant, "mapping"),
    )
    logger.info("the map was saved %.1f s after the app was applied", time.monotonic() - began_s)
    assert tenant.app("mapping")["status"]["instanceCounts"]["completed"] == 1
    (result,) = read_results(tenant, "mapping").values()
    assert result == {"width": 20, "height": 10, "cells": [cell % 101 for cell in range(200)]}
    pod = teleop.pods(tenant.cp, PLACE, "mapping")["save"]
    (status,) = pod["status"]["containerStatuses"]
    assert (status["state"]["terminated"]["exitCode"], status["restartCount"]) == (0, 0)
    assert pod["spec"]["nodeName"] == HOME
    eventually(lambda: not tenant.deployments(), what=tenant.children)
    eventually(lambda: not tenant.claims(), what=tenant.claims)


def test_a_sweep_of_twelve_writes_twelve_results_each_in_a_domain_of_its_own(
    tenant: Tenant, ros2: dict[str, Any]
) -> None:
    run = make_part("run", "run", "/results", writes="$(ROBOTAPP_APP)/$(ROBOTAPP_INSTANCE)", job={"backoffLimit": 0})
    wanted = set(combinations(SPEEDS, SEEDS))
    limit_s, began_s = PER_RUN_S * len(wanted) * slowness(), time.monotonic()
    with Recorder(tenant.cp) as recorder:
        eventually(lambda: recorder.passed.keys() >= PATHS.keys())
        tenant.apply("sweep", run, ros={"distro": "jazzy"}, ros2=ros2, matrix=MATRIX)
        eventually(
            lambda: tenant.app("sweep").get("status", {}).get("instanceCounts", {}).get("completed") == len(wanted),
            timeout_s=limit_s,
            what=lambda: read_status(tenant, "sweep"),
        )
        logger.info("all twelve had ended %.1f s after the sweep was applied", time.monotonic() - began_s)
        eventually(lambda: not tenant.claims(), what=tenant.claims)
        events = recorder.ripe(all_of_them=True)
        assert not recorder.problems

    results = read_results(tenant, "sweep")
    assert {(result["speed"], result["seed"]) for result in results.values()} == wanted
    assert len(results) == len(wanted), "each instance has a folder"
    for result in results.values():
        assert result["heard"] == [{"speed": result["speed"], "seed": result["seed"]}], "it hears nothing but itself"

    report = Report(len(wanted), PARALLELISM)
    count_live_pods(events, report)
    assert report.problems == []
    assert report.pods == len(wanted)
    assert 2 <= report.most_at_once <= PARALLELISM
    judge = Judge(namespaces=[PLACE])
    judge.hear(events)
    assert judge.verdict.broken == []
    assert judge.verdict.grants == len(wanted)

    table = run_runs(tenant, "sweep")
    logger.info("kubectl robotapp runs sweep\n%s", table)
    _, *rows = (line.split() for line in table.splitlines())
    assert {tuple(row[1:3]) for row in rows} == {(f"speed={speed}", f"seed={seed}") for speed, seed in wanted}
    assert len(rows) == len(wanted)
    assert all(row[3] == "Completed" and row[-1] == "0" for row in rows)
    runs = json.loads(run_runs(tenant, "sweep", "-o", "json"))
    assert all(run["seconds"] > 0 and run["jobs"][0]["exitCode"] == 0 for run in runs)
    assert {run["run"] for run in runs} == results.keys()
