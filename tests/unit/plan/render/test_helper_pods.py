"""Discovery servers, router and master as pods: admitted where the components are, near them, and never on a foreign robot."""

from typing import Any

import pytest
from tests.support.factories import component, make_app, make_node

from robotapp_operator.plan.render.admitted_nodes import reach_of
from robotapp_operator.plan.render.child import DEPLOYMENT
from robotapp_operator.plan.render.helper_pods import RESOURCES
from robotapp_operator.plan.render.infrastructure import infrastructure
from robotapp_operator.plan.render.parameters import NONE
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import App, Domain, HelperDefaults, desired_of

ZENOH = {"ros2": {"rmw": "rmw_zenoh_cpp"}}
NOETIC = {"ros": {"distro": "noetic"}}
RESTRICTED = {
    "allowPrivilegeEscalation": False,
    "capabilities": {"drop": ["ALL"]},
    "seccompProfile": {"type": "RuntimeDefault"},
}
KINDS: list[dict[str, Any]] = [{}, ZENOH, NOETIC]


def templates(app: App, robot: str = "") -> list[dict[str, Any]]:
    children = infrastructure(desired_of(app, robot), running=True)
    return [child.spec["template"] for child in children if child.ref.kind == DEPLOYMENT]


def two(**template: Any) -> list[dict[str, Any]]:
    return [component("plan", template=template), component("drive", template=template)]


@pytest.mark.parametrize("spec", KINDS)
def test_helpers_are_what_pod_security_restricted_admits(spec: dict[str, Any]) -> None:
    user = {"runAsNonRoot": True, "runAsUser": 1000}
    parts = [component("plan", securityContext=user), component("drive", securityContext=user)]
    for template in templates(make_app(*parts, **spec)):
        (container,) = template["spec"]["containers"]
        assert container["securityContext"] == RESTRICTED | user


def test_servers_and_router_end_at_once_since_scripts_ignore_the_request_to_stop() -> None:
    for spec in ({}, ZENOH):
        assert {template["spec"]["terminationGracePeriodSeconds"] for template in templates(make_app(**spec))} == {2}


def test_a_master_keeps_the_default_for_its_restart_would_restart_every_node() -> None:
    (master,) = templates(make_app(**NOETIC))
    assert "terminationGracePeriodSeconds" not in master["spec"]


def test_helpers_run_as_an_ordinary_user_where_the_components_name_none() -> None:
    for template in templates(make_app()):
        assert template["spec"]["containers"][0]["securityContext"] == RESTRICTED | {
            "runAsNonRoot": True,
            "runAsUser": 65532,
        }


def test_a_user_of_the_pod_is_not_written_a_second_time() -> None:
    for template in templates(make_app(*two(spec={"securityContext": {"runAsUser": 1234}}))):
        assert template["spec"]["securityContext"] == {"runAsUser": 1234}
        assert "runAsUser" not in template["spec"]["containers"][0]["securityContext"]


def test_the_operators_setting_leaves_the_user_to_the_platform() -> None:
    app = make_app()
    free = App(**{**vars(app), "helper_defaults": HelperDefaults(user=0)})
    assert "runAsUser" not in templates(free)[0]["spec"]["containers"][0]["securityContext"]


def test_a_router_of_a_components_image_has_the_user_of_that_component() -> None:
    parts = [component("plan", template={"spec": {"securityContext": {"fsGroup": 5}}}), component("drive")]
    (template,) = templates(make_app(*parts, **ZENOH))
    assert template["spec"]["containers"][0]["securityContext"] == RESTRICTED
    assert template["spec"]["securityContext"] == {"fsGroup": 5}


@pytest.mark.parametrize("spec", KINDS)
def test_helpers_have_requests_and_limits_for_quotas(spec: dict[str, Any]) -> None:
    for template in templates(make_app(**spec)):
        assert template["spec"]["containers"][0]["resources"] == RESOURCES


@pytest.mark.parametrize("spec", KINDS)
def test_priority_pull_secrets_labels_and_annotations_follow_the_components(spec: dict[str, Any]) -> None:
    common = {
        "metadata": {"labels": {"team": "a", "sidecar.istio.io/inject": "false"}, "annotations": {"cost": "7"}},
        "spec": {"priorityClassName": "robots", "imagePullSecrets": [{"name": "pull"}], "serviceAccountName": "ros"},
    }
    for template in templates(make_app(*two(**common), **spec)):
        assert common["metadata"]["labels"].items() <= template["metadata"]["labels"].items()
        assert template["metadata"]["annotations"] == {"cost": "7"}
        assert template["spec"]["priorityClassName"] == "robots"
        assert template["spec"]["imagePullSecrets"] == [{"name": "pull"}]
        assert template["spec"]["serviceAccountName"] == "ros"
        assert template["spec"]["automountServiceAccountToken"] is False


def test_what_one_component_alone_has_does_not_make_a_helper_look_like_it() -> None:
    parts = [
        component("plan", template={"metadata": {"labels": {"app": "plan", "team": "a"}}}),
        component("drive", template={"metadata": {"labels": {"team": "a"}}}),
    ]
    for template in templates(make_app(*parts)):
        assert "app" not in template["metadata"]["labels"]
        assert template["metadata"]["labels"]["team"] == "a"


