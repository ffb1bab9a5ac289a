"""Our programs as pods on real nodes, with the chart's ServiceAccounts; operator and scheduler under restricted Pod Security."""

from collections.abc import Iterator

import pytest
from tests.support import real_pods, teleop

from robotapp_api.model.names import SYSTEM_NAMESPACE
from robotapp_testbed import components_as_pods, wait_until
from robotapp_testbed.namespaces import created
from robotapp_testbed.nodes import edge, robot
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

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
