"""Grants, membership labels and instances against a tenant who owns his namespace, on the chart as helm installs it."""

import json
import time
from collections.abc import Iterator
from typing import Any

import pytest
from tests.live.chart.chart import NO_WORKLOADS, OPERATOR, SCHEDULER, Chart

from robotapp_testbed.failures import CommandError

pytestmark = pytest.mark.live

TENANT = "--as=tenant-a"
DEPUTY = "--as=deputy"
REPLICASETS = "--as=system:serviceaccount:kube-system:replicaset-controller"
AS_SCHEDULER = f"--as={SCHEDULER}"
NAMESPACE = "tenant-a"
GRANT = {"granted.robotics.io/dds-domain": "7"}
INSTANCES = "robotappinstances.robotics.io"
AS_OPERATOR = f"--as={OPERATOR}"
MEMBER = {"robotics.io/app-uid": "6b1c", "robotics.io/instance": "", "robotics.io/component": "driver"}


@pytest.fixture(scope="module")
def tenant(chart: Chart) -> Iterator[Chart]:
    """A namespace whose admin is the tenant, bound to the built-in role that the chart extends."""
    chart.install(NO_WORKLOADS)
    chart.plane.learn_new_kinds()
    chart.plane.kubectl("create", "namespace", NAMESPACE)
    chart.plane.kubectl("create", "rolebinding", "tenant", "--clusterrole=admin", "--user=tenant-a", "-n", NAMESPACE)
    # As much as a cluster's owner can give away inside a namespace; "deputy" has it, the tenant only what the chart gives.
    chart.plane.kubectl("create", "role", "all-of-ours", "--verb=*", "--resource=*.robotics.io", "-n", NAMESPACE)
    chart.plane.kubectl("create", "rolebinding", "deputy", "--role=all-of-ours", "--user=deputy", "-n", NAMESPACE)
    chart.plane.kubectl("wait", "--for=create", "serviceaccount/default", "-n", NAMESPACE, "--timeout=120s")
    await_policies(chart)
    yield chart
    chart.plane.kubectl("delete", INSTANCES, "--all", "-n", NAMESPACE)
    chart.uninstall()  # the namespace goes with the control plane: deleting it takes the controllers 45 s


def await_policies(chart: Chart, *, deadline_s: float = 120) -> None:
    """The API server compiles a new policy in the background, about a second after it was written."""
    until = time.monotonic() + deadline_s
    for manifest in (
        pod("probe", annotations=GRANT),
        pod("probe", labels=MEMBER, nodeName="n"),
        instance("probe"),
    ):
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


