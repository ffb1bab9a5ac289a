"""What a reviewer ticks on the rendered manifests (CIS Kubernetes Benchmark section 5)."""

import json
import re

import pytest
from tests.live.chart.chart import (
    CHART,
    NAMESPACE,
    NO_KEY,
    NO_WORKLOADS,
    Chart,
    Object,
    flags,
    named,
    of_kind,
    pod_spec,
    rules,
)

from robotapp_api.checks.host_access.table import HostRight
from robotapp_api.model.names import FLEET_CONFIG_MAP, SCHEDULER_NAME, SYSTEM_NAMESPACE
from robotapp_operator.plan.status.fleet import MAX_SHARDS
from robotapp_testbed.failures import CommandError

pytestmark = pytest.mark.live

TUNER = "robotapp-scheduler-tuner"
WRITES = {"create", "update", "patch", "delete", "deletecollection"}


def test_no_role_has_a_wildcard(rendered: list[Object]) -> None:
    for role, rule in rules(rendered):
        assert "*" not in [*rule["apiGroups"], *rule["resources"], *rule["verbs"]], role


def test_no_role_reaches_secrets_tokens_or_roles(rendered: list[Object]) -> None:
    for role, rule in rules(rendered):
        assert not {"secrets", "serviceaccounts", "serviceaccounts/token"} & set(rule["resources"]), role
        assert not {"escalate", "bind", "impersonate"} & set(rule["verbs"]), role
        assert "rbac.authorization.k8s.io" not in rule["apiGroups"], role


def test_no_role_writes_nodes_or_runs_things_in_pods(rendered: list[Object]) -> None:
    for role, rule in rules(rendered):
        if {"nodes", "nodes/status"} & set(rule["resources"]):
            assert not WRITES & set(rule["verbs"]), role
        assert not {"pods/exec", "pods/attach", "pods/ephemeralcontainers", "pods/portforward"} & set(
            rule["resources"]
        ), role
        if "pods" in rule["resources"]:
            assert "create" not in rule["verbs"], role
            # Preemption takes lower pods away; nothing of the operator's ever deletes one.
            assert "delete" not in rule["verbs"] or role == "ClusterRole/robotapp-scheduler", role


def test_only_our_components_may_write_claims(rendered: list[Object]) -> None:
    writers = {
        role
        for role, rule in rules(rendered)
        if {"robotclaims", "robotclaims/status"} & set(rule["resources"]) and WRITES & set(rule["verbs"])
    }
    assert writers == {"ClusterRole/robotapp-operator", "ClusterRole/robotapp-scheduler"}


def test_only_the_operator_may_write_instances_and_tenants_read_them(rendered: list[Object]) -> None:
    found: dict[str, dict[str, set[str]]] = {}
    for role, rule in rules(rendered):
        for resource in {"robotappinstances", "robotappinstances/status"} & set(rule["resources"]):
            found.setdefault(role, {})[resource] = set(rule["verbs"])
    reads = {"robotappinstances": {"get", "list", "watch"}, "robotappinstances/status": {"get"}}
    assert found == {
        "ClusterRole/robotapp-viewer": reads,
        "ClusterRole/robotapp-editor": reads,
        "ClusterRole/robotapp-operator": {
            "robotappinstances": {"get", "list", "watch", "create", "delete"},
            "robotappinstances/status": {"patch"},
        },
    }


def test_the_policy_of_instances_leaves_deletion_and_metadata_to_rbac(rendered: list[Object]) -> None:
    policy = named(rendered, "ValidatingAdmissionPolicy", "robotapp-instances")
    covered = [(rule["operations"], rule["resources"]) for rule in policy["spec"]["matchConstraints"]["resourceRules"]]
    assert covered == [(["CREATE"], ["robotappinstances"]), (["UPDATE"], ["robotappinstances/status"])]


