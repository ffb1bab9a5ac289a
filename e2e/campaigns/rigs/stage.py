"""A small stage for live scheduling tests: nodes, pods, conditions, events, all by polling with a deadline."""

import secrets
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from tests.support.apiobjects import ROS

from robotapp_api.model.names import API_VERSION, SCHEDULER_NAME, Label
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import SimulatedNode
from robotapp_testbed.machines.topology import apply, remove

Json = dict[str, Any]
IMAGE = "registry.invalid/main:1"
ROBOTAPPS = f"/apis/{API_VERSION}/namespaces/{{}}/robotapps"
CLAIMS = f"/apis/{API_VERSION}/robotclaims"
DEADLINE_S = 60.0
"""For a machine that is slow and busy. A pod nobody wakes is tried again after five minutes: no test passes by that."""


def container(requests: Mapping[str, str] | None = None, **fields: Any) -> Json:
    return {"name": "main", "image": IMAGE, "resources": {"requests": dict(requests or {})}, **fields}


def pod(
    name: str,
    *,
    scheduler: str = SCHEDULER_NAME,
    requests: Mapping[str, str] | None = None,
    annotations: Mapping[str, str] | None = None,
    labels: Mapping[str, str] | None = None,
    env: Mapping[str, str] | None = None,
    **spec: Any,
) -> Json:
    """A pod that asks for little."""
    variables = [{"name": key, "value": value} for key, value in (env or {}).items()]
    return {
        "metadata": {"name": name, "annotations": dict(annotations or {}), "labels": dict(labels or {})},
        "spec": {
            "schedulerName": scheduler,
            "terminationGracePeriodSeconds": 0,
            "containers": [container(requests, env=variables)],
            **spec,
        },
    }


def deployment(app: Json, component: str, *, replicas: int = 1, instance: str = "", **pod_spec: Any) -> Json:
    """A child of a stored RobotApp as the operator would write it, without a domain."""
    meta = app["metadata"]
    labels = {
        str(Label.APP): meta["name"],
        str(Label.APP_UID): meta["uid"],
        str(Label.COMPONENT): component,
        str(Label.INSTANCE): instance,
    }
    owner = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "name": meta["name"],
        "uid": meta["uid"],
        "controller": True,
    }
    spec = {"schedulerName": SCHEDULER_NAME, "containers": [container()], **pod_spec}
    return {
        "metadata": {"name": f"{meta['name']}-{component}", "labels": labels, "ownerReferences": [owner]},
        "spec": {
            "replicas": replicas,
            "strategy": {"type": "Recreate"},
            "selector": {"matchLabels": {str(Label.APP): meta["name"], str(Label.COMPONENT): component}},
            "template": {"metadata": {"labels": labels}, "spec": spec},
        },
    }


class Stage:
    """One namespace on one control plane."""

    def __init__(self, cp: ControlPlane, namespace: str) -> None:
        self.cp = cp
        self.namespace = namespace
        self.pods_path = f"/api/v1/namespaces/{namespace}/pods"

    def create_pod(self, body: Json) -> Json:
        created: Json = self.cp.api.create(self.pods_path, body)
        return created

    def pod(self, name: str) -> Json:
        found: Json = self.cp.api.get(f"{self.pods_path}/{name}")
        return found

    def pods(self, **labels: str) -> list[Json]:
        selector = ",".join(f"{key}={value}" for key, value in labels.items())
        items: list[Json] = self.cp.api.get(f"{self.pods_path}?labelSelector={selector}")["items"]
        return items

    def delete_pod(self, name: str) -> None:
        self.cp.api.delete(f"{self.pods_path}/{name}?gracePeriodSeconds=0")

    def node_of(self, name: str) -> str:
        return str(self.pod(name)["spec"].get("nodeName", ""))

    def wait_bound(self, name: str, *, timeout_s: float = DEADLINE_S) -> str:
        """The node the pod was bound to."""
        return self.wait(
            lambda: self.node_of(name), what=lambda: f"{name} is not bound: {self.refusal(name)}", timeout_s=timeout_s
        )

    def refusal(self, name: str) -> Json:
        """The PodScheduled=False condition, or nothing."""
        conditions = self.pod(name)["status"].get("conditions", ())
        return next((each for each in conditions if each["type"] == "PodScheduled" and each["status"] == "False"), {})

    def wait_refused(self, name: str, *, reason: str, saying: str = "") -> str:
        """The message of the condition, once it has this reason and these words.

        The first message may be of a moment when the scheduler did not know all that was created before the pod: every
        kind has a watch of its own.
        """

        def found() -> str:
            condition = self.refusal(name)
            told = str(condition.get("message", ""))
            return told if condition.get("reason") == reason and saying in told else ""

        return self.wait(found, what=lambda: f"{name} has no {reason} {saying!r}: {self.refusal(name)}")

    def wait_known(self, *nodes: str, scheduler: str = SCHEDULER_NAME) -> None:
        """Return when the scheduler knows these nodes as they are now: it has bound a pod to each."""
        for node in nodes:
            name = f"known-{secrets.token_hex(3)}"
            self.create_pod(pod(name, scheduler=scheduler, nodeSelector={"kubernetes.io/hostname": node}))
            self.wait_bound(name)
            self.delete_pod(name)

    def events(self, name: str) -> list[Json]:
        path = f"/apis/events.k8s.io/v1/namespaces/{self.namespace}/events"
        items = self.cp.api.get(path)["items"]
        return [event for event in items if event["regarding"].get("name") == name]

    def wait_event(self, name: str, *, reason: str) -> Json:
        return self.wait(
            lambda: next((event for event in self.events(name) if event["reason"] == reason), None),
            what=lambda: f"no {reason} among {[event['reason'] for event in self.events(name)]}",
        )

    def create_app(self, name: str, components: list[Json], **spec: Any) -> Json:
        """A RobotApp whose generation an operator has acted on."""
        path = ROBOTAPPS.format(self.namespace)
        body = {
            "apiVersion": API_VERSION,
            "kind": "RobotApp",
            "metadata": {"name": name},
            "spec": {"ros": ROS, "components": components, **spec},
        }
        stored: Json = self.cp.api.create(path, body)
        self.cp.api.patch(f"{path}/{name}/status", {"status": {"observedGeneration": stored["metadata"]["generation"]}})
        return stored

    def create_deployment(self, body: Json) -> Json:
        created: Json = self.cp.api.create(f"/apis/apps/v1/namespaces/{self.namespace}/deployments", body)
        return created

    @staticmethod
    def wait(found: Callable[[], Any], *, what: Callable[[], str], timeout_s: float = DEADLINE_S) -> Any:
        """Poll until `found` answers something true; AssertionError with `what` at the deadline."""
        deadline = time.monotonic() + timeout_s
        while True:
            answer = found()
            if answer:
                return answer
            assert time.monotonic() < deadline, what()
            time.sleep(0.02)


@contextmanager
def nodes(cp: ControlPlane, *wanted: SimulatedNode) -> Iterator[None]:
    """The only nodes while one test runs, so that texts and choices are exact: every module removes its own."""
    apply(cp, wanted)
    try:
        yield
    finally:
        remove(cp, wanted)
