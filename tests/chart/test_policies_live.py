"""Grants and membership labels against a tenant who owns his namespace, on the chart as helm installs it."""

import json
import time
from collections.abc import Iterator
from typing import Any

import pytest
from tests.support.chart import NO_WORKLOADS, OPERATOR, SCHEDULER, Chart

from robotapp_testbed.failures import CommandError

pytestmark = pytest.mark.live

TENANT = "--as=tenant-a"
REPLICASETS = "--as=system:serviceaccount:kube-system:replicaset-controller"
AS_SCHEDULER = f"--as={SCHEDULER}"
NAMESPACE = "tenant-a"
GRANT = {"granted.robotics.io/dds-domain": "7"}
MEMBER = {"robotics.io/app-uid": "6b1c", "robotics.io/instance": "", "robotics.io/component": "driver"}


@pytest.fixture(scope="module")
def tenant(chart: Chart) -> Iterator[Chart]:
    """A namespace whose admin is the tenant, bound to the built-in role that the chart extends."""
    chart.install(NO_WORKLOADS)
    chart.plane.kubectl("create", "namespace", NAMESPACE)
    chart.plane.kubectl("create", "rolebinding", "tenant", "--clusterrole=admin", "--user=tenant-a", "-n", NAMESPACE)
    chart.plane.kubectl("wait", "--for=create", "serviceaccount/default", "-n", NAMESPACE, "--timeout=120s")
    await_policies(chart)
    yield chart
    chart.uninstall()  # the namespace goes with the control plane: deleting it takes the controllers 45 s


def await_policies(chart: Chart, *, deadline_s: float = 120) -> None:
    """The API server compiles a new policy in the background, about a second after it was written."""
    until = time.monotonic() + deadline_s
    for manifest in (pod("probe", annotations=GRANT), pod("probe", labels=MEMBER, nodeName="n")):
        while True:
            try:
                chart.plane.kubectl("create", "--dry-run=server", "-f", "-", stdin=manifest)
            except CommandError:
                break
            assert time.monotonic() < until, "the policies never became active"
            time.sleep(0.1)


def pod(
    name: str, *, annotations: dict[str, str] | None = None, labels: dict[str, str] | None = None, **spec: Any
) -> str:
    metadata = {"name": name, "namespace": NAMESPACE, "annotations": annotations or {}, "labels": labels or {}}
    containers = [{"name": "main", "image": "ros:humble"}]
    return json.dumps(
        {"apiVersion": "v1", "kind": "Pod", "metadata": metadata, "spec": {"containers": containers, **spec}}
    )


def create(chart: Chart, manifest: str, who: str = TENANT) -> str:
    return chart.plane.kubectl("create", who, "-f", "-", stdin=manifest)


def refusal(chart: Chart, *arguments: str, stdin: str | None = None) -> str:
    with pytest.raises(CommandError) as caught:
        chart.plane.kubectl(*arguments, stdin=stdin)
    return caught.value.stderr


def bind(chart: Chart, name: str, who: str, **metadata: Any) -> str:
    binding = {
        "apiVersion": "v1",
        "kind": "Binding",
        "metadata": {"name": name, "namespace": NAMESPACE, **metadata},
        "target": {"kind": "Node", "name": "robot-1"},
    }
    path = f"/api/v1/namespaces/{NAMESPACE}/pods/{name}/binding"
    return chart.plane.kubectl("create", "--raw", path, "-f", "-", who, stdin=json.dumps(binding))


def test_a_pod_with_a_forged_grant_is_refused(tenant: Chart) -> None:
    text = refusal(tenant, "create", TENANT, "-f", "-", stdin=pod("forged", annotations=GRANT))
    assert "annotation granted.robotics.io/dds-domain is a grant" in text
    assert "remove it from the pod or its template" in text


def test_not_even_an_admin_creates_a_pod_with_a_grant(tenant: Chart) -> None:
    assert "is a grant" in refusal(
        tenant, "create", "-f", "-", stdin=pod("forged-admin", annotations={"granted.robotics.io/devices": "{}"})
    )