def test_the_operator_deletes_apps_only_where_a_policy_holds_it_to_those_that_have_ended(
    rendered: list[Object],
) -> None:
    deleters = {
        role for role, rule in rules(rendered) if "robotapps" in rule["resources"] and "delete" in rule["verbs"]
    }
    assert deleters == {"ClusterRole/robotapp-operator", "ClusterRole/robotapp-editor"}
    policy = named(rendered, "ValidatingAdmissionPolicy", "robotapp-expiry")
    covered = [(rule["operations"], rule["resources"]) for rule in policy["spec"]["matchConstraints"]["resourceRules"]]
    assert covered == [(["DELETE"], ["robotapps"])]


def test_without_policies_the_operator_has_no_right_to_delete_apps(chart: Chart) -> None:
    objects = chart.render({"policies.enabled": "false"})
    verbs = {
        verb
        for role, rule in rules(objects)
        if role == "ClusterRole/robotapp-operator" and "robotapps" in rule["resources"]
        for verb in rule["verbs"]
    }
    assert verbs == {"get", "list", "watch"}


def test_only_the_scheduler_reads_pod_groups_and_it_writes_nothing_but_the_condition_of_the_servers_own(
    rendered: list[Object],
) -> None:
    found = {
        (group, resource): (role, set(rule["verbs"]))
        for role, rule in rules(rendered)
        for group in rule["apiGroups"]
        for resource in rule["resources"]
        if resource.startswith("podgroups")
    }
    reads = ("ClusterRole/robotapp-scheduler", {"get", "list", "watch"})
    assert found == {
        ("scheduling.x-k8s.io", "podgroups"): reads,
        ("scheduling.k8s.io", "podgroups"): reads,
        ("scheduling.k8s.io", "podgroups/status"): ("ClusterRole/robotapp-scheduler", {"patch"}),
    }


def test_leases_are_limited_to_one_name_each(rendered: list[Object]) -> None:
    for component in ("operator", "scheduler"):
        lease_rules = named(rendered, "Role", f"robotapp-{component}-lease")["rules"]
        assert [(rule["verbs"], rule.get("resourceNames")) for rule in lease_rules] == [
            (["create"], None),
            (["get", "update", "patch"], [f"robotapp-{component}"]),
        ]


