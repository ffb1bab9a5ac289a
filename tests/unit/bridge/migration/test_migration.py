"""Deployments of the thesis' time: what they become, what is told, and what is refused."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.rigel.rigelfiles import orchestration, rendered

from rigel_bridge.main import main
from rigel_bridge.migration.found import Scene, scene
from rigel_bridge.migration.report import Plan, annotation, leftover_records, lines, plan
from rigel_bridge.names import SCHEDULER_PREFIX
from rigel_bridge.render.workloads import workloads
from robotapp_api.model import names

UIDS = [f"{n}{n}{n}{n}{n}{n}{n}{n}-0000-4000-8000-000000000000" for n in "abcd"]
TELEOP = {
    "policies": '{"latency_budget":"30ms","qos_class":"realtime","reliability":"reliable","deadline":"50ms"}',
    "topology": '{"master_node":"","preferred_zones":[]}',
}


def container(**fields: Any) -> dict[str, Any]:
    return {
        "name": "ros-app",
        "image": "acme/teleop:humble-1",
        "imagePullPolicy": "IfNotPresent",
        "resources": {},
        **fields,
    }


def deployment(
    name: str = "teleop", wishes: Mapping[str, str] = TELEOP, *containers: dict[str, Any], **pod: Any
) -> dict[str, Any]:
    annotations = {f"scheduler.robotics.io/{key}": text for key, text in wishes.items()}
    spec = {
        "schedulerName": "kubernetes-scheduler",
        "restartPolicy": "Always",
        "dnsPolicy": "ClusterFirst",
        "terminationGracePeriodSeconds": 30,
        "securityContext": {},
        "containers": list(containers) or [container()],
        **pod,
    }
    template = {"metadata": {"annotations": annotations, "labels": {"app": name}}, "spec": spec}
    metadata = {"name": name, "namespace": "fleet", "uid": f"uid-{name}"}
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": metadata,
        "spec": {"replicas": 1, "template": template},
    }


def planned(*objects: dict[str, Any], **options: Any) -> Plan:
    return plan(scene(objects, names=options.get("names", ())), **options)


def spec(*objects: dict[str, Any], **options: Any) -> dict[str, Any]:
    """Of the one app that objects become."""
    found = planned(*objects, **options)
    assert not found.refused, found.refused
    (made,) = found.apps
    app: dict[str, Any] = made.app["spec"]
    return app


def refusal(*objects: dict[str, Any], **options: Any) -> str:
    found = planned(*objects, **options)
    assert not found.apps
    (told,) = found.refused
    return told


def test_the_annotations_of_the_thesis_become_fields_and_defaults_are_left_out() -> None:
    assert spec(deployment()) == {
        "ros": {"distro": "humble"},
        "schedulerName": "kubernetes-scheduler",
        "components": [
            {
                "name": "teleop",
                "image": "acme/teleop:humble-1",
                "template": {"metadata": {"labels": {"app": "teleop"}}},
                "qosClass": "realtime",
                "policies": {"latencyBudget": "30ms", "reliability": "reliable", "deadline": "50ms"},
            }
        ],
    }


def test_what_the_bridge_writes_as_pods_comes_back_as_the_same_wishes() -> None:
    """The annotated form of `render` is the thesis' contract, so migrating it loses nothing."""
    block = """\
scheduler:
  name: kubernetes-scheduler
  policies: {latency_budget: 30ms, qos_class: realtime, reliability: reliable, durability: volatile,
             liveliness: manual_by_topic, deadline: 50ms, queue_size: 1, tcp_nodelay: true}
  topology: {master_node: edge-1, preferred_zones: [edge-zone-1]}
  affinity: {hardware_requirements: [{type: usb, model: cam}, {type: gpu, model: nvidia}]}
  shared_data: {peer_pods: [mapper], pvc: [map-pvc]}
  dds_domain: 7"""
    before = rendered(orchestration(block))
    objects, _ = workloads(before, annotated=True)
    for each in objects:
        each["metadata"].setdefault("namespace", "fleet")
    after, wanted = spec(*objects, distro="humble"), before.app["spec"]
    for key in ("schedulerName", "placement", "ros2", "ros"):
        assert after[key] == wanted[key]
    wishes = ("qosClass", "policies", "devices", "requires", "sharedData", "image", "args")
    (component,) = after["components"]
    assert {key: component[key] for key in wishes} == {key: wanted["components"][0][key] for key in wishes}


