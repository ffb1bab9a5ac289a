"""helm install, upgrade and uninstall on the real API server."""

import base64
import json
import re
import subprocess
import time
from collections.abc import Iterator

import pytest
from tests.live.chart.chart import CRDS, NAMESPACE, NO_WORKLOADS, OPERATOR, Chart, everything, of_kind
from tests.support.work_unit import slowness

from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import CommandError

pytestmark = pytest.mark.live


NO_PODS = {"operator.replicas": "0", "scheduler.replicas": "0"}


@pytest.fixture
def free(chart: Chart) -> Iterator[Chart]:
    """No release is installed before and after; the CRDs stay from test to test, as they do for users.

    Deleting and re-creating CRDs within seconds makes the API server hang in their deletion for a minute or more.
    """
    settle_namespace(chart)
    yield chart
    chart.plane.helm("uninstall", "robotapp", "--namespace", NAMESPACE, "--wait", "--ignore-not-found")


def settle_namespace(chart: Chart) -> None:
    plane = chart.plane
    if f"namespace/{NAMESPACE}" not in plane.kubectl("get", "namespace", "-o", "name").split():
        plane.kubectl("create", "namespace", NAMESPACE)
    for name in (
        "serviceaccount/default",
        "configmap/kube-root-ca.crt",
    ):  # given both, kubectl fails if neither exists yet
        plane.kubectl("wait", "--for=create", name, "-n", NAMESPACE, "--timeout=120s")


def pool_field(chart: Chart, field: str) -> str:
    return chart.plane.kubectl("get", "domainpool", "default", f"--output=jsonpath={{.spec.{field}}}")


APP = {
    "apiVersion": "robotics.io/v1alpha1",
    "kind": "RobotApp",
    "metadata": {"name": "left", "namespace": "default"},
    "spec": {"ros": {"distro": "humble"}, "components": [{"name": "driver", "image": "ros:humble"}]},
}


def settled(chart: Chart, expected: set[str], *, deadline_s: float = 120) -> set[str]:
    """Differences to `expected` once garbage collection and discovery had their time."""
    until = time.monotonic() + deadline_s
    while (difference := everything(chart.plane) ^ expected) and time.monotonic() < until:
        time.sleep(0.5)
    return difference


@pytest.mark.parametrize("afterwards", [False, True], ids=["from-the-start", "decided-later"])
def test_uninstalling_without_keep_leaves_nothing_not_even_users_apps(afterwards: bool) -> None:
    with ControlPlane(kwok=False, controller_manager=True) as plane:
        chart = Chart(plane)
        settle_namespace(chart)
        before = everything(plane)
        if afterwards:
            chart.install(NO_PODS)
            chart.upgrade({**NO_PODS, "crds.keep": "false"})
        else:
            chart.install({**NO_PODS, "crds.keep": "false"})
        plane.kubectl("create", "-f", "-", stdin=json.dumps(APP))
        during = everything(plane)
        assert {f"resource/{name}" for name in CRDS} <= during - before
        assert {"DomainPool//default", "RobotApp/default/left", f"Deployment/{NAMESPACE}/robotapp-operator"} <= during
        chart.uninstall()
        assert settled(chart, before) == set()
        assert plane.kubectl("get", "leases", "-n", NAMESPACE, "-o", "name") == ""


def test_a_rollback_across_keep_deletes_no_pool_and_no_app() -> None:
    """At the first installation the pool is a hook: a revision without it, to which a rollback went back by deleting it."""
    with ControlPlane(kwok=False, controller_manager=True) as plane:
        chart = Chart(plane)
        settle_namespace(chart)
        before = everything(plane)
        chart.install(NO_PODS)
        chart.upgrade({**NO_PODS, "crds.keep": "false"})
        plane.kubectl("create", "-f", "-", stdin=json.dumps(APP))
        uid = plane.kubectl("get", "domainpool", "default", "--output=jsonpath={.metadata.uid}")
        for revision in ("1", "2", "1", "2"):
            plane.helm("rollback", "robotapp", revision, "--namespace", NAMESPACE, "--wait")
            assert plane.kubectl("get", "domainpool", "default", "--output=jsonpath={.metadata.uid}") == uid
            assert plane.kubectl("get", "robotapp", "left", "-n", "default", "-o", "name")
        chart.uninstall()
        assert settled(chart, before) == set()


