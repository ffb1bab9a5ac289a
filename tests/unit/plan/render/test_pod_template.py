"""The pod template of a component."""

import dataclasses
from typing import Any

import msgspec
import pytest
from tests.support.factories import component, make_app

from robotapp_api.model.names import SCHEDULING_GATE, Annotation, Label
from robotapp_operator.plan.render.parameters import NONE, ParameterState, parameter_states
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.config_content import ClusterConfig, config_content
from robotapp_operator.plan.spec.desired import Domain, desired_of
from robotapp_operator.plan.spec.objects import ConfigMap

DOMAIN = Domain(7, "dds.default.c.7")


def template(
    *, robot: str = "", state: ParameterState = NONE, app: dict[str, Any] | None = None, **fields: Any
) -> dict[str, Any]:
    whole = make_app(component("driver", **fields), component("other"), **(app or {}))
    desired = desired_of(whole, robot)
    domain = DOMAIN if whole.ros_version == 2 else None
    return pod_template(whole.spec.components[0], desired, domain=domain, state=state)


def env_of(rendered: dict[str, Any]) -> dict[str, Any]:
    return {item["name"]: item.get("value", item.get("valueFrom")) for item in rendered["spec"]["containers"][0]["env"]}


def required_terms(rendered: dict[str, Any]) -> list[list[dict[str, Any]]]:
    required = rendered["spec"]["affinity"]["nodeAffinity"]["requiredDuringSchedulingIgnoredDuringExecution"]
    return [term["matchExpressions"] for term in required["nodeSelectorTerms"]]


def test_labels_name_app_uid_instance_and_component() -> None:
    labels = template(robot="amr-07")["metadata"]["labels"]
    assert labels[Label.APP] == "teleop"
    assert labels[Label.APP_UID] == "uid-1"
    assert labels[Label.INSTANCE] == "amr-07"
    assert labels[Label.COMPONENT] == "driver"


def test_the_domain_is_a_literal_and_its_claim_is_named() -> None:
    rendered = template()
    assert env_of(rendered)["ROS_DOMAIN_ID"] == "7"
    assert rendered["metadata"]["annotations"] == {Annotation.DOMAIN_CLAIM: "dds.default.c.7"}


def test_robots_get_no_api_token_unless_their_author_named_an_account() -> None:
    assert template()["spec"]["automountServiceAccountToken"] is False
    assert (
        template(template={"spec": {"serviceAccountName": "default"}})["spec"]["automountServiceAccountToken"] is False
    )
    assert template(template={"spec": {"serviceAccountName": "ours"}})["spec"]["automountServiceAccountToken"] is True


def test_nothing_empty_is_rendered() -> None:
    def empties(value: Any) -> bool:
        if isinstance(value, dict):
            return any(item in (None, {}, []) or empties(item) for item in value.values())
        return isinstance(value, list) and any(map(empties, value))

    assert not empties(template()["spec"])


def test_a_robots_component_is_tied_to_that_robot() -> None:
    assert required_terms(template(robot="amr-07", runsOn=["Robot"])) == [
        [{"key": Label.ROBOT, "operator": "In", "values": ["amr-07"]}]
    ]


def test_without_robots_runs_on_names_a_tier() -> None:
    for tier in ("Robot", "Edge", "Cloud"):
        (term,) = required_terms(template(runsOn=[tier]))
        assert term == [{"key": Label.TIER, "operator": "In", "values": [tier.lower()]}]
    assert "affinity" not in template()["spec"]


def test_a_free_component_of_a_robots_instance_never_lands_on_another_robot() -> None:
    own, elsewhere = required_terms(template(robot="amr-07"))
    assert own == [{"key": Label.ROBOT, "operator": "In", "values": ["amr-07"]}]
    assert elsewhere == [{"key": Label.ROBOT, "operator": "DoesNotExist"}]


def test_pods_on_the_robot_stay_for_ever_when_it_is_out_of_reach() -> None:
    lost = [item for item in template(robot="r", runsOn=["Robot"])["spec"]["tolerations"] if "node." in item["key"]]
    assert [item["key"] for item in lost] == ["node.kubernetes.io/not-ready", "node.kubernetes.io/unreachable"]
    assert all("tolerationSeconds" not in item for item in lost)


