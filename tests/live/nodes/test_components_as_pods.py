"""Our programs as pods on real nodes, with the chart's ServiceAccounts; operator and scheduler under restricted Pod Security."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from campaigns.nodes import real_pods, walkthrough
from campaigns.nodes import teleop_app as teleop
from robotapp_api.model.names import SCHEDULER_NAME, SYSTEM_NAMESPACE
from robotapp_client.serving.access import REMEMBER_S
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import edge, robot
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

DOCS = Path(__file__).resolve().parents[3] / "docs"
PLUGIN = Path(sys.executable).parent / "kubectl-robotapp"
APP = {
    "apiVersion": "robotics.io/v1alpha1",
    "kind": "RobotApp",
    "metadata": {"name": "pair"},
    "spec": {
        "ros": {"distro": "humble"},
        "components": [
            {
                "name": name,
                "image": "localhost/robotapp-tools:testbed",
                "command": ["/bin/sh", "-c", "echo domain $ROS_DOMAIN_ID; exec sleep 100000"],
            }
            for name in ("talker", "listener")
        ],
    },
}


@pytest.fixture(scope="module")
def cluster(real_machine: type[RealNodes]) -> Iterator[RealNodes]:
    nodes = [robot("robot-1"), edge("edge-1")]
    with real_machine(nodes, delays={}, images=("tools", *components_as_pods.IMAGES), kube_scheduler=True) as cp:
        components_as_pods.run(cp)
        yield cp


def test_both_run_as_the_charts_accounts_and_users_under_restricted_pod_security(cluster: RealNodes) -> None:
    pods = cluster.api.get(f"/api/v1/namespaces/{SYSTEM_NAMESPACE}/pods")["items"]
    accounts = {pod["spec"]["serviceAccountName"] for pod in pods}
    assert accounts == {"robotapp-operator", "robotapp-scheduler"}
    for pod in pods:
        assert pod["spec"]["securityContext"]["runAsNonRoot"] is True
        identity = cluster.kubectl(
            *(
                "exec",
                "-n",
                SYSTEM_NAMESPACE,
                pod["metadata"]["name"],
                "--",
                "python3",
                "-c",
                "import os; print(os.getuid())",
            )
        )
        assert identity.strip() == "65532"


def test_their_namespace_refuses_pods_that_are_not_restricted(cluster: RealNodes) -> None:
    said = cluster.kubectl(
        *("run", "free", "-n", SYSTEM_NAMESPACE, "--image=localhost/robotapp-tools:testbed", "--privileged"),
        check=False,
    )
    assert 'violates PodSecurity "restricted:latest": privileged' in said


def test_an_app_is_planned_bound_and_started_by_them(cluster: RealNodes) -> None:
    with created(cluster, "app-by-pods") as namespace:
        cluster.kubectl("apply", "-n", namespace, "-f", "-", stdin=APP)

        def running() -> list[str]:
            pods = cluster.api.get(f"/api/v1/namespaces/{namespace}/pods")["items"]
            return [pod["metadata"]["name"] for pod in pods if pod["status"]["phase"] == "Running"]

        assert wait_until(lambda: len(running()) == 2, timeout_s=90, poll_s=0.1)
        said = {real_logs(cluster, namespace, name) for name in running()}
        assert said == {f"domain {teleop.domain(cluster, namespace, 'pair')}"}


def real_logs(cp: RealNodes, namespace: str, name: str) -> str:
    assert wait_until(lambda: bool(cp.kubectl("logs", "-n", namespace, name)), timeout_s=real_pods.RUNNING_S)
    return cp.kubectl("logs", "-n", namespace, name).strip()


def test_the_kubelet_tells_what_they_use(cluster: RealNodes) -> None:
    def told() -> bool:
        return len(components_as_pods.usage(cluster)) == 2

    assert wait_until(told, timeout_s=90, poll_s=0.5)
    for used in components_as_pods.usage(cluster).values():
        assert used.node in ("robot-1", "edge-1")
        assert 20e6 < used.memory_bytes < 256e6
        assert used.cpu_s > 0


def robotapp(cp: RealNodes, *arguments: str) -> subprocess.CompletedProcess[str]:
    """kubectl robotapp as a tenant, who has no right at first. Its way to the scheduler is a port-forward."""
    environment = {
        "KUBECONFIG": str(cp.kubeconfig("tenant-b")),
        "HOME": str(cp.run_dir),  # kubectl keeps what it discovers there
        "PATH": f"{cp.run_dir / 'bin'}:/usr/bin:/bin",
        "COLUMNS": "200",
        "PYTHONIOENCODING": "utf-8",
    }
    return subprocess.run([PLUGIN, *arguments], env=environment, capture_output=True, text=True, check=False)


def role(page: str, name: str) -> dict[str, Any]:
    """A role that a page of the documentation shows."""
    found = [
        yaml.safe_load(block) for block in walkthrough.blocks((DOCS / page).read_text()) if f"name: {name}" in block
    ]
    (only,) = (each for each in found if isinstance(each, dict) and each["kind"].endswith("Role"))
    return dict(only)


@contextmanager
def granted(cp: RealNodes, role: str, *, namespace: str = "") -> Iterator[None]:
    """The tenants have a ClusterRole, or a Role of the namespace, as the pages bind it."""
    kind = (
        ("rolebinding", f"--role={role}", "-n", namespace)
        if namespace
        else ("clusterrolebinding", f"--clusterrole={role}")
    )
    cp.kubectl("create", kind[0], role, *kind[1:], "--group=tenants")
    try:
        yield
    finally:
        cp.kubectl("delete", kind[0], role, *kind[2:])


def test_the_roles_of_the_pages_are_enough_to_ask_the_scheduler_and_without_them_the_missing_right_is_named(
    cluster: RealNodes, tmp_path: Path
) -> None:
    for page, name in (("cli.md", "robotapp-ask-scheduler"), ("simulate.md", "robotapp-simulate")):
        cluster.kubectl("apply", "-f", "-", stdin=role(page, name))
    spec = {"schedulerName": SCHEDULER_NAME, "containers": [{"name": "main", "image": "registry.example/part:1"}]}
    waits = {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": "waits"}, "spec": spec}
    (tmp_path / "pod.yaml").write_text(yaml.safe_dump(waits))
    with created(cluster, "rights") as namespace:
        simulate = ("simulate", str(tmp_path / "pod.yaml"), "-n", namespace, "-o", "json")
        what_if = ("what-if", "--node-loss", "edge-1")

        def ends(command: tuple[str, ...], code: int, shows: str = "") -> str:
            """Until it ends like this: the scheduler remembers for a while what a caller may."""
            runs: list[subprocess.CompletedProcess[str]] = []

            def as_wished() -> bool:
                runs.append(robotapp(cluster, *command))
                return (runs[-1].returncode, shows in runs[-1].stderr) == (code, True)

            assert wait_until(as_wished, timeout_s=3 * REMEMBER_S, poll_s=1.0), runs[-1].stderr
            return runs[-1].stdout

        ends(simulate, 1, "robotapp-ask-scheduler of docs/cli.md")
        with granted(cluster, "robotapp-ask-scheduler", namespace=SYSTEM_NAMESPACE):
            ends(simulate, 1, "robotapp-cluster-viewer may")
            with granted(cluster, "robotapp-cluster-viewer"):
                ends(simulate, 1, "docs/simulate.md, section Rights")
                ends(what_if, 1, "you may not get pods")
                with granted(cluster, "view"):
                    ends(what_if, 0)
            with granted(cluster, "robotapp-simulate"):
                placed = json.loads(ends(simulate, 0))["placements"]
        assert {each["name"]: each["node"] in {"robot-1", "edge-1"} for each in placed} == {"waits": True}
