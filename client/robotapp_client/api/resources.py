"""The API resources we talk to and their URL paths."""

from dataclasses import dataclass, field
from typing import Final

from robotapp_api.model.names import GROUP, VERSION


@dataclass(frozen=True, slots=True)
class Resource:
    """One resource of the API server; `group` is empty for the core group."""

    group: str
    version: str
    plural: str
    kind: str
    namespaced: bool
    api_version: str = field(init=False, repr=False, compare=False)
    root: str = field(init=False, repr=False, compare=False)
    """Path of the group and version, without a trailing slash."""

    def __post_init__(self) -> None:
        version = f"{self.group}/{self.version}" if self.group else self.version
        object.__setattr__(self, "api_version", version)
        object.__setattr__(self, "root", f"/apis/{version}" if self.group else f"/api/{version}")

    def path(self, namespace: str | None = None, name: str | None = None, subresource: str = "") -> str:
        """URL path of a collection, an object or its subresource.

        A namespaced resource without `namespace` is the collection over all namespaces; it has no objects by name.
        """
        if namespace and name and self.namespaced:  # nearly always
            path = f"{self.root}/namespaces/{namespace}/{self.plural}/{name}"
            return f"{path}/{subresource}" if subresource else path
        if namespace and name is None and self.namespaced and not subresource:
            return f"{self.root}/namespaces/{namespace}/{self.plural}"
        if self.namespaced:
            if name is not None and not namespace:
                raise ValueError(f"{self.plural} {name!r} needs a namespace")
            scope = f"/namespaces/{namespace}" if namespace else ""
        else:
            scope = ""
        path = f"{self.root}{scope}/{self.plural}"
        if name is not None:
            if not name:
                raise ValueError(f"a name of {self.plural} must not be empty: that would address the whole collection")
            path += f"/{name}"
        return f"{path}/{subresource}" if subresource else path


PODS: Final = Resource("", "v1", "pods", "Pod", namespaced=True)
NODES: Final = Resource("", "v1", "nodes", "Node", namespaced=False)
SERVICES: Final = Resource("", "v1", "services", "Service", namespaced=True)
CONFIGMAPS: Final = Resource("", "v1", "configmaps", "ConfigMap", namespaced=True)
NAMESPACES: Final = Resource("", "v1", "namespaces", "Namespace", namespaced=False)
DEPLOYMENTS: Final = Resource("apps", "v1", "deployments", "Deployment", namespaced=True)
REPLICATIONCONTROLLERS: Final = Resource("", "v1", "replicationcontrollers", "ReplicationController", namespaced=True)
STATEFULSETS: Final = Resource("apps", "v1", "statefulsets", "StatefulSet", namespaced=True)
REPLICASETS: Final = Resource("apps", "v1", "replicasets", "ReplicaSet", namespaced=True)
JOBS: Final = Resource("batch", "v1", "jobs", "Job", namespaced=True)
PODDISRUPTIONBUDGETS: Final = Resource("policy", "v1", "poddisruptionbudgets", "PodDisruptionBudget", namespaced=True)
SECRETS: Final = Resource("", "v1", "secrets", "Secret", namespaced=True)
SELF_ACCESS_REVIEWS: Final = Resource(
    "authorization.k8s.io", "v1", "selfsubjectaccessreviews", "SelfSubjectAccessReview", namespaced=False
)
EVENTS: Final = Resource("events.k8s.io", "v1", "events", "Event", namespaced=True)
ENDPOINTSLICES: Final = Resource("discovery.k8s.io", "v1", "endpointslices", "EndpointSlice", namespaced=True)
LEASES: Final = Resource("coordination.k8s.io", "v1", "leases", "Lease", namespaced=True)
PERSISTENTVOLUMECLAIMS: Final = Resource("", "v1", "persistentvolumeclaims", "PersistentVolumeClaim", namespaced=True)
PERSISTENTVOLUMES: Final = Resource("", "v1", "persistentvolumes", "PersistentVolume", namespaced=False)
STORAGECLASSES: Final = Resource("storage.k8s.io", "v1", "storageclasses", "StorageClass", namespaced=False)
CSINODES: Final = Resource("storage.k8s.io", "v1", "csinodes", "CSINode", namespaced=False)
CSIDRIVERS: Final = Resource("storage.k8s.io", "v1", "csidrivers", "CSIDriver", namespaced=False)
CSISTORAGECAPACITIES: Final = Resource(
    "storage.k8s.io", "v1", "csistoragecapacities", "CSIStorageCapacity", namespaced=True
)
VOLUMEATTACHMENTS: Final = Resource("storage.k8s.io", "v1", "volumeattachments", "VolumeAttachment", namespaced=False)
RESOURCECLAIMS: Final = Resource("resource.k8s.io", "v1", "resourceclaims", "ResourceClaim", namespaced=True)
RESOURCESLICES: Final = Resource("resource.k8s.io", "v1", "resourceslices", "ResourceSlice", namespaced=False)
DEVICECLASSES: Final = Resource("resource.k8s.io", "v1", "deviceclasses", "DeviceClass", namespaced=False)
DEVICETAINTRULES: Final = Resource("resource.k8s.io", "v1", "devicetaintrules", "DeviceTaintRule", namespaced=False)
COSCHEDULING_PODGROUPS: Final = Resource("scheduling.x-k8s.io", "v1alpha1", "podgroups", "PodGroup", namespaced=True)
WORKLOAD_PODGROUPS: Final = Resource("scheduling.k8s.io", "v1beta1", "podgroups", "PodGroup", namespaced=True)
ROBOTAPPS: Final = Resource(GROUP, VERSION, "robotapps", "RobotApp", namespaced=True)
ROBOTAPPINSTANCES: Final = Resource(GROUP, VERSION, "robotappinstances", "RobotAppInstance", namespaced=True)
ROBOTCLAIMS: Final = Resource(GROUP, VERSION, "robotclaims", "RobotClaim", namespaced=False)
DOMAINPOOLS: Final = Resource(GROUP, VERSION, "domainpools", "DomainPool", namespaced=False)
NODETELEMETRIES: Final = Resource(GROUP, VERSION, "nodetelemetries", "NodeTelemetry", namespaced=False)