def test_pods_elsewhere_move_after_the_grace_period() -> None:
    lost = template(app={"connectivity": {"grace": "90s"}})["spec"]["tolerations"]
    assert {item["tolerationSeconds"] for item in lost} == {90}
    kept = template(onDisconnect="Keep")["spec"]["tolerations"]
    assert all("tolerationSeconds" not in item for item in kept)


def test_robot_taints_are_tolerated_for_that_robot_only() -> None:
    own = template(robot="amr-07", runsOn=["Robot"])["spec"]["tolerations"]
    assert {"key": Label.ROBOT, "operator": "Equal", "value": "amr-07"} in own
    assert all(
        item["key"] not in (Label.ROBOT, Label.TIER) for item in template(runsOn=["Edge"])["spec"]["tolerations"]
    )


def test_the_components_own_tolerations_come_first() -> None:
    mine = {"key": "x", "operator": "Exists"}
    assert template(template={"spec": {"tolerations": [mine]}})["spec"]["tolerations"][0] == mine


def config_map(name: str, **data: str) -> ConfigMap:
    return msgspec.convert({"metadata": {"name": name}, "data": data}, ConfigMap)


FILES: list[dict[str, Any]] = [
    {"inline": "/**: {ros__parameters: {v: 1.0}}"},
    {"configMapKeyRef": {"name": "drv", "key": "base.yaml"}},
    {"configMapKeyRef": {"name": "drv", "key": "$(ROBOTAPP_ROBOT).yaml", "optional": True}},
    {"secretKeyRef": {"name": "s", "key": "p.yaml"}},
]


def with_files(config_maps: dict[str, ConfigMap]) -> dict[str, Any]:
    app = make_app(component("driver", args=["run"], parameters=FILES))
    state = parameter_states(app, "amr-07", config_maps)["driver"]
    return pod_template(app.spec.components[0], desired_of(app, "amr-07"), domain=DOMAIN, state=state)


def test_parameter_files_are_mounted_in_one_volume_and_passed_in_their_order() -> None:
    rendered = with_files({"default/drv": config_map("drv", **{"base.yaml": "a", "amr-07.yaml": "b"})})
    (volume,) = rendered["spec"]["volumes"]
    inline, shared, own, secret = volume["projected"]["sources"]
    field = {"fieldPath": "metadata.annotations['robotics.io/parameters-0']"}
    assert inline == {"downwardAPI": {"items": [{"path": "0.yaml", "fieldRef": field}]}}
    assert shared == {"configMap": {"name": "drv", "items": [{"key": "base.yaml", "path": "1.yaml"}]}}
    assert own == {"configMap": {"name": "drv", "items": [{"key": "amr-07.yaml", "path": "2.yaml"}]}}
    assert secret == {"secret": {"name": "s", "items": [{"key": "p.yaml", "path": "3.yaml"}]}}
    paths = [f"/etc/robotapp/parameters/{number}.yaml" for number in range(4)]
    assert rendered["spec"]["containers"][0]["args"] == [
        "run",
        "--ros-args",
        *(word for path in paths for word in ("--params-file", path)),
    ]
    assert env_of(rendered)["ROBOTAPP_PARAMETER_FILES"] == ":".join(paths)
    assert rendered["metadata"]["annotations"]["robotics.io/parameters-0"] == FILES[0]["inline"]


def test_an_optional_file_that_is_not_there_is_left_out() -> None:
    rendered = with_files({"default/drv": config_map("drv", **{"base.yaml": "a"})})
    assert "/etc/robotapp/parameters/2.yaml" not in rendered["spec"]["containers"][0]["args"]
    assert len(rendered["spec"]["volumes"][0]["projected"]["sources"]) == 3


def test_what_a_named_config_map_holds_rolls_the_pods_and_other_keys_do_not() -> None:
    def digest(**data: str) -> str:
        annotations = with_files({"default/drv": config_map("drv", **data)})["metadata"]["annotations"]
        return str(annotations[Annotation.PARAMETERS_HASH])

    one = digest(**{"base.yaml": "a"})
    assert one == digest(**{"base.yaml": "a", "other.yaml": "x"})
    assert len({one, digest(**{"base.yaml": "b"}), digest(**{"base.yaml": "a", "amr-07.yaml": "a"})}) == 3