def test_workloads_that_name_one_another_are_one_app_whose_peers_are_components() -> None:
    ui = deployment("teleop-ui", {"shared-data": '{"peer_pods": ["robot_driver-7c9f54d8b6-x2x4z", "mapper"]}'})
    ui["spec"]["template"]["metadata"]["annotations"]["scheduler.robotics.io/shared-data"] = (
        '{"peer_pods": ["driver-7c9f54d8b6-x2x4z", "mapper"]}'
    )
    app = spec(ui, deployment("driver"))
    assert [each["name"] for each in app["components"]] == ["teleop-ui", "driver"]
    assert app["components"][0]["sharedData"] == {"with": ["driver"], "peerPods": ["mapper"]}


def test_variables_that_the_operator_sets_go_or_become_the_apps_fields() -> None:
    env = [
        {"name": "ROS_DOMAIN_ID", "value": "0"},
        {"name": "RMW_IMPLEMENTATION", "value": "rmw_cyclonedds_cpp"},
        {"name": "SPEED", "value": "1"},
    ]
    app = spec(deployment("a", TELEOP, container(env=env)))
    assert app["ros2"] == {"rmw": "rmw_cyclonedds_cpp"}
    assert app["components"][0]["env"] == [env[2]]
    env[0]["value"] = "150"
    assert spec(deployment("a", TELEOP, container(env=env)))["ros2"] == {
        "domain": 150,
        "allowUnsafeDomain": True,
        "rmw": "rmw_cyclonedds_cpp",
    }
    old = [{"name": "ROS_MASTER_URI", "value": "http://ros-master:11311"}, {"name": "ROS_IP", "value": "1.2.3.4"}]
    ros1 = spec(deployment("a", TELEOP, container(env=old, image="acme/x:noetic")))
    assert "ros1" not in ros1
    assert "env" not in ros1["components"][0]
    old[0]["value"] = "http://base.example:11311"
    ros1 = spec(deployment("a", TELEOP, container(env=old, image="acme/x:noetic")))
    assert ros1["ros1"] == {"master": "External", "uri": "http://base.example:11311"}


@pytest.mark.parametrize(("text", "wanted"), [("auto", None), ("7", {"domain": 7})])
def test_a_domain_is_kept_when_a_number_was_asked_for(text: str, wanted: object) -> None:
    assert spec(deployment("a", {"dds-domain": text})).get("ros2") == wanted


def test_a_bare_pod_is_a_workload_and_a_controlled_one_is_its_deployments() -> None:
    pod = deployment("lone")
    pod |= {"kind": "Pod", "apiVersion": "v1"}
    template = pod["spec"]["template"]
    pod["metadata"] |= template["metadata"]
    token = {"name": "kube-api-access-x", "projected": {}}
    pod["spec"] = template["spec"] | {"nodeName": "n1", "volumes": [token]}
    pod["spec"]["containers"][0]["volumeMounts"] = [{"name": "kube-api-access-x", "mountPath": "/var/run"}]
    (component,) = spec(pod)["components"]
    assert component["template"] == {"metadata": {"labels": {"app": "lone"}}}
    assert "volumeMounts" not in component
    pod["metadata"]["ownerReferences"] = [{"kind": "ReplicaSet", "uid": "x", "controller": True}]
    assert not planned(pod).apps