def instance(name: str, **metadata: Any) -> str:
    return json.dumps(
        {
            "apiVersion": "robotics.io/v1alpha1",
            "kind": "RobotAppInstance",
            "metadata": {"name": name, "namespace": NAMESPACE, **metadata},
            "spec": {"app": "teleop", "appUID": "6b1c"},
        }
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


def test_a_better_node_is_the_schedulers_proposal_alone(tenant: Chart) -> None:
    proposal = "robotics.io/better-node"
    says = "is the robotapp scheduler's proposal"
    text = refusal(tenant, "create", TENANT, "-f", "-", stdin=pod("proposed", annotations={proposal: "x"}))
    assert says in text
    create(tenant, pod("proposed"))
    annotate = ("annotate", "pod", "proposed", "-n", NAMESPACE, "--overwrite")
    assert says in refusal(tenant, *annotate, TENANT, f"{proposal}=x")
    scheduler = (AS_SCHEDULER, "--as-group=system:masters")  # kubectl reads the pod before, which the scheduler may not
    tenant.plane.kubectl(*annotate, *scheduler, f"{proposal}=x")
    tenant.plane.kubectl(*annotate, TENANT, "note=fine")
    assert says in refusal(tenant, *annotate, TENANT, f"{proposal}-")
    tenant.plane.kubectl(*annotate, *scheduler, f"{proposal}-")


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
    assert "created by the ReplicaSet or Job of a RobotApp only" in text
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


@pytest.mark.parametrize("who", [DEPUTY, "--as=system:serviceaccount:tenant-a:robotapp-operator", ""])
def test_only_the_operator_creates_an_instance(tenant: Chart, who: str) -> None:
    """Neither somebody with every right of ours in the namespace, nor an account of the same name, nor the cluster's admin."""
    text = refusal(tenant, "create", *filter(None, [who]), "-f", "-", stdin=instance("invented"))
    if "serviceaccount" in who:
        assert "cannot create resource" in text
    else:
        assert "RobotAppInstance invented shows what the robotapp operator found" in text
        assert "create a RobotApp, and its instances appear" in text


def test_only_the_operator_writes_the_status_of_an_instance(tenant: Chart) -> None:
    create(tenant, instance("watched"), AS_OPERATOR)
    stopped = ["patch", INSTANCES, "watched", "-n", NAMESPACE, "--subresource=status", "--type=merge"]
    for who in ([DEPUTY], []):
        text = refusal(tenant, *stopped, *who, "-p", json.dumps({"status": {"phase": "Stopping"}}))
        assert "RobotAppInstance watched shows what the robotapp operator found" in text
        assert "change the RobotApp instead" in text
    seen = json.loads(instance("watched")) | {"status": {"phase": "Running"}}
    by_operator = ["apply", "--server-side", "--subresource=status", AS_OPERATOR, "-f", "-"]
    tenant.plane.kubectl(*by_operator, stdin=json.dumps(seen))
    phase = tenant.plane.kubectl("get", INSTANCES, "watched", "-n", NAMESPACE, TENANT, "-o", "jsonpath={.status.phase}")
    assert phase == "Running"


def test_deletion_and_metadata_of_an_instance_are_left_to_rbac(tenant: Chart) -> None:
    create(tenant, instance("leaf", finalizers=["example.com/hold"]), AS_OPERATOR)
    where = ["leaf", "-n", NAMESPACE]
    tenant.plane.kubectl("label", INSTANCES, *where, DEPUTY, "note=mine")
    tenant.plane.kubectl("delete", INSTANCES, *where, DEPUTY, "--wait=false")
    release = json.dumps({"metadata": {"finalizers": None, "ownerReferences": None}})
    tenant.plane.kubectl("patch", INSTANCES, *where, DEPUTY, "--type=merge", "-p", release)
    assert tenant.plane.kubectl("get", INSTANCES, *where, "--ignore-not-found") == ""


@pytest.mark.parametrize("cascade", ["background", "foreground", "orphan"])
def test_an_instance_goes_with_its_app_or_is_orphaned_as_its_deletion_says(tenant: Chart, cascade: str) -> None:
    app = {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "metadata": {"name": cascade, "namespace": NAMESPACE},
        "spec": {"ros": {"distro": "humble"}, "components": [{"name": "driver", "image": "ros:humble"}]},
    }
    create(tenant, json.dumps(app))
    uid = tenant.plane.kubectl("get", "robotapp", cascade, "-n", NAMESPACE, "-o", "jsonpath={.metadata.uid}")
    owner = {"apiVersion": app["apiVersion"], "kind": "RobotApp", "name": cascade, "uid": uid, "controller": True}
    create(tenant, instance(f"of-{cascade}", ownerReferences=[owner | {"blockOwnerDeletion": False}]), AS_OPERATOR)
    tenant.plane.kubectl(
        "delete", "robotapp", cascade, "-n", NAMESPACE, TENANT, f"--cascade={cascade}", "--timeout=120s"
    )
    where = [f"{INSTANCES}/of-{cascade}", "-n", NAMESPACE]
    if cascade == "orphan":
        owners = ["-o", "jsonpath={.metadata.ownerReferences}"]
        assert tenant.plane.kubectl("get", *where, *owners) == ""
    else:
        tenant.plane.kubectl("wait", "--for=delete", *where, "--timeout=120s")


@pytest.mark.parametrize(
    ("verb", "resource", "expected"),
    [
        ("create", "robotapps", "yes"),
        ("delete", "robotapps", "yes"),
        ("update", "robotapps/status", "no"),
        ("list", "robotappinstances", "yes"),
        ("get", "robotappinstances/status", "yes"),
        ("create", "robotappinstances", "no"),
        ("update", "robotappinstances", "no"),
        ("delete", "robotappinstances", "no"),
        ("patch", "robotappinstances/status", "no"),
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
        (OPERATOR, "create", "robotappinstances.robotics.io", "yes"),
        (OPERATOR, "delete", "robotappinstances.robotics.io", "yes"),
        (OPERATOR, "patch", "robotappinstances.robotics.io/status", "yes"),
        (OPERATOR, "patch", "robotappinstances.robotics.io", "no"),
        (SCHEDULER, "get", "robotappinstances.robotics.io", "no"),
        (SCHEDULER, "create", "robotappinstances.robotics.io", "no"),
        (OPERATOR, "patch", "domainpools.robotics.io/status", "yes"),
        (OPERATOR, "patch", "domainpools.robotics.io", "no"),
        (OPERATOR, "create", "pods", "no"),
        (OPERATOR, "create", "pods/eviction", "yes"),
        (OPERATOR, "delete", "pods", "no"),
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


def device_claim(name: str, *, owner: bool = False, labels: dict[str, str] | None = None) -> str:
    app = {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "name": "teleop",
        "uid": "6b1c",
        "controller": True,
    }
    metadata = {"name": name, "namespace": NAMESPACE, "labels": labels or {}, "ownerReferences": [app] if owner else []}
    request = {"name": "d", "exactly": {"deviceClassName": "devices.robotics.io"}}
    return json.dumps(
        {
            "apiVersion": "resource.k8s.io/v1",
            "kind": "ResourceClaim",
            "metadata": metadata,
            "spec": {"devices": {"requests": [request]}},
        }
    )


def test_a_resource_claim_of_a_robotapp_is_made_by_the_operator_alone(tenant: Chart) -> None:
    plane = tenant.plane
    plane.kubectl("create", "role", "claims", "--verb=*", "--resource=resourceclaims.resource.k8s.io", "-n", NAMESPACE)
    plane.kubectl("create", "rolebinding", "claims", "--role=claims", "--user=tenant-a", "-n", NAMESPACE)
    plane.kubectl("create", "-f", "-", TENANT, stdin=device_claim("mine"))
    for wrong in (device_claim("forged", owner=True), device_claim("forged", labels=MEMBER)):
        with pytest.raises(CommandError, match="made by the robotapp operator alone"):
            plane.kubectl("create", "-f", "-", TENANT, stdin=wrong)
    with pytest.raises(CommandError, match="never change"):
        plane.kubectl("label", "resourceclaim", "mine", "robotics.io/app-uid=6b1c", "-n", NAMESPACE, TENANT)
    plane.kubectl("create", "-f", "-", AS_OPERATOR, stdin=device_claim("made", owner=True, labels=MEMBER))
    for verb in ("get", "list", "watch", "create", "delete"):
        plane.kubectl("auth", "can-i", verb, "resourceclaims.resource.k8s.io", "-n", NAMESPACE, AS_OPERATOR)
    for verb in ("patch", "update"):
        with pytest.raises(CommandError):
            plane.kubectl(
                "auth",
                "can-i",
                verb,
                "resourceclaims.resource.k8s.io",
                "--subresource=status",
                "-n",
                NAMESPACE,
                AS_OPERATOR,
            )
    plane.kubectl("delete", "resourceclaims", "mine", "-n", NAMESPACE, TENANT)
    plane.kubectl("delete", "resourceclaims", "made", "-n", NAMESPACE, "--ignore-not-found", AS_OPERATOR)