def test_a_required_file_that_is_not_there_is_told() -> None:
    app = make_app(component("driver", args=["run"], parameters=FILES))

    def list_missing(config_maps: dict[str, ConfigMap]) -> tuple[str, ...]:
        return config_content(app.spec.components[0], app, "amr-07", ClusterConfig(config_maps, {})).missing

    assert list_missing({}) == ("there is no ConfigMap drv",)
    assert list_missing({"default/drv": config_map("drv")}) == ("ConfigMap drv has no key base.yaml",)


def test_no_files_change_nothing() -> None:
    rendered = template(args=["run"])
    assert rendered["spec"]["containers"][0]["args"] == ["run"]
    assert "volumes" not in rendered["spec"]


def test_the_environment_names_app_instance_robot_component_and_distribution() -> None:
    found = env_of(template(robot="amr-07"))
    assert {key: found[key] for key in sorted(found) if key.startswith("ROBOTAPP_") or key == "ROS_DISTRO"} == {
        "ROBOTAPP_APP": "teleop",
        "ROBOTAPP_COMPONENT": "driver",
        "ROBOTAPP_INSTANCE": "amr-07",
        "ROBOTAPP_ROBOT": "amr-07",
        "ROS_DISTRO": "humble",
    }


def test_our_variables_come_first_and_the_components_own_value_wins() -> None:
    rendered = template(
        env=[{"name": "ROS_LOCALHOST_ONLY", "value": "1"}, {"name": "MINE", "value": "$(ROS_DOMAIN_ID)"}]
    )
    names = [item["name"] for item in rendered["spec"]["containers"][0]["env"]]
    assert names.index("ROS_DOMAIN_ID") < names.index("MINE")
    assert len(names) == len(set(names))
    assert env_of(rendered)["ROS_LOCALHOST_ONLY"] == "1"


def test_devices_arrive_by_the_downward_api() -> None:
    rendered = template(devices=[{"name": "can", "type": "can"}])
    path = env_of(rendered)["ROBOTAPP_DEVICES"]["fieldRef"]["fieldPath"]
    assert path == "metadata.annotations['granted.robotics.io/devices']"


DRIVER_WISHES: dict[str, Any] = {
    "devices": [
        {"name": "lidar", "type": "serial"},
        {"name": "eye", "type": "video", "sharing": "Cluster"},
    ],
    "requires": [{"type": "gpu", "model": "nvidia"}],
}


def test_hardware_is_left_to_our_scheduler_and_spelled_out_for_others() -> None:
    wanted = {
        "devices": [{"name": "c", "type": "can", "interface": "can0"}],
        "requires": [{"type": "gpu", "model": "nvidia"}],
    }
    assert "affinity" not in template(**wanted)["spec"]
    (term,) = required_terms(template(app={"schedulerName": "default-scheduler"}, **wanted))
    assert term == [
        {"key": "hardware.robotics.io/can-can0", "operator": "Exists"},
        {"key": "hardware.robotics.io/gpu", "operator": "In", "values": ["nvidia"]},
    ]


def test_a_device_of_a_resource_claim_needs_no_label_under_another_scheduler() -> None:
    desired = desired_of(make_app(component("driver", **DRIVER_WISHES), schedulerName="default-scheduler"), "")
    (driver,) = desired.app.spec.components
    rendered = pod_template(driver, desired, domain=None, state=NONE, by_claim=True)
    (term,) = required_terms(rendered)
    assert [expression["key"] for expression in term] == [
        "hardware.robotics.io/video",  # shared: no claim chooses it
        "hardware.robotics.io/gpu",
    ]


def test_other_schedulers_are_gated_until_domain_and_nodes_are_checked_with_ros_1_too() -> None:
    for ros in ("humble", "noetic"):
        found = template(app={"schedulerName": "default-scheduler", "ros": {"distro": ros}})
        assert found["spec"]["schedulingGates"] == [{"name": SCHEDULING_GATE}]
        assert "schedulingGates" not in template(app={"ros": {"distro": ros}})["spec"]


