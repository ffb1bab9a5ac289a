"""Our product on the testbed: rights and policies decide from the first moment, programs are ordinary processes."""

import urllib.request
from datetime import UTC, datetime

import pytest

from campaigns.rigs.quiet import refused_since
from robotapp_testbed import ApiStatusError, ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.servers import unverified
from robotapp_testbed.processes import guard

pytestmark = pytest.mark.live


def test_policies_decide_as_soon_as_install_returns(installed_plane: ControlPlane) -> None:
    pod = {
        "metadata": {"name": "forged", "annotations": {"granted.robotics.io/dds-domain": "7"}},
        "spec": {"containers": [{"name": "main", "image": "registry.invalid/main:1"}]},
    }
    with pytest.raises(ApiStatusError, match="is a grant"):
        installed_plane.api.create("/api/v1/namespaces/default/pods", pod)


def test_installing_again_changes_nothing(installed_plane: ControlPlane) -> None:
    path = "/apis/robotics.io/v1alpha1/domainpools/default"
    product.install(installed_plane)  # takes back the fields that other tests may have written
    before = installed_plane.api.get(path)["metadata"]["resourceVersion"]
    product.install(installed_plane)
    assert installed_plane.api.get(path)["metadata"]["resourceVersion"] == before


def test_no_workload_of_the_chart_is_installed(installed_plane: ControlPlane) -> None:
    assert "No resources found" in installed_plane.kubectl(
        "get", "deployments,pods", "-n", "robotapp-system", check=False
    )


@pytest.mark.parametrize(
    ("identity", "verb", "resource", "answer"),
    [
        ("operator", "create", "deployments.apps", "yes"),
        ("operator", "create", "pods/binding", "no"),
        ("scheduler", "create", "pods/binding", "yes"),
        ("tenant", "create", "robotapps.robotics.io", "no"),
    ],
)
def test_identities_have_the_rights_of_the_chart(
    identity: str, verb: str, resource: str, answer: str, installed_plane: ControlPlane
) -> None:
    asked = ["auth", "can-i", verb, *resource.split("/")[:1], "--all-namespaces"]
    asked += [f"--subresource={part}" for part in resource.split("/")[1:]]
    assert installed_plane.kubectl(*asked, identity=identity, check=False).splitlines()[-1] == answer


def test_children_go_with_their_app_from_the_first_moment() -> None:
    with ControlPlane(kwok=False) as plane:
        product.install(plane)
        plane.api.create("/api/v1/namespaces", {"metadata": {"name": "young"}})
        apps, children = "/apis/robotics.io/v1alpha1/namespaces/young/robotapps", "/api/v1/namespaces/young/configmaps"
        app = plane.api.create(
            apps,
            {
                "apiVersion": "robotics.io/v1alpha1",
                "kind": "RobotApp",
                "metadata": {"name": "parent"},
                "spec": {
                    "ros": {"distro": "humble"},
                    "components": [{"name": "only", "image": "registry.invalid/only:1"}],
                },
            },
        )
        owner = {
            "apiVersion": app["apiVersion"],
            "kind": "RobotApp",
            "name": "parent",
            "uid": app["metadata"]["uid"],
        }
        plane.api.create(children, {"metadata": {"name": "child", "ownerReferences": [owner]}})
        plane.api.delete(f"{apps}/parent")
        gone = wait_until(
            lambda: all(item["metadata"]["name"] != "child" for item in plane.api.get(children)["items"]), timeout_s=25
        )
        assert gone


def test_a_local_operator_serves_and_ends_with_its_control_plane() -> None:
    with ControlPlane(kwok=False) as plane:
        product.install(plane)
        operator = product.start_operator(plane, sweep_seconds=1)
        with urllib.request.urlopen(f"{operator.health_url}/readyz", timeout=30, context=unverified()) as answer:  # noqa: S310 - our own loopback URL
            assert answer.status == 200
        assert operator.log_path.parent == plane.logs_dir
        second = product.start_operator(plane, name="operator-2", wait=False)
        operator.kill()
        assert plane.pids().keys() >= {"etcd", "operator-2"}
        assert "operator" not in plane.pids()
    assert guard.start_time(second.pid) is None


def test_what_a_component_has_no_right_to_is_noticed(installed_plane: ControlPlane) -> None:
    began = datetime.now(UTC)
    installed_plane.kubectl("get", "secrets", "-n", "kube-system", identity="scheduler", check=False)
    installed_plane.kubectl("get", "nodes", identity="scheduler")
    wanted = {"robotapp-scheduler list /api/v1/namespaces/kube-system/secrets"}
    assert wait_until(lambda: refused_since(installed_plane, began) == wanted, timeout_s=60.0, poll_s=0.2)
