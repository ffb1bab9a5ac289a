"""helm install, upgrade and uninstall on the real API server."""

import json
import time
from collections.abc import Iterator

import pytest

from tests.support.chart import NAMESPACE, NO_WORKLOADS, Chart, everything, of_kind

pytestmark = pytest.mark.live


@pytest.fixture
def empty(chart: Chart) -> Iterator[Chart]:
    """The release's namespace exists and is settled; whatever a test leaves is removed."""
    plane = chart.plane
    if NAMESPACE not in plane.kubectl("get", "namespace", "-o", "name"):
        plane.kubectl("create", "namespace", NAMESPACE)
    plane.kubectl("wait", "--for=create", "serviceaccount/default", "configmap/kube-root-ca.crt", "-n", NAMESPACE, "--timeout=30s")
    yield chart
    plane.helm("uninstall", "robotapp", "--namespace", NAMESPACE, "--wait", "--ignore-not-found")
    plane.kubectl("delete", "crd", "--ignore-not-found", *CRDS)


CRDS = [f"{plural}.robotics.io" for plural in ("robotapps", "robotclaims", "domainpools", "nodetelemetries")]


def settled(chart: Chart, expected: set[str], *, deadline_s: float = 30) -> set[str]:
    """Differences to `expected` once garbage collection and discovery had their time."""
    until = time.monotonic() + deadline_s
    while (difference := everything(chart.plane) ^ expected) and time.monotonic() < until:
        time.sleep(0.5)
    return difference


def test_uninstalling_without_keep_leaves_nothing(empty: Chart) -> None:
    before = everything(empty.plane)
    empty.install({"crds.keep": "false", "operator.replicas": "0", "scheduler.replicas": "0"})
    during = everything(empty.plane)
    assert {f"resource/{name}" for name in CRDS} <= during - before
    assert "DomainPool//default" in during
    empty.uninstall()
    assert settled(empty, before) == set()


def test_uninstalling_without_keep_takes_users_apps_and_claims_along(empty: Chart) -> None:
    before = everything(empty.plane)
    empty.install({**NO_WORKLOADS, "crds.keep": "false"})
    app = {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "metadata": {"name": "left", "namespace": "default"},
        "spec": {"components": [{"name": "driver", "image": "ros:humble"}]},
    }
    empty.plane.kubectl("create", "-f", "-", stdin=json.dumps(app))
    empty.uninstall()
    assert settled(empty, before) == set()


def test_by_default_the_crds_the_pool_and_users_apps_stay(empty: Chart) -> None:
    before = everything(empty.plane)
    empty.install(NO_WORKLOADS)
    empty.uninstall()
    kept = {f"CustomResourceDefinition//{name}" for name in CRDS} | {f"resource/{name}" for name in CRDS} | {"DomainPool//default"}
    new = everything(empty.plane) - before
    assert {item for item in new if not item.startswith("APIService/")} == kept


def test_a_new_installation_takes_the_kept_pool_over(empty: Chart) -> None:
    empty.install(NO_WORKLOADS)
    empty.uninstall()
    empty.install({**NO_WORKLOADS, "domainPool.quarantineSeconds": "5"})
    assert pool_field(empty, "quarantineSeconds") == "5"


def test_an_upgrade_changes_the_pool(empty: Chart) -> None:
    empty.install(NO_WORKLOADS)
    empty.upgrade({**NO_WORKLOADS, "domainPool.ids": "1-50"})
    empty.upgrade({**NO_WORKLOADS, "domainPool.ids": "1-60"})
    assert pool_field(empty, "ids") == "1-60"


def test_the_notes_name_three_commands_that_prove_the_installation(empty: Chart) -> None:
    notes = empty.install(NO_WORKLOADS)
    assert "Three commands prove it" in notes
    assert notes.count("\n  kubectl ") + notes.count("\n  printf ") == 3
    assert pool_field(empty, "ids") == "1-101,215-232"


def test_every_switch_gives_objects_the_server_accepts(empty: Chart) -> None:
    empty.install(NO_WORKLOADS)
    objects = empty.render({"networkPolicy.enabled": "true", "operator.watchNamespaces": "{default}"})
    text = json.dumps({"apiVersion": "v1", "kind": "List", "items": objects})
    empty.plane.kubectl("apply", "--server-side", "--force-conflicts", "--dry-run=server", "--validate=strict", "-f", "-", stdin=text)


def test_our_pods_are_admitted_to_a_restricted_namespace(empty: Chart) -> None:
    empty.plane.kubectl("label", "namespace", NAMESPACE, "pod-security.kubernetes.io/enforce=restricted", "--overwrite")
    empty.install(NO_WORKLOADS)
    for deployment in of_kind(empty.render(), "Deployment"):
        template = deployment["spec"]["template"]
        pod = {"apiVersion": "v1", "kind": "Pod", "metadata": {**template["metadata"], "generateName": "x-", "namespace": NAMESPACE}}
        empty.plane.kubectl("create", "--dry-run=server", "-f", "-", stdin=json.dumps({**pod, "spec": template["spec"]}))