def test_other_schedulers_get_pod_affinity_towards_earlier_components_only() -> None:
    app = make_app(
        component("a", colocateWith=["b"]), component("b", separateFrom=["c"]), component("c"), schedulerName="other"
    )
    desired = desired_of(app, "")
    first, second, third = (
        pod_template(part, desired, domain=DOMAIN, state=NONE)["spec"] for part in app.spec.components
    )
    assert "affinity" not in first
    (term,) = second["affinity"]["podAffinity"]["requiredDuringSchedulingIgnoredDuringExecution"]
    assert term["labelSelector"]["matchLabels"][Label.COMPONENT] == "a"
    assert "podAntiAffinity" in third["affinity"]


@pytest.mark.parametrize(("rule", "operator"), [("separateFrom", "NotIn"), ("colocateWith", "In")])
def test_other_schedulers_place_a_partner_of_the_robots_own_component_before_it_without_harm(
    rule: str, operator: str
) -> None:
    """The operator component comes first in the list: on the robot it would keep the other one off its only node for ever."""
    app = make_app(
        component("operator", **{rule: ["robot"]}),
        component("robot", runsOn=["Robot"]),
        schedulerName="other",
        robots={"nodeSelector": {"matchLabels": {"robotics.io/tier": "robot"}}},
    )
    desired = desired_of(app, "amr-07")
    first, second = (pod_template(part, desired, domain=DOMAIN, state=NONE) for part in app.spec.components)
    partner = {"key": "robotics.io/robot", "operator": operator, "values": ["amr-07"]}
    assert all(partner in term for term in required_terms(first))
    assert required_terms(second) == [[{"key": "robotics.io/robot", "operator": "In", "values": ["amr-07"]}]]


def test_cyclone_pods_have_a_name_of_their_own_and_await_the_others() -> None:
    app = {"ros2": {"rmw": "rmw_cyclonedds_cpp"}}
    spec = template(app=app)["spec"]
    assert spec["hostname"] == "driver"
    assert spec["subdomain"].startswith("teleop-peers-")
    (wait,) = spec["initContainers"]
    assert "other." in wait["command"][-1]
    assert "driver." not in wait["command"][-1]


def test_multicast_needs_neither_names_nor_waiting() -> None:
    spec = template(app={"ros2": {"discovery": {"mode": "Multicast"}}})["spec"]
    assert not {"hostname", "subdomain", "initContainers"} & spec.keys()


def test_the_components_own_init_containers_run_after_the_wait() -> None:
    spec = template(template={"spec": {"initContainers": [{"name": "own", "image": "x"}]}})["spec"]
    assert [step["name"] for step in spec["initContainers"]] == ["wait-for-names", "own"]


def test_a_ros_1_pod_advertises_its_own_address() -> None:
    found = env_of(template(app={"ros": {"distro": "noetic"}}))
    assert found["ROS_MASTER_URI"].endswith(":11311")
    assert found["ROS_IP"] == {"fieldRef": {"fieldPath": "status.podIP"}}
    assert "ROS_DOMAIN_ID" not in found


def test_an_external_master_is_used_as_written() -> None:
    app = {"ros": {"distro": "noetic"}, "ros1": {"master": "External", "uri": "http://m:11311"}}
    assert env_of(template(app=app))["ROS_MASTER_URI"] == "http://m:11311"


@pytest.mark.parametrize("kind", ["livenessProbe", "readinessProbe", "startupProbe"])
def test_plain_probes_are_passed_on(kind: str) -> None:
    probe = {"httpGet": {"port": 80}}
    assert template(**{kind: probe})["spec"]["containers"][0][kind] == probe


def test_a_ros_1_topic_is_asked_with_the_tools_of_ros_1() -> None:
    rendered = template(app={"ros": {"distro": "noetic"}}, ready={"topic": {"name": "/odom"}})
    assert "rostopic echo -n 1 /odom" in rendered["spec"]["containers"][0]["readinessProbe"]["exec"]["command"][-1]


