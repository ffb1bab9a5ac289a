"""Nodes and pods of real size as ready bytes: a template per state, filled in by replacing marks.

A pending pod has about 5 kB, a running one and a node 6 to 7 kB, as measured on real clusters; half of it is
`managedFields` and other things nobody reads.
"""

import json
from typing import Any, Final

Json = dict[str, Any]
ZONES: Final = 10
NAMESPACE: Final = "bench"
SCHEDULER: Final = "ros-aware-scheduler"
WHEN: Final = "2026-01-01T00:00:00Z"
MEMORY_KI: Final = 102_400
PLACE: Final = {"topology.kubernetes.io/region": "region-1", "topology.kubernetes.io/zone": "@zone@"}
"""Labels of a node, which the API server copies to the pods bound to it."""


def fill(template: bytes, **marks: object) -> bytes:
    """The template with every `@mark@` replaced."""
    for mark, value in marks.items():
        template = template.replace(b"@%s@" % mark.encode(), str(value).encode())
    return template


def pod_name(index: int) -> str:
    return f"pod-{index:06}"


def pod_index(name: str) -> int:
    return int(name.removeprefix("pod-"))


def node_name(index: int) -> str:
    return f"node-{index:05}"


def pod(template: bytes, index: int, *, version: int, node: str = "", shape: int = 0) -> bytes:
    """Pod `index`; pods of another `shape` request another amount of memory, which makes them another class."""
    known = {"name": pod_name(index), "number": f"{index:012}", "version": version, "memory": MEMORY_KI + shape}
    return fill(template, **known, node=node, zone=zone_of(node)) if node else fill(template, **known)


def node(index: int) -> bytes:
    name = node_name(index)
    return fill(NODE, name=name, number=f"{index:012}", version=index + 1, zone=zone_of(name))


def zone_of(node: str) -> str:
    return f"zone-{int(node.removeprefix('node-')) % ZONES}"


def _encoded(obj: Json) -> bytes:
    return json.dumps(obj, separators=(",", ":")).encode()


def _managed(manager: str, paths: int) -> Json:
    fields = {f"f:field{number:02}": {"f:name": {}, "f:value": {}, ".": {}} for number in range(paths)}
    return {
        "manager": manager,
        "operation": "Update",
        "apiVersion": "v1",
        "time": WHEN,
        "fieldsType": "FieldsV1",
        "fieldsV1": {"f:metadata": fields},
    }


def _metadata(kind: str, **more: Any) -> Json:
    return {
        "name": "@name@",
        "uid": f"00000000-{kind}-4000-8000-@number@",
        "resourceVersion": "@version@",
        "creationTimestamp": WHEN,
        **more,
    }


def _container() -> Json:
    environment = [{"name": f"ROS_SETTING_{number}", "value": f"/opt/ros/share/{number}"} for number in range(8)]
    environment.append({"name": "NODE", "valueFrom": {"fieldRef": {"apiVersion": "v1", "fieldPath": "spec.nodeName"}}})
    amount = {"cpu": "100m", "memory": "@memory@Ki"}
    probe = {"httpGet": {"path": "/healthz", "port": 8080, "scheme": "HTTP"}, "timeoutSeconds": 1, "periodSeconds": 10}
    return {
        "name": "main",
        "image": "registry.example.com/fleet/driver:1.4.2",
        "command": ["/ros_entrypoint.sh", "ros2", "launch", "driver", "driver.launch.py"],
        "ports": [{"name": "metrics", "containerPort": 8080, "protocol": "TCP"}],
        "env": environment,
        "resources": {"limits": amount, "requests": amount},
        "volumeMounts": [
            {"name": "config", "mountPath": "/etc/driver"},
            {"name": "token", "readOnly": True, "mountPath": "/var/run/secrets/kubernetes.io/serviceaccount"},
        ],
        "livenessProbe": probe,
        "readinessProbe": probe,
        "terminationMessagePath": "/dev/termination-log",
        "terminationMessagePolicy": "File",
        "imagePullPolicy": "IfNotPresent",
    }


