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


def test_each_node_has_an_agent_within_its_memory_and_its_telemetry_belongs_to_the_node(cluster: RealNodes) -> None:
    components_as_pods.wait_measured(cluster)

    def told() -> bool:
        return len(components_as_pods.usage(cluster, components_as_pods.AGENTS)) == 2

    assert wait_until(told, timeout_s=90, poll_s=0.5)
    used = components_as_pods.usage(cluster, components_as_pods.AGENTS).values()
    assert {each.node for each in used} == {"robot-1", "edge-1"}
    assert max(each.rss_bytes for each in used) <= 45e6
    for item in cluster.api.get(components_as_pods.TELEMETRY)["items"]:
        (owner,) = item["metadata"]["ownerReferences"]
        node = cluster.api.get(f"/api/v1/nodes/{item['metadata']['name']}")
        assert (owner["kind"], owner["uid"]) == ("Node", node["metadata"]["uid"])


def test_an_agent_cannot_open_a_device_of_its_node_or_write_there(cluster: RealNodes) -> None:
    """It runs in a namespace that allows all of that."""
    pods = cluster.api.get(f"/api/v1/namespaces/{components_as_pods.AGENTS}/pods")["items"]
    where = ("exec", "-n", components_as_pods.AGENTS, pods[0]["metadata"]["name"], "--", "python3", "-c")
    cluster.kubectl(*where, "import os; assert os.getuid() == 65532; os.listdir('/host/dev'); os.listdir('/host/sys')")
    for path, mode in (("/host/dev/kmsg", "rb"), ("/host/sys/x", "wb"), ("/host/dev/x", "wb"), ("/etc/x", "wb")):
        refusal = cluster.kubectl(*where, f"open({path!r}, {mode!r})", check=False)
        assert "Permission" in refusal or "not permitted" in refusal or "Read-only" in refusal, f"{path}: {refusal}"
