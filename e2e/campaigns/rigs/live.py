"""What live tests of the operator do: RobotApps as a user, and a scheduler's work by hand."""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final, TypeVar

from tests.support.apiobjects import ROS

from campaigns.common.background import Background
from robotapp_api.model.names import API_VERSION, Label, Phase
from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.processes.process import growing_pauses

APPS: Final = "/apis/robotics.io/v1alpha1/namespaces/{}/robotapps"
INSTANCES: Final = "/apis/robotics.io/v1alpha1/namespaces/{}/robotappinstances"
CLAIMS: Final = "/apis/robotics.io/v1alpha1/robotclaims"
POOLS: Final = "/apis/robotics.io/v1alpha1/domainpools"


T = TypeVar("T")

PATIENCE_S: Final = 60.0
"""For what takes a second or two on an idle machine: a deadline costs nothing while things go well."""


def eventually(look: Callable[[], T], *, timeout_s: float = PATIENCE_S, poll_s: float = 0.1, what: object = "") -> T:
    """Returns the first true value of `look`; an error with the last one after `timeout_s`. Looks are at most `poll_s` apart."""
    deadline = time.monotonic() + timeout_s
    pauses = growing_pauses(poll_s)
    while not (value := look()):
        if time.monotonic() > deadline:
            raise AssertionError(f"not within {timeout_s} s: {what() if callable(what) else what or value!r}")
        time.sleep(next(pauses))
    return value


