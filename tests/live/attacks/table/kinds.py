"""The kinds of objects that attacks are about, and honest ones of them."""

from typing import Any, Final

from tests.live.attacks.table.attack import OURS, Json, Kind

_RBAC: Final = "/apis/rbac.authorization.k8s.io/v1"
_ADMISSION: Final = "/apis/admissionregistration.k8s.io/v1"

ROBOTAPP: Final = Kind(OURS, "RobotApp", "robotapps")
INSTANCE: Final = Kind(OURS, "RobotAppInstance", "robotappinstances")
CLAIM: Final = Kind(OURS, "RobotClaim", "robotclaims", namespaced=False)
POOL: Final = Kind(OURS, "DomainPool", "domainpools", namespaced=False)
TELEMETRY: Final = Kind(OURS, "NodeTelemetry", "nodetelemetries", namespaced=False)
POD: Final = Kind("/api/v1", "Pod", "pods")
NAMESPACE: Final = Kind("/api/v1", "Namespace", "namespaces", namespaced=False)
NODE: Final = Kind("/api/v1", "Node", "nodes", namespaced=False)
SECRET: Final = Kind("/api/v1", "Secret", "secrets")
CONFIGMAP: Final = Kind("/api/v1", "ConfigMap", "configmaps")
DEPLOYMENT: Final = Kind("/apis/apps/v1", "Deployment", "deployments")
DAEMONSET: Final = Kind("/apis/apps/v1", "DaemonSet", "daemonsets")
REVISION: Final = Kind("/apis/apps/v1", "ControllerRevision", "controllerrevisions")
LEASE: Final = Kind("/apis/coordination.k8s.io/v1", "Lease", "leases")
PRIORITY: Final = Kind("/apis/scheduling.k8s.io/v1", "PriorityClass", "priorityclasses", namespaced=False)
ROLE: Final = Kind(_RBAC, "Role", "roles")
ROLE_BINDING: Final = Kind(_RBAC, "RoleBinding", "rolebindings")
CLUSTER_ROLE: Final = Kind(_RBAC, "ClusterRole", "clusterroles", namespaced=False)
CLUSTER_BINDING: Final = Kind(_RBAC, "ClusterRoleBinding", "clusterrolebindings", namespaced=False)
POLICY: Final = Kind(_ADMISSION, "ValidatingAdmissionPolicy", "validatingadmissionpolicies", namespaced=False)
POLICY_BINDING: Final = Kind(
    _ADMISSION, "ValidatingAdmissionPolicyBinding", "validatingadmissionpolicybindings", namespaced=False
)
_DEVICES: Final = "/apis/resource.k8s.io/v1"
RESOURCE_SLICE: Final = Kind(_DEVICES, "ResourceSlice", "resourceslices", namespaced=False)
RESOURCE_CLAIM: Final = Kind(_DEVICES, "ResourceClaim", "resourceclaims")
CLAIM_TEMPLATE: Final = Kind(_DEVICES, "ResourceClaimTemplate", "resourceclaimtemplates")
DEVICE_CLASS: Final = Kind(_DEVICES, "DeviceClass", "deviceclasses", namespaced=False)
TAINT_RULE: Final = Kind(_DEVICES, "DeviceTaintRule", "devicetaintrules", namespaced=False)
CRD: Final = Kind("/apis/apiextensions.k8s.io/v1", "CustomResourceDefinition", "customresourcedefinitions", False)


def app(**component: Any) -> Json:
    """A RobotApp of one component."""
    return apps({"name": "driver", "image": "ros:humble", **component})


def apps(*components: Json, **spec: Any) -> Json:
    return {"spec": {"ros": {"distro": "humble"}, "components": list(components), **spec}}


def templated(**pod: Any) -> Json:
    """A RobotApp whose component has these pod fields."""
    return app(template={"spec": pod})


def pod(**metadata: Any) -> Json:
    container = {"name": "main", "image": "ros:humble"}
    return {"metadata": metadata, "spec": {"containers": [container], "schedulerName": "nobody"}}


def domain_claim(number: int, **holder: Any) -> Json:
    """Of the shipped pool; the name goes with it."""
    who = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "namespace": "own", "name": "teleop", "uid": "u-1"}
    return {"spec": {"domain": {"pool": "default", "scope": "Cluster", "id": number}, "holder": who | holder}}
