"""The chart as its tests see it: rendered objects, installations, everything that exists in a cluster."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product

CHART = Path(__file__).resolve().parents[3] / "helm" / "robotapp"
NAMESPACE = "robotapp-system"
OPERATOR = f"system:serviceaccount:{NAMESPACE}:robotapp-operator"
SCHEDULER = f"system:serviceaccount:{NAMESPACE}:robotapp-scheduler"
CRDS = [
    f"{plural}.robotics.io"
    for plural in ("robotapps", "robotappinstances", "robotclaims", "domainpools", "nodetelemetries")
]
NO_WORKLOADS = {"operator.enabled": "false", "scheduler.enabled": "false"}
REGISTRY = "registry.example"
NO_KEY = {"agent.keySecretName": "own"}
"""Else each rendering has another key of the agents' measurements."""
# They come and go by themselves, or are no stored objects.
_TRANSIENT = {
    "events",
    "events.events.k8s.io",
    "componentstatuses",
    "leases.coordination.k8s.io",
    "endpointslices.discovery.k8s.io",
}

Object = dict[str, Any]


def flags(values: Mapping[str, str]) -> list[str]:
    """Returns the options for these values, and for a registry, without which the chart renders no workload."""
    named_values = {"imageRegistry": REGISTRY, **values}
    return [part for key, value in named_values.items() for part in ("--set", f"{key}={value}")]


@dataclass(frozen=True, slots=True)
class Chart:
    """helm on one control plane."""

    plane: ControlPlane

    def render(self, values: Mapping[str, str] | None = None, *arguments: str) -> list[Object]:
        text = self.plane.helm(
            "template", "robotapp", str(CHART), "--namespace", NAMESPACE, *flags(values or {}), *arguments
        )
        return product.objects_of(text)

    def install(self, values: Mapping[str, str] | None = None) -> str:
        """Returns the notes, once the new kinds can be listed: a CRD deleted before that hangs in deletion for minutes."""
        given = flags(values or {})
        notes = self.plane.helm(
            "install", "robotapp", str(CHART), "--namespace", NAMESPACE, "--create-namespace", *given
        )
        self.plane.kubectl("get", ",".join(CRDS), "--all-namespaces")
        return notes

    def upgrade(self, values: Mapping[str, str] | None = None) -> str:
        return self.plane.helm("upgrade", "robotapp", str(CHART), "--namespace", NAMESPACE, *flags(values or {}))

    def uninstall(self) -> str:
        return self.plane.helm("uninstall", "robotapp", "--namespace", NAMESPACE, "--wait")


def of_kind(objects: list[Object], *kinds: str) -> list[Object]:
    return [item for item in objects if item["kind"] in kinds]


def named(objects: list[Object], kind: str, name: str) -> Object:
    return next(item for item in objects if item["kind"] == kind and item["metadata"]["name"] == name)


def rules(objects: list[Object]) -> Iterator[tuple[str, Object]]:
    for role in of_kind(objects, "Role", "ClusterRole"):
        for rule in role["rules"]:
            if "resources" in rule:  # the others are about paths such as /configz
                yield f"{role['kind']}/{role['metadata']['name']}", rule


def everything(plane: ControlPlane) -> set[str]:
    """kind/namespace/name of every object of every API resource the server offers."""
    resources = set(plane.kubectl("api-resources", "--verbs=list", "--output=name").split()) - _TRANSIENT
    template = '{range .items[*]}{.kind}/{.metadata.namespace}/{.metadata.name}{"\\n"}{end}'
    listed = plane.kubectl("get", ",".join(sorted(resources)), "--all-namespaces", f"--output=jsonpath={template}")
    return {*listed.split(), *(f"resource/{name}" for name in resources)}


def pod_spec(objects: list[Object], component: str) -> Any:
    """The pod of a component's Deployment."""
    return named(objects, "Deployment", f"robotapp-{component}")["spec"]["template"]["spec"]