def instances_of(cp: ControlPlane, app: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The RobotAppInstances of a stored RobotApp, by the name of their instance."""
    meta = app["metadata"]
    path = f"{INSTANCES.format(meta['namespace'])}?labelSelector={Label.APP_UID}%3D{meta['uid']}"
    items: list[dict[str, Any]] = cp.api.get(path)["items"]
    return sorted(items, key=lambda item: str(item["spec"].get("instance", "")))


class Tenant:
    """A user's view of one namespace."""

    def __init__(self, cp: ControlPlane, namespace: str) -> None:
        self.cp = cp
        self.namespace = namespace
        self._apps = APPS.format(namespace)

    def apply(self, name: str, *components: dict[str, Any], **spec: Any) -> dict[str, Any]:
        """Create a RobotApp; components default to operator and driver."""
        parts = list(components) or [part("operator"), part("driver")]
        body = {
            "apiVersion": API_VERSION,
            "kind": "RobotApp",
            "metadata": {"name": name, "namespace": self.namespace},
            "spec": {"ros": ROS, "components": parts, **spec},
        }
        created: dict[str, Any] = self.cp.api.create(self._apps, body)
        return created

    def edit(self, name: str, **spec: Any) -> None:
        self.cp.api.patch(f"{self._apps}/{name}", {"spec": spec})

    def delete(self, name: str) -> None:
        self.cp.api.delete(f"{self._apps}/{name}")

    def app(self, name: str) -> dict[str, Any]:
        found: dict[str, Any] = self.cp.api.get(f"{self._apps}/{name}")
        return found

    def apps(self) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = self.cp.api.get(self._apps)["items"]
        return items

    def instances(self, name: str) -> list[dict[str, Any]]:
        """The RobotAppInstances of an app as it is now."""
        return instances_of(self.cp, self.app(name))

    def wait_instances(self, name: str, count: int = 1) -> list[dict[str, Any]]:
        """Wait until an app has that many RobotAppInstances and each says Running; they follow the app's own status."""

        def look() -> list[dict[str, Any]]:
            found = self.instances(name)
            runs = [item for item in found if item["status"]["phase"] == Phase.RUNNING]
            return found if len(found) == len(runs) == count else []

        return eventually(look, what=lambda: json.dumps(self.instances(name)))

    def event_reasons(self, name: str) -> set[str]:
        """Of the events about objects of this name."""
        path = f"/apis/events.k8s.io/v1/namespaces/{self.namespace}/events"
        return {item["reason"] for item in self.cp.api.get(path)["items"] if item["regarding"].get("name") == name}

    def condition(self, name: str, kind: str) -> dict[str, Any]:
        found = self.app(name)
        (condition,) = [item for item in found["status"]["conditions"] if item["type"] == kind]
        current = condition.get("observedGeneration") == found["metadata"]["generation"]
        result: dict[str, Any] = condition if current else condition | {"status": "Unknown", "reason": "Stale"}
        return result

    def wait(
        self, name: str, kind: str, status: str, *, reason: str = "", timeout_s: float = PATIENCE_S
    ) -> dict[str, Any]:
        """Wait until a condition of the newest generation has this status (and reason)."""

        def look() -> dict[str, Any] | None:
            found = self.condition(name, kind)
            return found if found["status"] == status and reason in ("", found["reason"]) else None

        return eventually(look, timeout_s=timeout_s, what=lambda: json.dumps(self.app(name).get("status"))) or {}

    def wait_ready(self, name: str, *, timeout_s: float = PATIENCE_S) -> dict[str, Any]:
        self.wait(name, "Ready", "True", timeout_s=timeout_s)
        return self.app(name)

    def listed(self, kind: str) -> list[dict[str, Any]]:
        """Objects of this namespace by `group/plural` (apps/deployments) or core plural (pods)."""
        group, _, plural = kind.rpartition("/")
        root = f"/apis/{group}/v1" if group else "/api/v1"
        items: list[dict[str, Any]] = self.cp.api.get(f"{root}/namespaces/{self.namespace}/{plural}")["items"]
        return items

    def deployments(self, component: str = "") -> list[dict[str, Any]]:
        """Deployments of components, or of one component."""
        found = [(item, item["metadata"]["labels"].get(Label.COMPONENT)) for item in self.listed("apps/deployments")]
        return [item for item, name in found if name and component in ("", name)]

    def claims(self) -> list[dict[str, Any]]:
        """RobotClaims whose holder is in this namespace."""
        return [
            claim
            for claim in self.cp.api.get(CLAIMS)["items"]
            if claim["spec"]["holder"]["namespace"] == self.namespace
        ]

    def children(self) -> list[str]:
        """Kind and name of everything the operator made here."""
        found = [
            f"{kind}/{item['metadata']['name']}"
            for kind in ("apps/deployments", "apps/replicasets", "pods", "services", "configmaps")
            for item in self.listed(kind)
        ]
        return [name for name in found if not name.endswith("kube-root-ca.crt")]


def part(name: str, **fields: Any) -> dict[str, Any]:
    return {"name": name, "image": f"reg/{name}:1", **fields}


@contextmanager
def pool(
    cp: ControlPlane, name: str, *, ids: str = "1-101,215-232", quarantine_s: int = 1, **spec: Any
) -> Iterator[str]:
    """A DomainPool of the test's own, on a network of its own."""
    body = {
        "apiVersion": API_VERSION,
        "kind": "DomainPool",
        "metadata": {"name": name},
        "spec": {"scope": "Cluster", "network": name, "ids": ids, "quarantineSeconds": quarantine_s, **spec},
    }
    cp.api.create(POOLS, body)
    try:
        yield name
    finally:
        cp.api.delete(f"{POOLS}/{name}")


class HandBinder(Background):
    """Binds every pending pod of one namespace without gates to the first node that fits its required node affinity.

    A stand-in for a scheduler where the test is about the operator; it checks no claims.
    """

    def __init__(self, cp: ControlPlane, namespace: str) -> None:
        self._cp = cp
        self._pods = f"/api/v1/namespaces/{namespace}/pods"
        super().__init__("hand-binder")

    def _run(self) -> None:
        while not self._stop.wait(0.05):
            pending = self._cp.api.get(f"{self._pods}?fieldSelector=spec.nodeName%3D,status.phase%3DPending")["items"]
            waiting = [pod for pod in pending if not pod["spec"].get("schedulingGates")]
            if waiting:
                nodes = self._cp.api.get("/api/v1/nodes")["items"]
                for pod in waiting:
                    self._bind(pod, nodes)

    def _bind(self, pod: Mapping[str, Any], nodes: list[dict[str, Any]]) -> None:
        name = pod["metadata"]["name"]
        node = next((node["metadata"]["name"] for node in nodes if _fits(pod, node["metadata"])), None)
        if node is None:
            return
        target = {"apiVersion": "v1", "kind": "Node", "name": node}
        body = {"apiVersion": "v1", "kind": "Binding", "metadata": {"name": name}, "target": target}
        try:
            self._cp.api.create(f"{self._pods}/{name}/binding", body)
        except ApiStatusError as error:
            if error.status not in (404, 409):
                raise


def _fits(pod: Mapping[str, Any], node: Mapping[str, Any]) -> bool:
    labels, fields = node["labels"], {"metadata.name": node["name"]}
    affinity = pod["spec"].get("affinity", {}).get("nodeAffinity", {})
    required = affinity.get("requiredDuringSchedulingIgnoredDuringExecution")
    if not required:
        return Label.ROBOT not in labels
    return any(
        all(_holds(item, labels) for item in term.get("matchExpressions", ()))
        and all(_holds(item, fields) for item in term.get("matchFields", ()))
        for term in required["nodeSelectorTerms"]
    )


def _holds(item: Mapping[str, Any], labels: Mapping[str, str]) -> bool:
    present = item["key"] in labels
    match item["operator"]:
        case "In":
            return labels.get(item["key"]) in item["values"]
        case "Exists":
            return present
        case _:
            return not present
