"""What a component asks of its pod beside its own container: core's names, core's schema."""

from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints, WithJsonSchema

from robotapp_api.model.app.robots import LABEL_KEY
from robotapp_api.model.base import Model
from robotapp_api.model.markers import Core, Rule
from robotapp_api.model.packed import PackedList, PackedMap
from robotapp_api.model.patterns import LABEL_VALUE_OF_ROBOT

JsonList = tuple[dict[str, Any], ...]

_FREE_KEYS = (
    Rule(
        rule=f"self.all(key, key.matches('{LABEL_KEY}'))",
        message="a key is no label or annotation key; write for example example.com/team",
    ),
    Rule(
        rule="self.all(key, !key.matches('^([^/]*[.])?robotics[.]io/') && !key.startsWith('app.kubernetes.io/'))",
        message="keys of robotics.io and app.kubernetes.io/ belong to the operator; write a key of your own, for example example.com/team",
        expression="'%s: keys of robotics.io and app.kubernetes.io/ belong to the operator; write a key of your own, for example example.com/team'.format([self.filter(key, key.matches('^([^/]*[.])?robotics[.]io/') || key.startsWith('app.kubernetes.io/'))[0]])",
        reason="FieldValueForbidden",
    ),
)
LabelValue = Annotated[str, StringConstraints(max_length=63, pattern=LABEL_VALUE_OF_ROBOT)]
_OBJECTS: dict[str, Any] = {
    "type": "array",
    "maxItems": 16,
    "items": {"type": "object", "x-kubernetes-preserve-unknown-fields": True},
}


def _refused(field: str, instead: str, *, empty: str) -> Rule:
    """A pod field that has no place in an app. It stands in the schema so that the refusal can name what to write."""
    return Rule(
        rule=empty,
        message=f"{field} cannot be set in the template; {instead}",
        reason="FieldValueForbidden",
    )


class TemplateMetadata(Model):
    """Labels and annotations of the component's pods, beside the operator's own."""

    labels: Annotated[dict[str, LabelValue], Field(max_length=32), *_FREE_KEYS] = Field(default_factory=dict)
    """Labels for selectors of your own, such as those of a NetworkPolicy or a PodMonitor. $(ROBOTAPP_ROBOT) and
    $(ROBOTAPP_INSTANCE) in a value stand for the names of robot and instance."""
    annotations: Annotated[
        dict[str, Annotated[str, StringConstraints(max_length=4096)]], Field(max_length=32), *_FREE_KEYS
    ] = Field(default_factory=dict)
    """Annotations for other programs, such as prometheus.io/scrape."""


class TemplateSpec(Model):
    """Fields of the pod with core's names and meaning."""

    volumes: Annotated[PackedList, Core("PodSpec", "volumes")] = PackedList()
    """Volumes of the pod: configMap, secret, emptyDir, persistentVolumeClaim, projected, downwardAPI, nfs, csi, or hostPath,
    which takes the verb use on robotapps/hostpath."""
    image_pull_secrets: Annotated[PackedList, Core("PodSpec", "imagePullSecrets")] = PackedList()
    """Secrets of this namespace that let the node pull the image."""
    init_containers: Annotated[PackedList, Core("PodSpec", "initContainers")] = PackedList()
    """Containers that run before the component, and with restartPolicy: Always beside it. They get the variables of ROS as the
    component does."""
    containers: Annotated[PackedList, Core("PodSpec", "containers")] = PackedList()
    """Containers that run beside the component in its pod, with the variables of ROS as the component has them."""
    tolerations: Annotated[PackedList, Core("PodSpec", "tolerations")] = PackedList()
    """Node taints the component puts up with."""
    node_selector: Annotated[dict[str, str], Core("PodSpec", "nodeSelector")] = Field(default_factory=dict)
    """Labels the node must have, beside what runsOn and requires ask for."""
    priority_class_name: Annotated[str, Core("PodSpec", "priorityClassName")] | None = None
    """PriorityClass of the pod; it comes before qosClass in the scheduler's queue."""
    service_account_name: Annotated[str, Core("PodSpec", "serviceAccountName")] | None = None
    """ServiceAccount of this namespace the pod runs as. Its token is mounted, except that of `default`, which is also what a
    pod without this field runs as: name an account of its own for a component that talks to the API server."""
    security_context: Annotated[PackedMap, Core("PodSpec", "securityContext")] | None = None
    """Security options of the pod; those of the container stand beside its image."""
    runtime_class_name: Annotated[str, Core("PodSpec", "runtimeClassName")] | None = None
    """RuntimeClass the pod runs with."""
    termination_grace_period_seconds: Annotated[int, Core("PodSpec", "terminationGracePeriodSeconds")] | None = None
    """Seconds between the request to stop and the kill."""
    host_network: Annotated[bool, Core("PodSpec", "hostNetwork")] | None = None
    """The pod has the network and the address of its node. Takes the verb use on robotapps/hostnetwork."""
    host_ipc: Annotated[Annotated[bool, Core("PodSpec", "hostIPC")] | None, Field(alias="hostIPC")] = None
    """The pod has the shared memory of its node. Takes the verb use on robotapps/hostipc."""
    host_pid: Annotated[Annotated[bool, Core("PodSpec", "hostPID")] | None, Field(alias="hostPID")] = None
    """The pod sees the processes of its node. Takes the verb use on robotapps/hostpid."""
    share_process_namespace: Annotated[bool, Core("PodSpec", "shareProcessNamespace")] | None = None
    """Containers of the pod see each other's processes."""
    host_aliases: Annotated[PackedList, Core("PodSpec", "hostAliases")] = PackedList()
    """Lines of the pod's /etc/hosts: names of machines that no DNS server has."""
    hostname: Annotated[str, Core("PodSpec", "hostname")] | None = None
    """Host name inside the pod; absent means the pod's own name."""
    dns_config: Annotated[PackedMap, Core("PodSpec", "dnsConfig")] | None = None
    """DNS servers, search domains and options beside those of the cluster."""
    node_name: Annotated[
        Annotated[str, StringConstraints(max_length=253)] | None,
        _refused("nodeName", "write nodeSelector, or robots and runsOn of the component", empty="self == ''"),
    ] = None
    """Refused: a pod with a node never meets the scheduler. Write nodeSelector, or robots and runsOn."""
    scheduler_name: Annotated[
        Annotated[str, StringConstraints(max_length=253)] | None,
        _refused("schedulerName", "write spec.schedulerName, which is for all components", empty="self == ''"),
    ] = None
    """Refused: write spec.schedulerName, which is for all components."""
    restart_policy: Annotated[
        Literal["Always", "OnFailure", "Never"] | None,
        _refused(
            "restartPolicy",
            "leave it out, or write job: {} in the component for a program that ends",
            empty="self == 'Always'",
        ),
    ] = None
    """Refused unless Always: components always restart."""
    resource_claims: Annotated[
        JsonList,
        WithJsonSchema(_OBJECTS),
        _refused("resourceClaims", "write devices of the component", empty="size(self) == 0"),
    ] = ()
    """Refused: write devices of the component."""
    scheduling_gates: Annotated[
        JsonList,
        WithJsonSchema(_OBJECTS),
        _refused("schedulingGates", "write spec.suspend: true to hold an app back", empty="size(self) == 0"),
    ] = ()
    """Refused: write spec.suspend: true to hold an app back."""
    ephemeral_containers: Annotated[
        JsonList,
        WithJsonSchema(_OBJECTS),
        _refused(
            "ephemeralContainers", "leave it out: kubectl debug adds them to a running pod", empty="size(self) == 0"
        ),
    ] = ()
    """Refused: kubectl debug adds them to a running pod."""