def test_a_grant_is_refused_on_a_running_pod_by_every_road(tenant: Chart) -> None:
    create(tenant, pod("late"))
    for road in ([], ["--subresource=status"]):
        patch = json.dumps({"metadata": {"annotations": GRANT}})
        who = [] if road else [TENANT]
        assert "is a grant" in refusal(
            tenant, "patch", "pod", "late", "-n", NAMESPACE, "--type=merge", "-p", patch, *who, *road
        )


def test_other_annotations_stay_the_tenants(tenant: Chart) -> None:
    create(tenant, pod("ordinary", annotations={"note": "a"}, labels={"robotics.io/instance": "mine"}))
    tenant.plane.kubectl("annotate", "pod", "ordinary", "-n", NAMESPACE, TENANT, "note=b", "other=c", "--overwrite")
    tenant.plane.kubectl(
        "label", "pod", "ordinary", "-n", NAMESPACE, TENANT, "robotics.io/instance=other", "--overwrite"
    )


def test_the_scheduler_grants_by_its_binding_and_the_grant_never_changes(tenant: Chart) -> None:
    create(tenant, pod("granted", schedulerName="ros-aware-scheduler"))
    bind(tenant, "granted", AS_SCHEDULER, annotations=GRANT)
    text = tenant.plane.kubectl("get", "pod", "granted", "-n", NAMESPACE, "-o", "json")
    assert json.loads(text)["metadata"]["annotations"] == GRANT
    for change in (
        "granted.robotics.io/dds-domain=8",
        "granted.robotics.io/dds-domain-",
        "granted.robotics.io/devices=x",
    ):
        assert "it never changes" in refusal(
            tenant, "annotate", "pod", "granted", "-n", NAMESPACE, TENANT, "--overwrite", change
        )
    tenant.plane.kubectl("annotate", "pod", "granted", "-n", NAMESPACE, TENANT, "note=fine")


def test_a_binding_with_a_grant_by_anyone_else_is_refused(tenant: Chart) -> None:
    create(tenant, pod("bound"))
    for road in ("pods/bound/binding", "bindings"):
        binding = {
            "apiVersion": "v1",
            "kind": "Binding",
            "metadata": {"name": "bound", "annotations": GRANT},
            "target": {"kind": "Node", "name": "robot-1"},
        }
        path = f"/api/v1/namespaces/{NAMESPACE}/{road}"
        text = refusal(
            tenant, "create", "--raw", path, "-f", "-", "--as=system:kube-scheduler", stdin=json.dumps(binding)
        )
        assert "only the robotapp scheduler may bind with granted.robotics.io/dds-domain" in text
    bind(tenant, "bound", "--as=system:kube-scheduler", annotations={"note": "fine"})


def test_a_tenant_may_not_bind_at_all(tenant: Chart) -> None:
    create(tenant, pod("unbound"))
    with pytest.raises(CommandError, match="forbidden"):
        bind(tenant, "unbound", TENANT)


def test_a_binding_cannot_make_a_pod_a_member(tenant: Chart) -> None:
    create(tenant, pod("stranger"))
    with pytest.raises(CommandError, match="cannot be set by a Binding"):
        bind(tenant, "stranger", AS_SCHEDULER, labels={"robotics.io/app-uid": "6b1c"})


def test_only_the_replicaset_controller_creates_members(tenant: Chart) -> None:
    text = refusal(tenant, "create", TENANT, "-f", "-", stdin=pod("fake-member", labels=MEMBER))
    assert "created by the ReplicaSet of a RobotApp only" in text
    create(tenant, pod("member", labels=MEMBER), REPLICASETS)


def test_a_members_labels_never_change(tenant: Chart) -> None:
    create(tenant, pod("steady", labels=MEMBER), REPLICASETS)
    for change in (
        "robotics.io/app-uid=other",
        "robotics.io/app-uid-",
        "robotics.io/instance=amr-8",
        "robotics.io/component-",
    ):
        text = refusal(tenant, "label", "pod", "steady", "-n", NAMESPACE, TENANT, "--overwrite", change)
        assert "of a RobotApp pod never changes" in text
    tenant.plane.kubectl("label", "pod", "steady", "-n", NAMESPACE, TENANT, "robotics.io/app-", "color=blue")


