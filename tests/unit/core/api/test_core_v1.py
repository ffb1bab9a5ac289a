import msgspec
from tests.support.scheduling import make_core

from robotapp_scheduler.core.api.core_v1 import Node, Pod
from robotapp_scheduler.core.api.robotics_v1alpha1 import NodeTelemetry, RobotApp

POD = b"""{"apiVersion":"v1","kind":"Pod","metadata":{"name":"p","namespace":"d","uid":"u","creationTimestamp":null,
"managedFields":[{"manager":"x"}],"ownerReferences":[{"apiVersion":"apps/v1","kind":"ReplicaSet","name":"r","uid":"o",
"controller":true,"blockOwnerDeletion":true}]},"spec":{"containers":[{"name":"c","image":"i","ports":[{"containerPort":1,
"hostPort":7400,"hostIP":"10.0.0.1","protocol":"UDP"}],"resources":{"requests":{"cpu":"1"},"limits":{"cpu":"2"}}}],
"affinity":{"nodeAffinity":{"requiredDuringSchedulingIgnoredDuringExecution":{"nodeSelectorTerms":[{"matchExpressions":
[{"key":"k","operator":"In","values":["v"]}]}]}}},"tolerations":[{"key":"t","operator":"Exists","tolerationSeconds":300}]},
"status":{"phase":"Pending","qosClass":"Burstable"}}"""


def test_a_pod_is_decoded_from_the_api_servers_bytes_and_unknown_fields_are_skipped() -> None:
    pod = msgspec.json.decode(POD, type=Pod)
    assert (pod.key, pod.metadata.uid, pod.status.phase) == ("d/p", "u", "Pending")
    port = (pod.spec.containers[0].ports or [])[0]
    assert (port.host_ip, port.host_port, port.protocol) == ("10.0.0.1", 7400, "UDP")
    assert pod.spec.affinity is not None
    assert pod.spec.affinity.node_affinity is not None
    required = pod.spec.affinity.node_affinity.required
    assert required is not None
    assert required.node_selector_terms[0].match_expressions[0].values == ("v",)
    assert hash(required) == hash(required)


def test_of_a_pods_volumes_only_those_are_kept_that_decide_something() -> None:
    plain = [
        {"name": "token", "projected": {"sources": []}},
        {"name": "config", "configMap": {"name": "c"}},
        {"name": "host", "hostPath": {"path": "/dev"}},
    ]
    claim = {"name": "data", "persistentVolumeClaim": {"claimName": "data"}}
    image = {"name": "model", "image": {"reference": "models/a:1"}}
    kept = msgspec.convert({"spec": {"volumes": [plain[0], claim, *plain[1:], image]}}, Pod).spec.volumes
    assert [volume.name for volume in kept or ()] == ["data", "model"]
    assert msgspec.convert({"spec": {"volumes": plain}}, Pod).spec.volumes is None


def test_terminal_phases_are_known() -> None:
    for phase, terminal in (("Succeeded", True), ("Failed", True), ("Running", False), ("", False)):
        assert msgspec.convert({"status": {"phase": phase}}, Pod).terminal is terminal


def test_an_empty_node_decodes_to_defaults() -> None:
    node = msgspec.json.decode(b'{"metadata":{"name":"n"},"spec":{},"status":{}}', type=Node)
    assert (node.spec.unschedulable, node.spec.taints, node.status.allocatable) == (False, (), None)


def test_a_robot_app_keeps_both_ends_of_its_edges() -> None:
    raw = b'{"metadata":{"uid":"a"},"spec":{"components":[{"name":"driver","sharedData":{"with":["map"]}}],"edges":[{"topic":"/t","from":"a","to":"@robot","latency":{"budget":"30ms"}}]}}'
    app = msgspec.json.decode(raw, type=RobotApp)
    edge = app.spec.edges[0]
    assert (edge.from_, edge.to, edge.latency and edge.latency.percentile) == ("a", "@robot", 95)
    assert app.spec.components[0].shared_data.with_ == ("map",)


def test_telemetry_decodes() -> None:
    telemetry = msgspec.json.decode(
        b'{"metadata":{"name":"n"},"status":{"rtt":[{"peer":"m","p50Us":1500,"p95Us":2500}],"load":{"cpuPercent":12,"memoryPercent":100}}}',
        type=NodeTelemetry,
    )
    assert telemetry.status.rtt[0].p95_us == 2500
    assert telemetry.status.load is not None
    assert (telemetry.status.load.cpu_percent, telemetry.status.load.memory_percent) == (12, 100)
    assert telemetry.status.load.gpu_percent is None


def test_a_node_with_an_image_nobody_named_is_read_as_the_api_server_writes_it() -> None:
    raw = (
        b'{"metadata":{"name":"n"},"status":{"images":[{"names":null,"sizeBytes":5},{"names":["a:1"],"sizeBytes":7}]}}'
    )
    core = make_core(msgspec.json.decode(raw, type=Node))
    assert core.cluster.nodes.count == 1
    core.cluster.remove_node("n")
    assert core.cluster.nodes.count == 0