def test_everything_of_the_container_is_passed_on() -> None:
    fields: dict[str, Any] = {
        "command": ["c"],
        "args": ["a"],
        "workingDir": "/w",
        "envFrom": [{"secretRef": {"name": "s"}}],
        "ports": [{"containerPort": 1}],
        "volumeMounts": [{"name": "v", "mountPath": "/v"}],
        "resources": {"requests": {"cpu": "1"}},
        "imagePullPolicy": "Always",
        "securityContext": {"runAsUser": 1},
        "lifecycle": {"preStop": {"exec": {"command": ["stop"]}}, "postStart": {"exec": {"command": ["go"]}}},
    }
    main = template(**fields)["spec"]["containers"][0]
    assert {name: main[name] for name in fields} == fields


def test_everything_of_the_template_is_passed_on() -> None:
    spec: dict[str, Any] = {
        "volumes": [{"name": "v", "emptyDir": {}}],
        "imagePullSecrets": [{"name": "s"}],
        "nodeSelector": {"a": "b"},
        "priorityClassName": "p",
        "serviceAccountName": "a",
        "securityContext": {"fsGroup": 1},
        "runtimeClassName": "r",
        "terminationGracePeriodSeconds": 5,
    }
    metadata = {"labels": {"team": "nav"}, "annotations": {"example.com/x": "y"}}
    rendered = template(template={"metadata": metadata, "spec": spec})
    assert {name: rendered["spec"][name] for name in spec} == spec
    assert rendered["metadata"]["labels"]["team"] == "nav"
    assert rendered["metadata"]["labels"][Label.COMPONENT] == "driver"
    assert rendered["metadata"]["annotations"]["example.com/x"] == "y"


@pytest.mark.parametrize(
    ("runs_on", "robot", "terms"),
    [
        (["Edge", "Robot"], "amr-07", [("robot", ["amr-07"]), ("tier", ["edge"])]),
        (["Robot", "Edge", "Cloud"], "amr-07", [("robot", ["amr-07"]), ("tier", ["edge", "cloud"])]),
        (["Edge", "Robot"], "", [("tier", ["edge", "robot"])]),
        (["Edge", "Cloud"], "amr-07", [("tier", ["edge", "cloud"])]),
    ],
)
def test_runs_on_allows_its_tiers_and_on_board_only_the_own_robot(
    runs_on: list[str], robot: str, terms: list[tuple[str, list[str]]]
) -> None:
    found = required_terms(template(robot=robot, runsOn=runs_on))
    assert [[(item["key"], item["values"]) for item in term] for term in found] == [
        [(f"robotics.io/{key}", values)] for key, values in terms
    ]


def test_a_component_that_falls_back_on_board_tolerates_its_robot_but_moves_when_it_is_lost() -> None:
    found = template(robot="amr-07", runsOn=["Edge", "Robot"])["spec"]["tolerations"]
    assert {"key": Label.ROBOT, "operator": "Equal", "value": "amr-07"} in found
    assert all("tolerationSeconds" in item for item in found if item["key"].startswith("node.kubernetes.io/"))


def test_apps_without_a_scheduler_take_the_operators() -> None:
    app = dataclasses.replace(make_app(), default_scheduler="batch")
    rendered = pod_template(app.spec.components[0], desired_of(app, ""), domain=DOMAIN, state=NONE)
    assert rendered["spec"]["schedulerName"] == "batch"
    assert template()["spec"]["schedulerName"] == "ros-aware-scheduler"


@pytest.mark.parametrize(
    ("runs_on", "robot", "kept"),
    [(["Robot"], "r", True), (["Edge", "Robot"], "r", True), ([], "r", True), ([], "", False), (["Edge"], "r", False)],
)
def test_other_schedulers_do_not_wait_for_a_pod_that_may_still_drive_so_it_is_kept(
    runs_on: list[str], robot: str, *, kept: bool
) -> None:
    app = {"schedulerName": "default-scheduler"}
    lost = [
        item for item in template(robot=robot, runsOn=runs_on, app=app)["spec"]["tolerations"] if "node." in item["key"]
    ]
    assert all(("tolerationSeconds" not in item) is kept for item in lost)
    written = template(robot=robot, runsOn=runs_on, app=app, onDisconnect="Failover")["spec"]["tolerations"]
    assert all("tolerationSeconds" in item for item in written if "node." in item["key"])
