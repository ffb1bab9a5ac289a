"""The app as plain objects: annotated pods for our scheduler, manifests for any."""

import json
from typing import Any

import pytest
import yaml
from tests.support.rigel.jobfiles import G3, with_block
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration, rendered

from rigel_bridge.render.workloads import workloads

EVERYTHING = """\
scheduler:
  name: kubernetes-scheduler
  policies: {latency_budget: 30ms, qos_class: realtime, reliability: reliable, durability: volatile,
             liveliness: manual_by_topic, deadline: 50ms, queue_size: 1, tcp_nodelay: true}
  topology: {master_node: edge-1, preferred_zones: [edge-zone-1, cloud-zone-1]}
  affinity: {hardware_requirements: [{type: can, interface: can0}, {type: gpu, model: nvidia}]}
  shared_data: {peer_pods: [mapper], pvc: [map-pvc]}
  dds_domain: 7"""


def objects(text: str, *, annotated: bool, **options: Any) -> list[dict[str, Any]]:
    return list(workloads(rendered(text, **options), annotated=annotated)[0])


def pod(text: str, *, annotated: bool, **options: Any) -> dict[str, Any]:
    template: dict[str, Any] = objects(text, annotated=annotated, **options)[-1]["spec"]["template"]
    return template


def test_the_scheduler_block_comes_back_from_the_annotations_without_loss() -> None:
    found = pod(orchestration(EVERYTHING), annotated=True)
    block = yaml.safe_load(EVERYTHING)["scheduler"]
    annotations = {
        key: value for key, value in found["metadata"]["annotations"].items() if key.startswith("scheduler.")
    }
    domain = annotations.pop("scheduler.robotics.io/dds-domain")
    words = {key.partition("/")[2].replace("-", "_"): json.loads(value) for key, value in annotations.items()}
    assert {**words, "name": found["spec"]["schedulerName"], "dds_domain": int(domain)} == block


def test_a_granted_domain_reaches_the_program() -> None:
    found = pod(ONE, annotated=True)
    assert found["metadata"]["annotations"]["scheduler.robotics.io/dds-domain"] == "auto"
    assert found["spec"]["schedulerName"] == "ros-aware-scheduler"
    granted = {"fieldRef": {"fieldPath": "metadata.annotations['granted.robotics.io/dds-domain']"}}
    assert found["spec"]["containers"][0]["env"] == [{"name": "ROS_DOMAIN_ID", "valueFrom": granted}]


def test_pods_that_must_share_a_domain_are_not_given_one_each() -> None:
    rendering = rendered(TWO)
    found, notes = workloads(rendering, annotated=True)
    assert all("dds-domain" not in str(one) for one in found)
    assert "ROS_DOMAIN_ID is 0, which every laptop uses" in notes[-1]


def test_kube_schedulers_own_pods_carry_no_annotations() -> None:
    found = pod(G3, annotated=True, sequence="benchmark_default")
    assert "annotations" not in found["metadata"]
    assert found["spec"]["schedulerName"] == "default-scheduler"


def test_manifests_name_no_scheduler_and_say_what_is_left_out() -> None:
    found, notes = workloads(rendered(orchestration(EVERYTHING)), annotated=False)
    assert "schedulerName" not in found[0]["spec"]["template"]["spec"]
    assert "scheduler.robotics.io" not in str(found)
    assert (
        "Rigelfile:12: spec.components[0].policies needs the operator and its scheduler; plain objects have no place for it"
        in notes
    )


@pytest.mark.parametrize("annotated", [True, False])
def test_ros_1_brings_its_master_and_the_address_that_peers_call_back(annotated: bool) -> None:
    service, master, app = objects(ONE.replace("humble", "noetic"), annotated=annotated)
    assert (service["kind"], service["metadata"]["name"]) == ("Service", "app-ros-master")
    (container,) = master["spec"]["template"]["spec"]["containers"]
    assert (container["image"], container["args"]) == ("ros:noetic-ros-core", ["roscore"])
    env = {entry["name"]: entry for entry in app["spec"]["template"]["spec"]["containers"][0]["env"]}
    assert env["ROS_MASTER_URI"]["value"] == "http://app-ros-master:11311"
    assert env["ROS_IP"]["valueFrom"] == {"fieldRef": {"fieldPath": "status.podIP"}}
    assert "ROS_DOMAIN_ID" not in env


def test_an_external_master_is_used_and_none_deployed() -> None:
    block = "{deploy_ros_master: false, robotapp: {ros1: {uri: 'http://m:11311'}}}"
    (app,) = objects(orchestration(block, ONE.replace("humble", "noetic")), annotated=False)
    assert {"name": "ROS_MASTER_URI", "value": "http://m:11311"} in app["spec"]["template"]["spec"]["containers"][0][
        "env"
    ]


def test_storage_and_strategy_are_the_settings_of_the_reference_plugin() -> None:
    block = "{rolling_update: {max_surge: 2}, persistent_storage: {volumes: [{name: logs, size: 1Gi, storage_class: fast}]}}"
    claim, app = objects(with_block(block), annotated=False, namespace="lab")
    assert claim["metadata"] == {"name": "logs-pvc", "namespace": "lab", "labels": {"rigel.robotics.io/app": "app"}}
    assert app["spec"]["strategy"] == {"type": "RollingUpdate", "rollingUpdate": {"maxSurge": 2, "maxUnavailable": 0}}
    assert app["spec"]["template"]["spec"]["volumes"][0]["persistentVolumeClaim"] == {"claimName": "logs-pvc"}


def test_one_pod_is_replaced_when_it_is_gone() -> None:
    assert objects(ONE, annotated=False)[0]["spec"]["strategy"] == {"type": "Recreate"}