def test_leases_go_with_the_release_and_one_that_was_there_before_is_no_obstacle(free: Chart) -> None:
    plane = free.plane
    body = {
        "apiVersion": "coordination.k8s.io/v1",
        "kind": "Lease",
        "metadata": {"name": "robotapp-scheduler", "namespace": NAMESPACE},
    }
    plane.kubectl("create", "-f", "-", stdin=json.dumps(body))
    free.install(NO_WORKLOADS)
    free.upgrade(NO_WORKLOADS)
    free.uninstall()
    assert plane.kubectl("get", "leases", "-n", NAMESPACE, "-o", "name").split() == [
        "lease.coordination.k8s.io/robotapp-scheduler"
    ]
    plane.kubectl("delete", "lease", "robotapp-scheduler", "-n", NAMESPACE)


def test_by_default_the_crds_the_pool_and_users_apps_stay(free: Chart) -> None:
    free.install(NO_WORKLOADS)
    free.plane.kubectl("apply", "-f", "-", stdin=json.dumps(APP))
    free.uninstall()
    left = {item for item in everything(free.plane) if "robot" in item.lower() or item.startswith("DomainPool/")}
    kept = {f"CustomResourceDefinition//{name}" for name in CRDS} | {f"resource/{name}" for name in CRDS}
    ours = {"DomainPool//default", "RobotApp/default/left", "APIService//v1alpha1.robotics.io"}
    namespaced = {item for item in left if f"/{NAMESPACE}/" in item or item == f"Namespace//{NAMESPACE}"}
    assert left - namespaced == kept | ours
    assert namespaced == {
        f"Namespace//{NAMESPACE}",
        f"ServiceAccount/{NAMESPACE}/default",
        f"ConfigMap/{NAMESPACE}/kube-root-ca.crt",
    }


@pytest.mark.parametrize("propagation", ["background", "foreground"])
def test_an_app_with_allocated_devices_ends_at_once_also_after_uninstall(free: Chart, propagation: str) -> None:
    plane = free.plane
    free.install(NO_WORKLOADS)
    plane.kubectl("apply", "-f", "-", stdin=json.dumps(APP))
    app_uid = plane.kubectl("get", "robotapp", "left", "--output=jsonpath={.metadata.uid}")
    owner = {"apiVersion": APP["apiVersion"], "kind": "RobotApp", "name": "left", "uid": app_uid, "controller": True}
    request = {"name": "arm", "exactly": {"deviceClassName": DRIVER}}
    claim = {
        "apiVersion": "resource.k8s.io/v1",
        "kind": "ResourceClaim",
        "metadata": {"name": "left-driver", "namespace": "default", "ownerReferences": [owner]},
        "spec": {"devices": {"requests": [request]}},
    }
    plane.kubectl("create", f"--as={OPERATOR}", "-f", "-", stdin=json.dumps(claim))
    user = {"apiGroup": "robotics.io", "resource": "robotapps", "name": "left", "uid": app_uid}
    result = {"request": "arm", "driver": DRIVER, "pool": "robot-1", "device": "serial-1"}
    status = {"allocation": {"devices": {"results": [result]}}, "reservedFor": [user]}
    patch = ("patch", "resourceclaim", "left-driver", "--subresource=status", "--type=merge")
    plane.kubectl(*patch, "-p", json.dumps({"status": status}))
    free.uninstall()
    plane.kubectl("delete", "robotapp", "left", f"--cascade={propagation}", "--wait=false")
    plane.kubectl(
        "wait", "--for=delete", "robotapp/left", "resourceclaim/left-driver", f"--timeout={5 * slowness():.0f}s"
    )


def test_a_new_installation_takes_the_kept_pool_over(free: Chart) -> None:
    free.install(NO_WORKLOADS)
    free.uninstall()
    free.install({**NO_WORKLOADS, "domainPool.quarantineSeconds": "5"})
    assert pool_field(free, "quarantineSeconds") == "5"


def test_an_upgrade_changes_the_pool(free: Chart) -> None:
    free.install(NO_WORKLOADS)
    free.upgrade({**NO_WORKLOADS, "domainPool.ids": "1-50"})
    free.upgrade({**NO_WORKLOADS, "domainPool.ids": "1-60"})
    assert pool_field(free, "ids") == "1-60"


def test_another_name_for_the_pool_is_refused_because_two_pools_would_have_all_ids(free: Chart) -> None:
    free.install(NO_WORKLOADS)
    for values in ({"domainPool.name": "fleet"}, {"domainPool.name": "fleet", "domainPool.network": "yard"}):
        with pytest.raises(CommandError, match="this release has DomainPool default, which would stay beside fleet"):
            free.upgrade({**NO_WORKLOADS, **values})
    free.upgrade({**NO_WORKLOADS, "domainPool.create": "false"})
    assert pool_field(free, "ids") == "1-101,215-232"