def test_a_running_pod_cannot_become_a_member(tenant: Chart) -> None:
    create(tenant, pod("joiner"))
    text = refusal(tenant, "label", "pod", "joiner", "-n", NAMESPACE, TENANT, "robotics.io/app-uid=6b1c")
    assert "never changes" in text


def test_a_member_cannot_be_placed_past_the_scheduler(tenant: Chart) -> None:
    text = refusal(tenant, "create", REPLICASETS, "-f", "-", stdin=pod("preset", labels=MEMBER, nodeName="robot-1"))
    assert "would bypass the check of its DDS domain" in text


def test_a_real_replicaset_creates_members(tenant: Chart) -> None:
    template = {
        "metadata": {"labels": {**MEMBER, "app": "real"}},
        "spec": {"containers": [{"name": "main", "image": "ros:humble"}]},
    }
    deployment = {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": "real", "namespace": NAMESPACE},
        "spec": {"selector": {"matchLabels": {"app": "real"}}, "template": template},
    }
    create(tenant, json.dumps(deployment))
    tenant.plane.kubectl(
        "wait", "--for=jsonpath={.status.replicas}=1", "deployment/real", "-n", NAMESPACE, "--timeout=120s"
    )
    assert "real-" in tenant.plane.kubectl("get", "pods", "-n", NAMESPACE, "-l", "app=real", "-o", "name")


@pytest.mark.parametrize(
    ("verb", "resource", "expected"),
    [
        ("create", "robotapps", "yes"),
        ("delete", "robotapps", "yes"),
        ("update", "robotapps/status", "no"),
        ("create", "robotclaims", "no"),
        ("delete", "robotclaims", "no"),
        ("list", "robotclaims", "no"),
        ("update", "domainpools", "no"),
        ("update", "nodetelemetries", "no"),
    ],
)
def test_a_tenants_rights_in_his_namespace(tenant: Chart, verb: str, resource: str, expected: str) -> None:
    resource, _, subresource = resource.partition("/")
    extra = [f"--subresource={subresource}"] if subresource else []
    answer = tenant.plane.kubectl(
        "auth", "can-i", verb, f"{resource}.robotics.io", *extra, "-n", NAMESPACE, TENANT, check=False
    )
    assert answer.split()[0] == expected


@pytest.mark.parametrize(
    ("who", "verb", "resource", "expected"),
    [
        (SCHEDULER, "create", "pods/binding", "yes"),
        (SCHEDULER, "patch", "pods/status", "yes"),
        (SCHEDULER, "create", "robotclaims.robotics.io", "yes"),
        (SCHEDULER, "delete", "pods", "yes"),
        (SCHEDULER, "list", "poddisruptionbudgets.policy", "yes"),
        (SCHEDULER, "update", "poddisruptionbudgets.policy", "no"),
        (SCHEDULER, "create", "pods/eviction", "no"),
        (SCHEDULER, "update", "pods", "no"),
        (SCHEDULER, "patch", "nodes", "no"),
        (SCHEDULER, "get", "secrets", "no"),
        (OPERATOR, "patch", "deployments.apps", "yes"),
        (OPERATOR, "patch", "robotapps.robotics.io/status", "yes"),
        (OPERATOR, "patch", "domainpools.robotics.io/status", "yes"),
        (OPERATOR, "patch", "domainpools.robotics.io", "no"),
        (OPERATOR, "create", "pods", "no"),
        (OPERATOR, "create", "pods/binding", "no"),
        (OPERATOR, "list", "secrets", "no"),
        (OPERATOR, "create", "clusterrolebindings.rbac.authorization.k8s.io", "no"),
    ],
)
def test_our_components_have_what_they_need_and_no_more(
    tenant: Chart, who: str, verb: str, resource: str, expected: str
) -> None:
    resource, _, subresource = resource.partition("/")
    extra = [f"--subresource={subresource}"] if subresource else []
    answer = tenant.plane.kubectl("auth", "can-i", verb, resource, *extra, "-n", NAMESPACE, f"--as={who}", check=False)
    assert answer.split()[0] == expected