@pytest.mark.parametrize("spec", ["discovery", "router", "master"])
def test_the_app_may_write_what_helpers_are_like(spec: str) -> None:
    helper = {
        "image": "own:1",
        "imagePullPolicy": "Always",
        "resources": {"limits": {"cpu": "2", "memory": "1Gi"}},
        "securityContext": {"runAsUser": 5},
        "template": {
            "metadata": {"labels": {"mesh": "off"}, "annotations": {"a": "b"}},
            "spec": {
                "imagePullSecrets": [{"name": "helpers"}], "tolerations": [{"key": "t", "operator": "Exists"}],
                "nodeSelector": {"pool": "infra"}, "priorityClassName": "high", "serviceAccountName": "helper",
                "securityContext": {"fsGroup": 9}, "runtimeClassName": "gvisor",
            },
        },
    }  # fmt: skip
    fields = {
        "discovery": {"ros2": {"discovery": helper}},
        "router": {"ros2": {"rmw": "rmw_zenoh_cpp", "discovery": helper}},
        "master": {"ros": {"distro": "noetic"}, "ros1": helper},
    }[spec]
    for template in templates(make_app(**fields)):
        pod, (container,) = template["spec"], template["spec"]["containers"]
        assert (container["image"], container["imagePullPolicy"]) == ("own:1", "Always")
        assert container["resources"] == helper["resources"]
        assert container["securityContext"] == {"runAsUser": 5}
        assert (pod["priorityClassName"], pod["serviceAccountName"], pod["runtimeClassName"]) == (
            "high",
            "helper",
            "gvisor",
        )
        assert (pod["nodeSelector"], pod["securityContext"]) == ({"pool": "infra"}, {"fsGroup": 9})
        assert {"key": "t", "operator": "Exists"} in pod["tolerations"]
        assert {"name": "helpers"} in pod["imagePullSecrets"]
        assert template["metadata"]["labels"]["mesh"] == "off"
        assert template["metadata"]["annotations"] == {"a": "b"}


def test_a_helpers_own_labels_win_over_those_of_the_template() -> None:
    for template in templates(make_app(*two(metadata={"labels": {"team": "a"}}))):
        assert template["metadata"]["labels"]["robotics.io/role"] == "discovery"


@pytest.mark.parametrize("spec", KINDS)
def test_helpers_of_a_robots_instance_may_use_that_robot_or_none(spec: dict[str, Any]) -> None:
    nodes = {
        "own": make_node("own", robot="amr-07"), "foreign": make_node("foreign", robot="amr-08"), "edge": make_node("edge", tier="edge"),
    }  # fmt: skip
    for template in templates(make_app(**spec), "amr-07"):
        assert reach_of(template["spec"], nodes) == {"own", "edge"}


@pytest.mark.parametrize("spec", [ZENOH, NOETIC])
def test_a_router_or_master_of_a_component_on_board_stays_and_returns_there(spec: dict[str, Any]) -> None:
    nodes = {"own": make_node("own", robot="amr-07"), "edge": make_node("edge", tier="edge")}
    app = make_app(component("drive", runsOn=["Robot"]), component("plan"), **spec)
    (template,) = templates(app, "amr-07")
    assert reach_of(template["spec"], nodes) == {"own"}


def test_helpers_of_an_app_for_edge_nodes_alone_keep_off_robots() -> None:
    nodes = {"robot": make_node("robot", robot="amr-07"), "edge": make_node("edge", tier="edge")}
    app = make_app(component("a", runsOn=["Edge"]), component("b", runsOn=["Edge", "Cloud"]))
    for template in templates(app):
        assert reach_of(template["spec"], nodes) == {"edge"}


def test_helpers_of_an_app_without_robots_prefer_nodes_that_are_none() -> None:
    for template in templates(make_app()):
        (preference,) = template["spec"]["affinity"]["nodeAffinity"]["preferredDuringSchedulingIgnoredDuringExecution"]
        assert preference["preference"]["matchExpressions"] == [
            {"key": "robotics.io/robot", "operator": "DoesNotExist"}
        ]


@pytest.mark.parametrize("spec", KINDS)
def test_helpers_prefer_the_zone_of_the_components(spec: dict[str, Any]) -> None:
    for template in templates(make_app(**spec), "amr-07"):
        terms = template["spec"]["affinity"]["podAffinity"]["preferredDuringSchedulingIgnoredDuringExecution"]
        selectors = [term["podAffinityTerm"]["labelSelector"] for term in terms]
        assert all(
            one["matchLabels"] == {"robotics.io/app": "teleop", "robotics.io/instance": "amr-07"} for one in selectors
        )
        assert [term["podAffinityTerm"]["topologyKey"] for term in terms] == [
            "topology.kubernetes.io/zone",
            "kubernetes.io/hostname",
        ]


def test_a_master_goes_to_the_node_of_that_name_whatever_its_hostname_label_says() -> None:
    (template,) = templates(make_app(placement={"masterNode": "ip-10-0-7-2.eu-west-1.compute.internal"}, **NOETIC))
    nodes = {
        name: make_node(name, hostname=label)
        for name, label in (("ip-10-0-7-2.eu-west-1.compute.internal", "ip-10-0-7-2"), ("ip-10-0-7-2", "x"))
    }
    assert reach_of(template["spec"], nodes) == {"ip-10-0-7-2.eu-west-1.compute.internal"}


def test_the_waiting_step_has_the_resources_of_its_component() -> None:
    resources = {
        "requests": {"cpu": "500m", "memory": "256Mi", "nvidia.com/gpu": "1"},
        "limits": {"cpu": "1", "memory": "512Mi", "nvidia.com/gpu": "1"},
    }
    app = make_app(component("plan", resources=resources), component("drive"))
    steps = [
        pod_template(part, desired_of(app, ""), domain=Domain(7), state=NONE)["spec"]["initContainers"][0]
        for part in app.spec.components
    ]
    assert steps[0]["resources"] == {
        "requests": {"cpu": "500m", "memory": "256Mi"},
        "limits": {"cpu": "1", "memory": "512Mi"},
    }
    assert "resources" not in steps[1]