def test_the_notes_name_three_commands_that_prove_the_installation(free: Chart) -> None:
    notes = free.install(NO_PODS)
    assert "Three commands prove it" in notes
    assert notes.count("\n  kubectl ") + notes.count("\n  printf ") == 3
    assert pool_field(free, "ids") == "1-101,215-232"


def test_the_example_of_the_notes_is_accepted(free: Chart) -> None:
    notes = free.install(NO_PODS)
    found = re.search(r"^  (printf .*?)\| kubectl apply", notes, re.DOTALL | re.MULTILINE)
    assert found, notes
    manifest = subprocess.run(["sh", "-c", found[1].rstrip(" \\\n")], capture_output=True, text=True, check=True).stdout
    free.plane.kubectl("apply", "--dry-run=server", "--validate=strict", "-f", "-", stdin=manifest)


def test_every_switch_gives_objects_the_server_accepts(free: Chart) -> None:
    free.install(NO_WORKLOADS)
    objects = free.render({"networkPolicy.enabled": "true", "operator.watchNamespaces": "{default}"})
    text = json.dumps({"apiVersion": "v1", "kind": "List", "items": objects})
    free.plane.kubectl(
        "apply", "--server-side", "--force-conflicts", "--dry-run=server", "--validate=strict", "-f", "-", stdin=text
    )


def test_our_pods_are_admitted_to_a_restricted_namespace(free: Chart) -> None:
    free.plane.kubectl("label", "namespace", NAMESPACE, "pod-security.kubernetes.io/enforce=restricted", "--overwrite")
    free.install(NO_WORKLOADS)
    for deployment in of_kind(free.render(), "Deployment"):
        template = deployment["spec"]["template"]
        pod = {
            "apiVersion": "v1",
            "kind": "Pod",
            "metadata": {**template["metadata"], "generateName": "x-", "namespace": NAMESPACE},
        }
        free.plane.kubectl("create", "--dry-run=server", "-f", "-", stdin=json.dumps({**pod, "spec": template["spec"]}))


def test_the_key_is_made_once_and_an_upgrade_keeps_it_and_what_was_added(free: Chart) -> None:
    def keys() -> dict[str, str]:
        text = free.plane.kubectl("get", "secret", "robotapp-agent-key", "-n", "robotapp-agent", "-o", "json")
        return dict(json.loads(text)["data"])

    free.install(NO_PODS)
    first = keys()
    assert [len(base64.b64decode(key)) for key in first.values()] == [32]
    free.upgrade(NO_PODS)
    assert keys() == first
    added = base64.b64encode(bytes(32)).decode()
    patch = ["patch", "secret", "robotapp-agent-key", "-n", "robotapp-agent", "--type=merge"]
    free.plane.kubectl(*patch, "-p", json.dumps({"data": {"key-02": added}}))
    free.upgrade({**NO_PODS, "agent.intervalSeconds": "5"})
    assert keys() == {**first, "key-02": added}
    free.plane.kubectl(*patch, "-p", json.dumps({"data": {"key-01": None}}))
    free.upgrade(NO_PODS)
    assert keys() == {"key-02": added}


def test_the_agents_pod_is_admitted_to_its_namespace_and_without_the_nodes_folders_to_a_restricted_one(
    free: Chart,
) -> None:
    free.install(NO_PODS)
    template = of_kind(free.render(NO_PODS), "DaemonSet")[0]["spec"]["template"]
    kind = {"apiVersion": "v1", "kind": "Pod"}
    pod = {**kind, "metadata": {"generateName": "x-", "namespace": "robotapp-agent"}, "spec": template["spec"]}
    free.plane.kubectl("create", "--dry-run=server", "-f", "-", stdin=json.dumps(pod))
    label = ("label", "namespace", "robotapp-agent", "pod-security.kubernetes.io/enforce=restricted", "--overwrite")
    free.plane.kubectl(*label)
    refusal = free.plane.kubectl("create", "--dry-run=server", "-f", "-", stdin=json.dumps(pod), check=False)
    assert 'restricted volume types (volumes "sys", "dev", "udev" use restricted volume type "hostPath")' in refusal
    told = refusal.partition('violates PodSecurity "restricted:latest": ')[2]
    assert told.count("(") == 1, f"more than the volumes: {told}"