@pytest.mark.parametrize(
    ("wishes", "told"),
    [
        ({"policies": '{"latency_budget": "soon"}'}, "latencyBudget"),
        ({"policies": '{"latency": "30ms"}'}, "deployment fleet/a: annotation policies:1: latency: is not known"),
        ({"policies": "{"}, "deployment fleet/a: annotation policies"),
        ({"dds-domain": "999"}, "is not a DDS domain"),
    ],
)
def test_an_annotation_that_cannot_be_meant_keeps_its_workload_and_no_other(wishes: dict[str, str], told: str) -> None:
    found = planned(deployment("a", wishes), deployment("b"))
    assert [made.app["metadata"]["name"] for made in found.apps] == ["b"]
    assert told in found.refused[0]


def test_what_cannot_be_one_component_says_what_to_do() -> None:
    assert "write nodeSelector" in refusal(deployment("a", TELEOP, nodeName="n1"))
    assert "split the Deployment first" in refusal(deployment("a", TELEOP, container(), container(name="sidecar")))
    unknown = container(image="acme/x:1")
    assert "--distro" in refusal(deployment("a", TELEOP, unknown))
    assert spec(deployment("a", TELEOP, unknown), distro="jazzy")["ros"] == {"distro": "jazzy"}
    first, second = deployment("a.b"), deployment("a-b")
    found = planned(first, second)
    assert len(found.apps) == 1
    assert "another one already is" in found.refused[0]


def test_fields_without_a_place_are_named_and_labels_of_ours_go() -> None:
    made = deployment("a", TELEOP, container(terminationMessagePath="/m"), hostUsers=True, setHostnameAsFQDN=False)
    made["spec"]["template"]["metadata"]["labels"] |= {"robotics.io/app": "x", "pod-template-hash": "y"}
    (app,) = planned(made).apps
    assert app.lost == (
        "deployment fleet/a: spec.containers[0].terminationMessagePath",
        "deployment fleet/a: spec.hostUsers",
        "deployment fleet/a: metadata.labels.robotics.io/app",
    )


def recorded() -> Scene:
    """Two pods of `teleop` and one of another namespace, with their claims and fleet entries."""
    replicas = {"kind": "ReplicaSet", "metadata": {"name": "r", "uid": "rs", "ownerReferences": [owner("uid-teleop")]}}
    pods = [
        {
            "kind": "Pod",
            "metadata": {"name": f"p{n}", "namespace": "fleet", "uid": UIDS[n], "ownerReferences": [owner("rs")]},
        }
        for n in range(2)
    ]
    for pod in pods:
        pod["spec"] = {"containers": [container()]}
    annotations = {
        "scheduler.robotics.io/dds-claims": json.dumps({"5": UIDS[0], "6": UIDS[2]}),
        "scheduler.robotics.io/device-claims": json.dumps({"can": UIDS[1]}),
    }
    node = {"kind": "Node", "metadata": {"name": "n1", "annotations": annotations}}
    broken = {"kind": "Node", "metadata": {"name": "n2", "annotations": {"scheduler.robotics.io/dds-claims": "[1]"}}}
    fleet = {"kind": "ConfigMap", "metadata": {"name": "robot-fleet-assignments", "namespace": "fleet"}}
    fleet["data"] = {UIDS[0]: "n1", "teleop.amr-07": "a line of the operator's own"}  # type: ignore[assignment]
    return scene([deployment(), replicas, *pods, node, broken, fleet])


def owner(uid: str) -> dict[str, Any]:
    return {"uid": uid, "controller": True, "kind": "x"}


def test_the_report_follows_every_record_to_its_workload() -> None:
    told = "\n".join(lines(plan(recorded())))
    for part in (
        f"node n1: domain 5 held by pod {UIDS[0]} of deployment fleet/teleop: ",
        f"node n1: domain 6 held by pod {UIDS[2]}, which none of these workloads has: ",
        f"node n1: device can held by pod {UIDS[1]} of deployment fleet/teleop: ",
        "node n2: annotation scheduler.robotics.io/dds-claims is not a JSON map",
        f"configmap fleet/robot-fleet-assignments: entry of pod {UIDS[0]} of deployment fleet/teleop: ",
    ):
        assert part in told
    assert "teleop.amr-07" not in told


