"""The pods of an app that is tried are placed as those that the operator makes: two programs, compared field by field."""

from typing import Any

import msgspec
import pytest
from tests.support.factories import component, make_app
from tests.support.scheduling import make_node

from robotapp_api.model.names import API_VERSION, SCHEDULER_NAME, Label
from robotapp_operator.plan.render.node_affinity import DISCONNECTED
from robotapp_operator.plan.render.parameters import NONE
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import desired_of
from robotapp_scheduler.core.api.core_v1 import Pod, PodSpec
from robotapp_scheduler.core.pods.pod_signature import required_features_of
from robotapp_scheduler.what_if.app_pods import tried_app
from robotapp_scheduler.what_if.question import QuestionError

ROBOT = {str(Label.ROBOT): "amr", str(Label.TIER): "robot"}
SELECTOR = {"nodeSelector": {"matchLabels": {str(Label.ROBOT): "amr"}}}
GPU = {"key": "gpu", "operator": "Exists"}
COMPONENTS = {
    "plain": {},
    "on board": {"runsOn": ["Robot"]},
    "edge, then on board": {"runsOn": ["Edge", "Robot"]},
    "cloud": {"runsOn": ["Cloud"]},
    "requests": {"resources": {"requests": {"cpu": "500m", "memory": "1Gi"}, "limits": {"nvidia.com/gpu": "1"}}},
    "limits": {"resources": {"limits": {"cpu": "2"}}},
    "mount options": {"volumeMounts": [{"name": "d", "mountPath": "/d", "bindMountOptions": ["noexec"]}]},
    "restart rules": {
        "template": {
            "spec": {"initContainers": [{"name": "i", "restartPolicyRules": [{"action": "RestartAllContainers"}]}]}
        }
    },
    "host port": {"ports": [{"containerPort": 80, "hostPort": 8080}, {"containerPort": 81}]},
    "network of the node": {
        "ports": [{"containerPort": 80}],
        "template": {
            "spec": {"hostNetwork": True, "containers": [{"name": "w", "image": "w", "ports": [{"containerPort": 9}]}]}
        },
    },
    "a replica with an ordinal": {"replicaIdentity": "Ordinal"},
    "further containers": {
        "template": {"spec": {"containers": [{"name": "w", "image": "w", "resources": {"requests": {"cpu": "2"}}}]}}
    },
    "template": {
        "template": {
            "metadata": {"labels": {"team": "a"}},
            "spec": {
                "nodeSelector": {"disk": "ssd"},
                "tolerations": [GPU],
                "initContainers": [{"name": "i", "image": "i", "resources": {"requests": {"cpu": "3"}}}],
                "volumes": [{"name": "data", "persistentVolumeClaim": {"claimName": "maps"}}],
            },
        }
    },
}


def of_operator(written: dict[str, Any], robot: str) -> Pod:
    app = make_app(component(**written), **({"robots": SELECTOR} if robot else {}))
    found = pod_template(app.spec.components[0], desired_of(app, robot), domain=None, state=NONE)
    for each in found["spec"]["containers"] if found["spec"].get("hostNetwork") else ():
        for port in each.get("ports", ()):
            port["hostPort"] = port["containerPort"]  # as the API server defaults it
    pod = msgspec.convert(found, Pod)
    for each in (*pod.spec.containers, *(pod.spec.init_containers or ())):  # as the API server defaults them
        limits = found["spec"]["containers"][0].get("resources", {}).get("limits", {}) if each.name == "driver" else {}
        each.resources.requests = {**limits, **(each.resources.requests or {})} or None
    return pod


def of_scheduler(written: dict[str, Any], robot: str) -> Pod:
    source = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": "teleop", "namespace": "default"},
        "spec": {"components": [component(**written)], **({"robots": SELECTOR} if robot else {})},
    }
    (pod,) = tried_app(source, [make_node("amr", labels=ROBOT)], profiles=[SCHEDULER_NAME]).pods
    return pod


def deciding(spec: PodSpec) -> dict[str, Any]:
    """What decides a placement. How long a pod stays on a lost node does not."""
    return {
        "scheduler": spec.scheduler_name,
        "selector": spec.node_selector or {},
        "affinity": spec.affinity,
        "tolerations": [each for each in spec.tolerations if each.key not in DISCONNECTED],
        "requests": [each.resources.requests or {} for each in spec.containers],
        "init": [each.resources.requests or {} for each in spec.init_containers or ()],
        "ports": [(port.host_port, port.protocol) for each in spec.containers for port in each.ports or ()],
        "images": [each.image for each in spec.containers],
        "features": required_features_of(spec),
        "volumes": [each.name for each in spec.volumes or ()],
    }


@pytest.mark.parametrize("robot", ["", "amr"], ids=["without robots", "on a robot"])
@pytest.mark.parametrize("written", COMPONENTS.values(), ids=COMPONENTS)
def test_what_decides_a_placement_is_what_the_operator_writes(written: dict[str, Any], robot: str) -> None:
    ours, theirs = of_scheduler(written, robot), of_operator(written, robot)
    assert deciding(ours.spec) == deciding(theirs.spec)
    labels = {key: value for key, value in (theirs.metadata.labels or {}).items() if key != Label.APP_UID}
    found = ours.metadata.labels or {}
    assert {key: found.get(key) for key in labels} == labels


@pytest.mark.parametrize("written", COMPONENTS.values(), ids=COMPONENTS)
def test_a_sweep_has_the_pods_of_as_many_instances_as_run_at_once_on_any_robot(written: dict[str, Any]) -> None:
    matrix = {"parameters": [{"name": "seed", "values": ["1", "2", "3"]}], "parallelism": 2}
    source = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": "teleop", "namespace": "default"},
        "spec": {"components": [component(**written, job={})], "matrix": matrix},
    }
    pods = tried_app(source, [make_node("amr", labels=ROBOT)], profiles=[SCHEDULER_NAME]).pods
    app = make_app(component(**written, job={}), matrix=matrix)
    assert [(pod.metadata.labels or {})[Label.INSTANCE] for pod in pods] == [*app.sweep][:2]
    for pod in pods:
        instance = (pod.metadata.labels or {})[Label.INSTANCE]
        theirs = pod_template(app.spec.components[0], desired_of(app, instance), domain=None, state=NONE)
        assert deciding(pod.spec)["affinity"] == msgspec.convert(theirs, Pod).spec.affinity


def test_a_matrix_that_is_none_ends_no_scheduler() -> None:
    for matrix in ([], 7, {"parameters": 7}, {"parameters": [{}]}, {"parameters": [{"name": 1, "values": [2, None]}]}):
        source = {
            "apiVersion": API_VERSION,
            "kind": "RobotApp",
            "metadata": {"name": "teleop", "namespace": "default"},
            "spec": {"components": [component()], "matrix": matrix},
        }
        with pytest.raises(QuestionError):
            tried_app(source, [], profiles=[SCHEDULER_NAME])