@pytest.mark.parametrize("component", ["operator", "scheduler"])
def test_pods_meet_the_restricted_pod_security_standard_and_have_a_read_only_root(
    rendered: list[Object], component: str
) -> None:
    spec = pod_spec(rendered, component)
    assert spec["securityContext"]["runAsNonRoot"] is True
    assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    assert not {"hostNetwork", "hostPID", "hostIPC"} & set(spec)
    (container,) = spec["containers"]
    assert container["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    assert container["resources"]["requests"]
    assert container["resources"]["limits"]["memory"]
    assert container["livenessProbe"]["httpGet"]["port"] == container["readinessProbe"]["httpGet"]["port"] == "health"


def test_the_scheduler_reads_its_configuration_and_writes_the_last_good_one_and_no_other_config_map(
    rendered: list[Object],
) -> None:
    found = [
        (rule["verbs"], rule.get("resourceNames"))
        for role, rule in rules(rendered)
        if "scheduler" in role and role != f"Role/{TUNER}" and "configmaps" in rule["resources"]
    ]
    assert found == [
        (["get", "list", "watch"], ["robotapp-scheduler"]),
        (["get", "patch"], ["robotapp-scheduler-last-good"]),
    ]
    for name in ("robotapp-scheduler-last-good", "robotapp-scheduler-history"):
        assert "data" not in named(rendered, "ConfigMap", name), "an upgrade must not empty it"


def test_who_tunes_the_scheduler_writes_its_configuration_and_the_history_and_nothing_else(
    rendered: list[Object],
) -> None:
    role = named(rendered, "Role", TUNER)
    assert role["metadata"]["namespace"] == SYSTEM_NAMESPACE
    writes = [rule for rule in role["rules"] if not {"get", "list"}.issuperset(rule["verbs"])]
    assert [(rule["verbs"], rule["resourceNames"]) for rule in writes] == [
        (["get", "patch"], ["robotapp-scheduler", "robotapp-scheduler-history"])
    ]
    assert not [binding for binding in rendered if (binding.get("roleRef") or {}).get("name") == TUNER]


def test_the_operator_changes_no_config_maps_but_the_fleet_view(rendered: list[Object]) -> None:
    found = [
        (rule["verbs"], rule.get("resourceNames"))
        for role, rule in rules(rendered)
        if "operator" in role and "configmaps" in rule["resources"]
    ]
    names = [FLEET_CONFIG_MAP, *(f"{FLEET_CONFIG_MAP}-{number}" for number in range(2, MAX_SHARDS + 1))]
    assert found == [(["get", "list", "watch"], None), (["create"], None), (["update", "delete"], names)]


@pytest.mark.parametrize("component", ["operator", "scheduler"])
def test_a_port_is_probed_and_scraped_over_tls(rendered: list[Object], component: str) -> None:
    (container,) = pod_spec(rendered, component)["containers"]
    for probe in ("livenessProbe", "readinessProbe"):
        assert container[probe]["httpGet"]["scheme"] == "HTTPS"
    for kind, field in (("PodMonitor", "podMetricsEndpoints"), ("ServiceMonitor", "endpoints")):
        assert named(rendered, kind, f"robotapp-{component}")["spec"][field][0]["scheme"] == "https"


def test_what_the_scheduler_remembers_of_its_plugins_outlives_its_process_and_needs_no_rights(chart: Chart) -> None:
    for values in ({}, {"scheduler.tls.secretName": "cert"}):
        spec = pod_spec(chart.render(values), "scheduler")
        assert {"name": "state", "emptyDir": {"sizeLimit": "1Mi"}} in spec["volumes"]
        (container,) = spec["containers"]
        (mounted,) = [mount["mountPath"] for mount in container["volumeMounts"] if mount["name"] == "state"]
        assert f"--state-dir={mounted}" in container["args"]


def test_components_may_read_which_authority_signs_client_certificates_and_nothing_else_there(
    rendered: list[Object],
) -> None:
    outside = [item for item in rendered if item["metadata"].get("namespace") == "kube-system"]
    assert [(item["kind"], item["roleRef"]["name"], item["subjects"][0]["name"]) for item in outside] == [
        ("RoleBinding", "extension-apiserver-authentication-reader", f"robotapp-{component}")
        for component in ("operator", "scheduler")
    ]


@pytest.mark.parametrize("component", ["operator", "scheduler"])
def test_every_component_runs_under_an_account_of_its_own(rendered: list[Object], component: str) -> None:
    assert pod_spec(rendered, component)["serviceAccountName"] == f"robotapp-{component}"
    assert named(rendered, "ServiceAccount", f"robotapp-{component}")["metadata"]["namespace"] == NAMESPACE


def test_every_object_carries_the_common_labels(rendered: list[Object]) -> None:
    for item in rendered:
        if item["kind"] == "CustomResourceDefinition":  # generated as crds/*.yaml, which have no release
            continue
        labels = item["metadata"]["labels"]
        assert labels["app.kubernetes.io/part-of"] == "robotapp", item["metadata"]["name"]
        assert labels["team"] == "fleet", item["metadata"]["name"]


def test_without_the_workloads_everything_else_is_rendered_alike(chart: Chart) -> None:
    def others(objects: list[Object]) -> list[Object]:
        return [item for item in objects if item["kind"] != "Deployment"]

    everything, cluster_side = chart.render(NO_KEY), chart.render({**NO_KEY, **NO_WORKLOADS})
    assert cluster_side == others(everything)
    assert len(of_kind(everything, "Deployment")) == 2


def test_with_namespaces_the_operator_has_a_role_in_each_and_no_cluster_wide_right_on_workloads(chart: Chart) -> None:
    objects = chart.render({"operator.watchNamespaces": "{fleet-a,fleet-b}"})
    cluster = {
        resource
        for rule in named(objects, "ClusterRole", "robotapp-operator")["rules"]
        for resource in rule["resources"]
    }
    assert not {"robotapps", "robotappinstances", "deployments", "configmaps", "services", "pods"} & cluster
    roles = [
        item for item in of_kind(objects, "Role", "RoleBinding") if item["metadata"]["name"] == "robotapp-operator"
    ]
    assert sorted((item["kind"], item["metadata"]["namespace"]) for item in roles) == [
        ("Role", "fleet-a"),
        ("Role", "fleet-b"),
        ("RoleBinding", "fleet-a"),
        ("RoleBinding", "fleet-b"),
    ]
    for role in of_kind(roles, "Role"):
        assert {"robotappinstances", "robotappinstances/status"} <= {
            name for rule in role["rules"] for name in rule["resources"]
        }
    assert "--namespaces=fleet-a,fleet-b" in pod_spec(objects, "operator")["containers"][0]["args"]


def test_a_digest_wins_over_the_tag_and_the_registry_comes_first(chart: Chart) -> None:
    digest = f"sha256:{'ab' * 32}"
    objects = chart.render(
        {"imageRegistry": "images.test", "operator.image.digest": digest, "scheduler.image.tag": "v9"}
    )
    assert pod_spec(objects, "operator")["containers"][0]["image"] == f"images.test/robotapp/operator@{digest}"
    assert pod_spec(objects, "scheduler")["containers"][0]["image"] == "images.test/robotapp/scheduler:v9"


def test_without_a_registry_the_chart_says_that_nothing_is_published(chart: Chart) -> None:
    with pytest.raises(CommandError) as refusal:
        chart.render({"imageRegistry": ""})
    assert "so robotapp/" in str(refusal.value)
    assert "write imageRegistry, the registry you pushed them to" in str(refusal.value)
    assert chart.render({"imageRegistry": "", "agent.enabled": "false"} | NO_WORKLOADS), "no workload needs no image"
    named = {f"{part}.image.repository": f"localhost:5000/{part}" for part in ("operator", "scheduler", "agent")}
    assert pod_spec(chart.render(named | {"imageRegistry": ""}), "operator")["containers"][0]["image"].startswith(
        "localhost:5000/"
    )


def test_an_umbrella_charts_registry_and_pull_secrets_count_where_ours_are_empty(chart: Chart) -> None:
    umbrella = {"enabled": "true", "global.imageRegistry": "images.test", "global.imagePullSecrets[0].name": "theirs"}
    pod = pod_spec(chart.render(umbrella | {"imageRegistry": ""}), "operator")
    assert pod["containers"][0]["image"].startswith("images.test/robotapp/operator:")
    assert pod["imagePullSecrets"] == [{"name": "theirs"}]
    own = pod_spec(chart.render(umbrella | {"imagePullSecrets[0]": "a", "imagePullSecrets[1].name": "b"}), "operator")
    assert own["containers"][0]["image"].startswith("registry.example/")
    assert own["imagePullSecrets"] == [{"name": "a"}, {"name": "b"}]


def test_user_and_group_can_be_left_to_the_cluster(chart: Chart) -> None:
    fixed = pod_spec(chart.render(), "scheduler")["securityContext"]
    assert (fixed["runAsUser"], fixed["runAsGroup"]) == (65532, 65532)
    free = chart.render({"podSecurity.runAsUser": "null", "podSecurity.runAsGroup": "null"})
    for workload in of_kind(free, "Deployment", "DaemonSet"):
        assert workload["spec"]["template"]["spec"]["securityContext"] == {
            "runAsNonRoot": True,
            "seccompProfile": {"type": "RuntimeDefault"},
        }


def test_pods_keep_to_linux_and_agents_off_nodes_without_a_kubelet_of_their_own(chart: Chart) -> None:
    objects = chart.render({"agent.labeller.enabled": "true", "console.enabled": "true"})
    for workload in of_kind(objects, "Deployment", "DaemonSet"):
        assert workload["spec"]["template"]["spec"]["nodeSelector"] == {"kubernetes.io/os": "linux"}
    (agent,) = of_kind(objects, "DaemonSet")
    required = agent["spec"]["template"]["spec"]["affinity"]["nodeAffinity"][
        "requiredDuringSchedulingIgnoredDuringExecution"
    ]
    (term,) = required["nodeSelectorTerms"]
    assert [(item["key"], item["operator"], item["values"]) for item in term["matchExpressions"]] == [
        ("type", "NotIn", ["virtual-kubelet"]),
        ("eks.amazonaws.com/compute-type", "NotIn", ["fargate"]),
    ]


def test_switches_leave_their_objects_out(chart: Chart) -> None:
    objects = chart.render(
        {
            "rbac.create": "false",
            "policies.enabled": "false",
            "domainPool.create": "false",
            "crds.enabled": "false",
            "agent.enabled": "false",
            "networkPolicy.enabled": "false",
        }
    )
    kinds = {item["kind"] for item in objects}
    assert kinds == {"ServiceAccount", "ConfigMap", "Deployment", "Lease"}


def test_only_listed_priority_classes_are_free_for_writers_without_pods(chart: Chart) -> None:
    for values, free in (({}, "['']"), ({"policies.priorityClasses[0]": "robots-first"}, "['', 'robots-first']")):
        for policy in ("robotapp-references", "robotapp-revisions"):
            variables = named(chart.render(values), "ValidatingAdmissionPolicy", policy)["spec"]["variables"]
            (priorities,) = [item["expression"] for item in variables if item["name"] == "priorities"]
            assert f"priorityClassName.orValue('') in {free})" in priorities


def test_crds_and_pool_are_kept_on_uninstall_unless_told_otherwise(chart: Chart) -> None:
    for keep, expected in (("true", {"keep"}), ("false", {None})):
        objects = of_kind(chart.render({"crds.keep": keep}), "CustomResourceDefinition")  # the pool goes with its own
        assert {item["metadata"].get("annotations", {}).get("helm.sh/resource-policy") for item in objects} == expected


def test_only_several_replicas_have_a_disruption_budget(chart: Chart, rendered: list[Object]) -> None:
    assert of_kind(rendered, "PodDisruptionBudget") == []
    objects = chart.render({"operator.replicas": "2", "scheduler.replicas": "2"})
    budgets = {each["metadata"]["name"]: each["spec"] for each in of_kind(objects, "PodDisruptionBudget")}
    assert set(budgets) == {"robotapp-operator", "robotapp-scheduler"}
    for name, spec in budgets.items():
        assert spec["maxUnavailable"] == 1
        assert spec["selector"] == named(objects, "Deployment", name)["spec"]["selector"]


def test_the_default_pool_is_the_one_of_the_design(chart: Chart) -> None:
    pool = named(chart.render(), "DomainPool", "default")
    assert pool["spec"]["ids"] == "1-101,215-232"
    assert pool["spec"]["reserved"] == [0]
    assert pool["spec"]["quarantineSeconds"] == 60


@pytest.mark.parametrize(
    ("values", "quota"),
    [
        ({}, {"default": 40}),
        ({"domainPool.quota.default": "null"}, None),
        ({"domainPool.quota.namespaces.lab": "0"}, {"default": 40, "namespaces": {"lab": 0}}),
        (
            {"domainPool.quota.default": "0", "domainPool.quota.namespaces.lab": "9"},
            {"default": 0, "namespaces": {"lab": 9}},
        ),
    ],
)
def test_a_namespace_has_a_quota_unless_it_is_taken_away_and_one_of_zero_is_none(
    chart: Chart, values: dict[str, str], quota: dict[str, object] | None
) -> None:
    assert named(chart.render(values), "DomainPool", "default")["spec"].get("quota") == quota


def test_the_operator_is_told_the_scheduler_of_apps_that_name_none(chart: Chart, rendered: list[Object]) -> None:
    for objects, name in (
        (rendered, SCHEDULER_NAME),
        (chart.render({"operator.schedulerName": "other.test"}), "other.test"),
    ):
        assert f"--scheduler-name={name}" in pod_spec(objects, "operator")["containers"][0]["args"]


def test_the_operator_is_told_images_and_user_of_helper_pods(chart: Chart, rendered: list[Object]) -> None:
    shipped = pod_spec(rendered, "operator")["containers"][0]["args"]
    assert "--helper-discovery-image=ros:{distro}-ros-base" in shipped
    assert "--helper-master-image=ros:{distro}-ros-core" in shipped
    assert "--helper-user=65532" in shipped
    (recorder,) = (each for each in shipped if each.startswith("--helper-recorder-image="))
    assert re.fullmatch(r"--helper-recorder-image=\S+/robotapp/recorder:\d+\.\d+\.\d+-\{distro\}", recorder)
    own = chart.render({"helperImages.recorder": "reg.test/rec:{distro}"})
    assert "--helper-recorder-image=reg.test/rec:{distro}" in pod_spec(own, "operator")["containers"][0]["args"]
    own = chart.render({"helperImages.discovery": "reg.test/ros:x", "helperUser": "0"})
    assert {"--helper-discovery-image=reg.test/ros:x", "--helper-user=0"} <= {
        *pod_spec(own, "operator")["containers"][0]["args"]
    }


@pytest.mark.parametrize("component", ["operator", "scheduler", "console", "labeller"])
def test_programs_keep_off_robots_unless_an_affinity_is_written(chart: Chart, component: str) -> None:
    enabled = {"console.enabled": "true", "agent.labeller.enabled": "true"}
    (preference,) = pod_spec(chart.render(enabled), component)["affinity"]["nodeAffinity"][
        "preferredDuringSchedulingIgnoredDuringExecution"
    ]
    assert preference["preference"]["matchExpressions"][0] == {"key": "robotics.io/robot", "operator": "DoesNotExist"}


@pytest.mark.parametrize(
    ("values", "switch"), [({}, "on"), ({"scheduler.betterNodes": "false"}, "off"), ({"agent.enabled": "false"}, "off")]
)
def test_better_nodes_are_proposed_where_agents_measure_unless_switched_off(
    chart: Chart, values: dict[str, str], switch: str
) -> None:
    assert f"--better-nodes={switch}" in pod_spec(chart.render(values), "scheduler")["containers"][0]["args"]


@pytest.mark.parametrize(
    ("value", "where"),
    [
        ("typo=1", "typo"),
        ("operator.image.tga=x", "/operator/image"),
        ("domainPool.ids=a-b", "/domainPool/ids"),
        ("domainPool.ids=5-1", 'domainPool.ids: "5-1" in "5-1": ranges must ascend'),
        ("domainPool.ids=1-9\\,9-12", 'domainPool.ids: "9-12" in "1-9,9-12": ranges must ascend'),
        ("domainPool.ids=230-233", 'domainPool.ids: "230-233"'),
        ("domainPool.network=Yard A", "/domainPool/network"),
        ("domainPool.sharedIds=7\\,3", 'domainPool.sharedIds: "3" in "7,3"'),
        ("scheduler.logFormat=xml", "/scheduler/logFormat"),
        ("operator.schedulerName=", "/operator/schedulerName"),
        ("domainPool.quota.default=-1", "/domainPool/quota/default"),
        ("scheduler.config.kind=Other", "/scheduler/config/kind"),
        ("operator.tls.secretName=My_Certificate", "/operator/tls/secretName"),
        ("scheduler=null", "missing property 'scheduler'"),
        ("operator.tls=null", "at '/operator': missing property 'tls'"),
    ],
)
def test_wrong_values_are_refused_with_their_place(chart: Chart, value: str, where: str) -> None:
    key, _, text = value.partition("=")
    with pytest.raises(CommandError, match=re.escape(where)):
        chart.render({key: text})


def test_several_schedulers_need_an_election(chart: Chart) -> None:
    alone = {"scheduler.config.leaderElection.leaderElect": "false"}
    assert chart.render(alone)
    assert chart.render({"scheduler.replicas": "2"})
    with pytest.raises(CommandError, match=re.escape("write 1, or scheduler.config.leaderElection.leaderElect: true")):
        chart.render({**alone, "scheduler.replicas": "2"})


@pytest.mark.parametrize("off", [["operator"], ["scheduler"], ["operator", "scheduler"]])
def test_the_notes_say_what_is_not_part_of_the_release_and_promise_no_app(chart: Chart, off: list[str]) -> None:
    values = flags({f"{component}.enabled": "false" for component in off})
    text = chart.plane.helm("install", "robotapp", str(CHART), "--namespace", NAMESPACE, "--dry-run=client", *values)
    notes = text.partition("NOTES:")[2]
    assert [line.partition(".")[0] for line in notes.splitlines() if ".enabled is false" in line] == off
    assert "kubectl apply" not in notes
    assert max(map(len, notes.splitlines())) <= 80


def test_values_that_may_be_empty_may_be_left_without_a_value(chart: Chart) -> None:
    empty = ("domainPool.sharedIds", "imagePullSecrets", "operator.tls.secretName", "scheduler.affinity")
    assert chart.render({**NO_KEY, **dict.fromkeys(empty, "null")}) == chart.render(NO_KEY)


def test_policies_name_the_account_of_this_release(chart: Chart) -> None:
    text = json.dumps(chart.render({"nameOverride": "robots"}, "--namespace", "elsewhere"))
    for component in ("operator", "scheduler"):
        assert f"'system:serviceaccount:elsewhere:robots-{component}'" in text
    assert "system:serviceaccount:robotapp-system" not in text


def test_lint_is_clean(chart: Chart) -> None:
    assert "0 chart(s) failed" in chart.plane.helm("lint", "--strict", str(CHART))


@pytest.mark.parametrize("enabled", ["true", "false"])
def test_the_operator_renders_access_to_the_node_only_beside_the_policy_that_guards_it(
    chart: Chart, enabled: str
) -> None:
    objects = chart.render({"policies.enabled": enabled})
    policies = {item["metadata"]["name"] for item in of_kind(objects, "ValidatingAdmissionPolicyBinding")}
    flagged = "--host-access" in pod_spec(objects, "operator")["containers"][0]["args"]
    assert flagged is ("robotapp-host-access" in policies) is (enabled == "true")


def test_the_rights_to_the_node_are_roles_of_their_own_that_nobody_is_given(rendered: list[Object]) -> None:
    uses = {role: rule for role, rule in rules(rendered) if "use" in rule["verbs"]}
    assert {role.removeprefix("ClusterRole/robotapp-use-"): rule["resources"] for role, rule in uses.items()} == {
        right.value: [right.resource] for right in HostRight
    }
    assert all(rule["verbs"] == ["use"] for rule in uses.values())
    names = {role.partition("/")[2] for role in uses}
    assert not any(item["roleRef"]["name"] in names for item in of_kind(rendered, "ClusterRoleBinding", "RoleBinding"))
    for name in names:
        labels = named(rendered, "ClusterRole", name)["metadata"]["labels"]
        assert not any(label.startswith("rbac.authorization.k8s.io/aggregate") for label in labels)
