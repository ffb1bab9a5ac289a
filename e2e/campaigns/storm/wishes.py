"""What the people of a storm ask for, and what its forgers write."""

import json
import random
from typing import Any, Final

from campaigns.rigs.simulated_site import Object, plain_app
from robotapp_api.model.names import Annotation, Label

KINDS: Final = ("app", "app", "device app", *("pod",) * 3, *("device pod",) * 2, *("devices pod",) * 2)
"""Equally often each. An app costs the API server ten times what a pod costs, and a pod is granted up to three things."""
DEVICES: Final = {"pod": 0, "device pod": 1, "devices pod": 2}
"""That a bare pod wants beside its domain, all on one robot."""


def is_pod(kind: str) -> bool:
    return kind.endswith("pod")


def wish(kind: str, name: str) -> Object:
    """An app or a bare pod that wants a domain, and perhaps one of the devices."""
    if is_pod(kind):
        return _pod(name, devices=DEVICES[kind])
    app = plain_app(name, parts=("only",))
    if kind.startswith("device"):
        app["spec"]["components"][0]["devices"] = [{"name": "bus", "type": "can"}]
    return app


def _pod(name: str, *, devices: int) -> Object:
    annotations = {str(Annotation.DDS_DOMAIN): "auto"}
    if devices:
        annotations[str(Annotation.AFFINITY)] = json.dumps({"hardware_requirements": [{"type": "can"}] * devices})
    spec = {
        "schedulerName": "ros-aware-scheduler",
        "containers": [{"name": "c", "image": "x"}],
        "terminationGracePeriodSeconds": 0,
    }
    return {"metadata": {"name": name, "annotations": annotations}, "spec": spec}


def forgery(chance: random.Random, *, app: Object, instance: str = "") -> tuple[str, Object]:
    """(path of its kind, object) of something of another tenant that says it belongs to `app` and stands on some domain."""
    metadata = app["metadata"]
    labels = {
        Label.APP_UID.value: metadata["uid"],
        Label.INSTANCE.value: instance,
        Label.APP.value: metadata["name"],
        "forged": "yes",
    }
    number = str(chance.randint(1, 101))
    container = {"name": "c", "image": "x", "env": [{"name": "ROS_DOMAIN_ID", "value": number}]}
    if chance.random() < 0.3:
        return "pods", _forged_pod(labels, container, claim=f"dds.default.c.{number}")
    owned = chance.random() < 0.5
    return "deployments", _deployment(labels, container, owner=metadata if owned else None)


def _forged_pod(labels: dict[str, str], container: dict[str, Any], *, claim: str) -> Object:
    return {
        "metadata": {
            "generateName": "forged-",
            "labels": labels,
            "annotations": {str(Annotation.DOMAIN_CLAIM): claim},
        },
        "spec": {"schedulerName": "ros-aware-scheduler", "containers": [container]},
    }


def _deployment(labels: dict[str, str], container: dict[str, Any], *, owner: dict[str, Any] | None) -> Object:
    metadata: Object = {"generateName": "forged-", "labels": labels}
    if owner is not None:
        reference = {
            "apiVersion": "robotics.io/v1alpha1",
            "kind": "RobotApp",
            "name": owner["name"],
            "uid": owner["uid"],
        }
        metadata["ownerReferences"] = [reference | {"controller": True}]
    template = {"metadata": {"labels": labels}, "spec": {"containers": [container]}}
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": metadata,
        "spec": {"replicas": 0, "selector": {"matchLabels": {"forged": "yes"}}, "template": template},
    }