class Template(Model):
    """The component's pod."""

    metadata: TemplateMetadata = Field(default_factory=TemplateMetadata)
    """Labels and annotations of the pods."""
    spec: TemplateSpec = Field(default_factory=TemplateSpec)
    """Fields of the pod."""


class HelperTemplateSpec(Model):
    """Fields of a helper's pod with core's names and meaning; what they leave out follows the components."""

    image_pull_secrets: Annotated[PackedList, Core("PodSpec", "imagePullSecrets")] = PackedList()
    """Secrets of this namespace that let the node pull the image, beside those of the components."""
    tolerations: Annotated[PackedList, Core("PodSpec", "tolerations")] = PackedList()
    """Node taints the pod puts up with, beside those that every component does."""
    node_selector: Annotated[dict[str, str], Core("PodSpec", "nodeSelector")] = Field(default_factory=dict)
    """Labels the node must have, beside those that every component asks for."""
    priority_class_name: Annotated[str, Core("PodSpec", "priorityClassName")] | None = None
    """PriorityClass of the pod; absent means that of the first component that has one."""
    service_account_name: Annotated[str, Core("PodSpec", "serviceAccountName")] | None = None
    """ServiceAccount the pod runs as, without its token; absent means the one that all components share."""
    security_context: Annotated[PackedMap, Core("PodSpec", "securityContext")] | None = None
    """Security options of the pod, such as runAsUser; absent means what all components share."""
    runtime_class_name: Annotated[str, Core("PodSpec", "runtimeClassName")] | None = None
    """RuntimeClass the pod runs with."""


class HelperTemplate(Model):
    """The pod of a discovery server, router or master."""

    metadata: TemplateMetadata = Field(default_factory=TemplateMetadata)
    """Labels and annotations of the pod, beside those that all components have alike."""
    spec: HelperTemplateSpec = Field(default_factory=HelperTemplateSpec)
    """Fields of the pod."""


class HelperContainer(Model):
    """The container of a discovery server, router or master: fields with core's names."""

    image_pull_policy: (
        Annotated[Literal["Always", "IfNotPresent", "Never"], Core("Container", "imagePullPolicy")] | None
    ) = None
    """When the image is pulled: Always, IfNotPresent or Never."""
    resources: Annotated[PackedMap, Core("Container", "resources")] = PackedMap()
    """CPU and memory the container asks for and may use at most; absent means small ones that the operator chooses."""
    security_context: Annotated[PackedMap, Core("Container", "securityContext")] | None = None
    """Security options of the container in place of the operator's, which Pod Security `restricted` admits."""
    template: HelperTemplate | None = None
    """Everything else of the pod."""
