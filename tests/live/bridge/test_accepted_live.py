"""What the bridge writes, given to the real API server and to the real Rigel."""

from pathlib import Path

import pytest
import yaml
from tests.support.rigel.jobfiles import G3, with_block
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration

from rigel_bridge.main import main
from robotapp_testbed import ControlPlane

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "rigel" / "teleop" / "Rigelfile"
NOETIC = ONE.replace("humble", "noetic")
SAMPLES = {
    "smallest": ONE,
    "own-dockerfile": TWO,
    "ros1": orchestration("{deploy_ros_master: true, ros_master_image: 'ros:noetic'}", NOETIC),
    "ros1-external": orchestration(
        "{deploy_ros_master: false, robotapp: {ros1: {uri: 'http://master:11311'}}}", NOETIC
    ),
    "every-scheduler-field": orchestration(
        """\
scheduler:
  name: kubernetes-scheduler
  policies: {latency_budget: 30ms, qos_class: realtime, reliability: reliable, durability: volatile,
             liveliness: manual_by_topic, deadline: 50ms, queue_size: 1, tcp_nodelay: true}
  topology: {master_node: edge-1, preferred_zones: [edge-zone-1, cloud-zone-1]}
  affinity: {hardware_requirements: [{type: usb, model: cam}, {type: can, interface: can0}, {type: gpu, model: nvidia}]}
  shared_data: {peer_pods: [mapper], pvc: [map-pvc]}
  dds_domain: 7"""
    ),
    "robotapps-own-words": orchestration(
        """\
components:
  base_driver:
    runsOn: [Edge, Robot]
    devices: [{name: cam, type: usb, usbID: '8086:0b3a', sharing: Cluster}]
    requires: [{type: gpu, model: nvidia, interface: pcie}]
    parameters: [{inline: '/**: {ros__parameters: {v: 1.0}}'}, {configMapKeyRef: {name: drv, key: $(ROBOTAPP_ROBOT).yaml}}]
    readinessProbe: {tcpSocket: {port: 80}}
    lifecycle: {preStop: {exec: {command: ['true']}}}
    sharedData: {claimNames: [map-pvc]}
    template: {metadata: {labels: {team: a}}, spec: {tolerations: [{key: gpu, operator: Exists}], nodeSelector: {disk: ssd}}}
robotapp:
  robots: {nodeSelector: {matchLabels: {robotics.io/robot: amr-07}}, assignment: Any}
  edges: [{kind: Service, topic: /map, from: base-driver, to: '@robot', rateHz: 500m}]
  placement: {gang: None}
  ros2: {rmw: rmw_zenoh_cpp, pool: lab}
  update: {operator: OnDemand}"""
    ),
}


REFERENCE = with_block(
    """{readiness: {command: 'true'}, distributed: {enabled: true, default_to_remote: true}, results: {source_path: /r},
        persistent_storage: {volumes: [{name: logs, size: 1Gi}]}, image_pull_secrets: [ghcr], rolling_update: {max_surge: 1},
        additional_k8s_params: {application: {spec: {replicas: 1, template: {spec: {tolerations: [{operator: Exists}],
          containers: [{name: ros-app, ports: [{containerPort: 8080}], volumeMounts: [{name: logs, mountPath: /l}]}]}}}}}}"""
)
JOBS = {"jobs": G3, "settings-of-the-reference-plugin": REFERENCE}


@pytest.mark.live
@pytest.mark.parametrize("form", ["robotapp", "pods", "manifests"])
def test_every_form_of_every_file_is_stored(
    installed_plane: ControlPlane, namespace: str, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "Rigelfile"
    documents = []
    for name, text in {**SAMPLES, **JOBS}.items():
        path.write_text(text)
        assert main(["render", str(path), "-n", namespace, "--name", name, "--format", form]) == 0
        documents.append(capsys.readouterr().out)
    installed_plane.kubectl("create", "--dry-run=server", "-f", "-", "--validate=strict", stdin="---\n".join(documents))


@pytest.mark.live
@pytest.mark.parametrize("sample", ["example", *SAMPLES])
def test_the_api_server_stores_what_was_rendered(
    installed_plane: ControlPlane, namespace: str, sample: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = EXAMPLE
    if sample != "example":
        path = tmp_path / sample / "Rigelfile"
        path.parent.mkdir()
        path.write_text(SAMPLES[sample])
    assert main(["render", str(path), "-n", namespace]) == 0
    text = capsys.readouterr().out
    installed_plane.kubectl("apply", "-f", "-", "--validate=strict", stdin=text)
    wanted = yaml.safe_load(text)
    name = wanted["metadata"]["name"]
    stored = yaml.safe_load(installed_plane.kubectl("get", "robotapp", name, "-n", namespace, "-o", "yaml"))
    assert covers(stored["spec"], wanted["spec"])


def covers(stored: object, wanted: object) -> bool:
    """Whether everything wanted is stored (defaults come on top)."""
    if isinstance(wanted, dict):
        return isinstance(stored, dict) and all(
            key in stored and covers(stored[key], value) for key, value in wanted.items()
        )
    if isinstance(wanted, list):
        return isinstance(stored, list) and len(stored) == len(wanted) and all(map(covers, stored, wanted))
    return stored == wanted