def test_only_records_of_migrated_pods_are_cleared() -> None:
    kept = leftover_records(recorded().claims, gone=UIDS[:2])
    assert kept == {("n1", "dds-claims"): {"6": UIDS[2]}, ("n1", "device-claims"): {}}
    assert leftover_records(recorded().claims, gone=["other"]) == {}, "a record that does not change is not written"
    assert annotation("dds-claims", {"6": "u"}) == 'scheduler.robotics.io/dds-claims={"6": "u"}'
    assert annotation("device-claims", {}) == "scheduler.robotics.io/device-claims-"


def test_pods_of_a_robotapp_and_pods_without_wishes_are_none_of_ours() -> None:
    child = deployment()
    child["metadata"]["ownerReferences"] = [{"kind": "RobotApp", "uid": "u"}]
    plain = deployment("web", {}, schedulerName="default-scheduler")
    kept = deployment("db") | {"kind": "StatefulSet"}
    found = planned(child, plain, kept, deployment("ros-master"))
    assert not found.apps
    assert found.scene.notes == (
        "statefulset fleet/db has the thesis' annotations and stays: a RobotApp makes Deployments",
        "deployment fleet/ros-master stays: a RobotApp of ROS 1 gets a master of its own; delete this one when nobody uses it",
    )


def test_a_workload_without_annotations_is_taken_over_when_it_is_named() -> None:
    """As Rigel's orchestration plugin makes them where no scheduler block is written."""
    plain = deployment("rigel-k8s-application", {}, schedulerName="default-scheduler")
    assert not planned(plain).apps
    app = spec(plain, names=["rigel-k8s-application"])
    assert "schedulerName" not in app
    assert [each["name"] for each in app["components"]] == ["rigel-k8s-application"]


def test_the_words_are_those_of_the_api() -> None:
    from rigel_bridge.migration import found

    own = {names.Annotation.POLICIES, names.Annotation.TOPOLOGY, names.Annotation.AFFINITY}
    own |= {names.Annotation.SHARED_DATA, names.Annotation.DDS_DOMAIN}
    assert {SCHEDULER_PREFIX + key for key in found.WISHES} == {str(each) for each in own}
    assert found.FLEET == names.FLEET_CONFIG_MAP


def test_a_file_is_migrated_without_a_cluster(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "cluster.json"
    path.write_text(json.dumps({"kind": "List", "items": [deployment(), deployment("b")]}))
    assert main(["migrate", "teleop", "-f", str(path), "--report", str(tmp_path / "report.json")]) == 0
    (app,) = yaml.safe_load_all(capsys.readouterr().out)
    assert app["metadata"]["annotations"] == {"rigel.robotics.io/migrated-from": "deployment fleet/teleop"}
    assert json.loads((tmp_path / "report.json").read_text())["apps"][0]["from"] == ["deployment fleet/teleop"]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"items": [1]}', "[" * 100_000, '{"items": [{"metadata": {}}]}'])
def test_a_file_that_is_no_list_of_objects_is_one_line(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cluster.json"
    path.write_text(text)
    assert main(["migrate", "-f", str(path)]) == 71
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (
            ["--distro", "jazy"],
            (2, "migrate: --distro 'jazy' is no ROS distribution that we know (did you mean jazzy?)"),
        ),
        (["talkr"], (76, "migrate: there is no Deployment or pod talkr (did you mean talker?)")),
    ],
)
def test_a_slip_in_a_name_is_told_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: list[str], expected: tuple[int, str]
) -> None:
    path = tmp_path / "cluster.json"
    path.write_text(json.dumps({"items": [deployment("talker")]}))
    assert main(["migrate", "-f", str(path), *flags]) == expected[0]
    written = capsys.readouterr()
    assert (written.out, written.err.strip()) == ("", expected[1])


def test_apply_needs_a_backup_and_one_namespace(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["migrate", "--apply"]) == 2
    assert "--backup" in capsys.readouterr().err
    assert main(["migrate", "--apply", "-A", "--backup", "x"]) == 2