def _spec(*, bound: bool) -> Json:
    sources = [
        {"serviceAccountToken": {"expirationSeconds": 3607, "path": "token"}},
        {"configMap": {"name": "kube-root-ca.crt", "items": [{"key": "ca.crt", "path": "ca.crt"}]}},
    ]
    missing = [
        {"key": f"node.kubernetes.io/{what}", "operator": "Exists", "effect": "NoExecute", "tolerationSeconds": 300}
        for what in ("not-ready", "unreachable")
    ]
    return {
        "volumes": [
            {"name": "config", "configMap": {"name": "driver", "defaultMode": 420}},
            {"name": "token", "projected": {"sources": sources, "defaultMode": 420}},
        ],
        "containers": [_container()],
        "restartPolicy": "Always",
        "terminationGracePeriodSeconds": 30,
        "dnsPolicy": "ClusterFirst",
        "serviceAccountName": "driver",
        "serviceAccount": "driver",
        **({"nodeName": "@node@"} if bound else {}),
        "securityContext": {},
        "schedulerName": SCHEDULER,
        "tolerations": missing,
        "priority": 0,
        "enableServiceLinks": True,
        "preemptionPolicy": "PreemptLowerPriority",
    }


def _conditions(*kinds: str) -> list[Json]:
    return [
        {"type": kind, "status": "True", "lastProbeTime": None, "lastTransitionTime": WHEN, "observedGeneration": 1}
        for kind in kinds
    ]


def _pod(*, bound: bool, status: Json, managed: int) -> bytes:
    owner = {
        "apiVersion": "apps/v1",
        "kind": "ReplicaSet",
        "name": "driver-7d9c9c",
        "uid": "o" * 36,
        "controller": True,
    }
    metadata = _metadata(
        "0000",
        namespace=NAMESPACE,
        generation=1,
        generateName="driver-7d9c9c-",
        labels={"app": "driver", "pod-template-hash": "7d9c9c", "team": "fleet"} | (PLACE if bound else {}),
        annotations={"prometheus.io/scrape": "true", "prometheus.io/port": "8080"},
        ownerReferences=[owner],
        managedFields=[_managed("kubelet", managed)],
    )
    return _encoded(
        {"kind": "Pod", "apiVersion": "v1", "metadata": metadata, "spec": _spec(bound=bound), "status": status}
    )


def _running() -> Json:
    started = {
        "name": "main",
        "state": {"running": {"startedAt": WHEN}},
        "lastState": {},
        "ready": True,
        "restartCount": 0,
        "image": "registry.example.com/fleet/driver:1.4.2",
        "imageID": "registry.example.com/fleet/driver@sha256:" + "a" * 64,
        "containerID": "containerd://" + "c" * 64,
        "started": True,
    }
    ready = _conditions("PodReadyToStartContainers", "Initialized", "Ready", "ContainersReady", "PodScheduled")
    return {
        "phase": "Running",
        "conditions": ready,
        "hostIP": "10.0.0.1",
        "podIP": "10.1.0.1",
        "startTime": WHEN,
        "containerStatuses": [started],
        "qosClass": "Guaranteed",
    }


def _node() -> bytes:
    labels = {
        "kubernetes.io/hostname": "@name@",
        "kubernetes.io/arch": "amd64",
        "kubernetes.io/os": "linux",
        "node.kubernetes.io/instance-type": "c8.xlarge",
        **PLACE,
    }
    capacity = {"cpu": "32", "memory": "256Gi", "pods": "110", "ephemeral-storage": "500Gi", "hugepages-2Mi": "0"}
    image = "registry.example.com/fleet/image-{0}"
    images = [
        {"names": [f"{image.format(n)}@sha256:{'b' * 64}", f"{image.format(n)}:1.{n}"], "sizeBytes": 10_000_000 * n}
        for n in range(1, 16)
    ]
    status = {
        "capacity": capacity,
        "allocatable": capacity,
        "conditions": _conditions("Ready"),
        "addresses": [{"type": "InternalIP", "address": "10.0.0.1"}, {"type": "Hostname", "address": "@name@"}],
        "daemonEndpoints": {"kubeletEndpoint": {"Port": 10250}},
        "nodeInfo": {"kubeletVersion": "v1.37.1", "osImage": "Linux", "architecture": "amd64"},
        "images": images,
    }
    managed = [_managed(f"manager-{number}", 28) for number in range(2)]
    metadata = _metadata("0001", labels=labels, annotations={"volumes": "true"}, managedFields=managed)
    spec = {"podCIDR": "10.1.0.0/24", "providerID": "cloud://@name@"}
    return _encoded({"kind": "Node", "apiVersion": "v1", "metadata": metadata, "spec": spec, "status": status})


PENDING: Final = _pod(bound=False, status={"phase": "Pending", "qosClass": "Guaranteed"}, managed=42)
BOUND: Final = _pod(
    bound=True,
    status={"phase": "Pending", "conditions": _conditions("PodScheduled"), "qosClass": "Guaranteed"},
    managed=42,
)
RUNNING: Final = _pod(bound=True, status=_running(), managed=48)
NODE: Final = _node()
