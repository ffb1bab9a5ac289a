"""Components: the processes of an app. Each becomes one Deployment per instance.

Fields borrowed from PodSpec and Container stay plain JSON in Python; their schema is the vendored core schema.
"""

from typing import Annotated, Any, Literal

from pydantic import Field

from robotapp_api.model.base import Model
from robotapp_api.model.device import Device, Requirement
from robotapp_api.model.edge import Durability, Liveliness, Reliability
from robotapp_api.model.markers import Core, ListMap, ListSet, Rule
from robotapp_api.model.scalars import DnsLabel, DnsName, Duration, Image, TopicName

RunsOn = Literal["Robot", "Edge", "Cloud", "Any"]
QosClass = Literal["realtime", "sensor_data", "system_default", "best_effort"]
OnDisconnect = Literal["Keep", "Failover", "Stop"]
Json = dict[str, Any]
JsonList = tuple[Json, ...]
Words = tuple[str, ...]


class Params(Model):
    """ROS parameters file from a ConfigMap."""

    config_map: DnsName
    """ConfigMap of this namespace; its key params.yaml (or its only key) is passed with --ros-args --params-file."""
    per_robot: bool = False
    """Take the key <robot>.yaml of the instance's robot when there is one."""


class Policies(Model):
    """Policies of a component without edges of its own: the fields of the thesis, kept without loss."""

    latency_budget: Duration | None = None
    """Round-trip time allowed between the component and its peers."""
    deadline: Duration | None = None
    """Longest time between two messages of the component."""
    reliability: Reliability | None = None
    """DDS reliability of the component's topics. Says nothing about scheduling: that is qosClass."""
    durability: Durability | None = None
    """DDS durability of the component's topics."""
    liveliness: Liveliness | None = None
    """DDS liveliness of the component's topics."""
    queue_size: Annotated[int, Field(ge=0, le=100_000)] | None = None
    """ROS 1 queue size."""
    tcp_nodelay: bool | None = None
    """ROS 1 TCP_NODELAY: send small messages at once."""


class SharedData(Model):
    """Who works on the same data as the component and should sit near it."""

    with_: Annotated[tuple[DnsLabel, ...], ListSet(), Field(alias="with", max_length=16)] = ()
    """Components of this app."""
    peer_pods: Annotated[tuple[DnsName, ...], ListSet(), Field(max_length=16)] = ()
    """Pods or Deployments of this namespace that belong to no RobotApp."""
    claims: Annotated[tuple[DnsName, ...], ListSet(), Field(max_length=16)] = ()
    """PersistentVolumeClaims of this namespace."""


class Lifecycle(Model):
    """ROS 2 lifecycle of the component."""

    managed: bool = False
    """The component is a lifecycle node."""


class Ready(Model):
    """When the component counts as ready: exactly one kind of check."""

    RULES = (
        Rule(
            rule="[has(self.topic), has(self.lifecycle), has(self.exec), has(self.httpGet), has(self.tcpSocket)].exists_one(x, x)",
            message="write exactly one of topic, lifecycle, exec, httpGet, tcpSocket",
        ),
        Rule(
            rule="!has(self.minHz) || has(self.topic)",
            message="minHz is the rate of a topic; write topic too, or drop minHz",
            path=".minHz",
        ),
    )

    topic: TopicName | None = None
    """Topic on which messages must arrive."""
    min_hz: Annotated[float, Field(ge=0, le=100_000)] | None = None
    """Rate the topic must reach, in messages per second."""
    lifecycle: Literal["Active"] | None = None
    """Lifecycle state the node must have reached."""
    exec: Annotated[Json, Core("Probe", "exec")] | None = None
    """Command in the container that must end with 0."""
    http_get: Annotated[Json, Core("Probe", "httpGet")] | None = None
    """HTTP request that must be answered with a status from 200 to 399."""
    tcp_socket: Annotated[Json, Core("Probe", "tcpSocket")] | None = None
    """TCP port that must accept connections."""


Peers = Annotated[tuple[DnsLabel, ...], ListSet(), Field(max_length=8)]


class Component(Model):
    """One ROS process group with its image, needs and wishes."""

    RULES = (
        Rule(
            rule="!has(self.colocateWith) || !has(self.separateFrom) || !self.colocateWith.exists(n, n in self.separateFrom)",
            message="a component cannot be both in colocateWith and in separateFrom; remove it from one of them",
            expression="'component %s: %s is both in colocateWith and in separateFrom; remove it from one of them'.format([self.name, self.colocateWith.filter(n, n in self.separateFrom)[0]])",
            path=".separateFrom",
        ),
        Rule(
            rule="(!has(self.colocateWith) || !(self.name in self.colocateWith)) && (!has(self.separateFrom) || !(self.name in self.separateFrom))",
            message="a component must not name itself in colocateWith or separateFrom; remove its own name",
            expression="'component %s names itself in colocateWith or separateFrom; remove it there'.format([self.name])",
        ),
        Rule(
            rule="self.replicas == 1 || !has(self.devices) || self.devices.all(d, !d.exclusive)",
            message="an exclusive device allows one replica; write replicas: 1, or exclusive: false on the device",
            expression="'component %s: %d replicas cannot share the exclusive device %s; write replicas: 1, or exclusive: false on the device'.format([self.name, self.replicas, self.devices.filter(d, d.exclusive)[0].name])",
            path=".replicas",
        ),
        Rule(
            rule="!has(self.env) || !self.env.exists(e, e.name == 'ROS_DOMAIN_ID')",
            message="ROS_DOMAIN_ID is set by the operator from the claimed domain; drop it from env and write spec.dds.domain if you need a certain number",
            expression="'component %s: ROS_DOMAIN_ID is set by the operator from the claimed domain; drop it from env and write spec.dds.domain if you need a certain number'.format([self.name])",
            path=".env",
            reason="FieldValueForbidden",
        ),
    )

    name: DnsLabel
    """Name of the component within the app."""
    image: Image
    """Container image; a digest keeps robots on exactly what you tested."""
    command: Annotated[Words, Core("Container", "command")] = ()
    """Entry point in place of the image's own."""
    args: Annotated[Words, Core("Container", "args")] = ()
    """Arguments of the entry point."""
    env: Annotated[JsonList, Core("Container", "env")] = ()
    """Environment variables; the operator adds the ROS ones."""
    env_from: Annotated[JsonList, Core("Container", "envFrom")] = ()
    """ConfigMaps and Secrets of this namespace whose keys become environment variables."""
    ports: Annotated[JsonList, Core("Container", "ports")] = ()
    """Ports of the container; host ports are not possible."""
    volumes: Annotated[JsonList, Core("PodSpec", "volumes")] = ()
    """Volumes of the pod: configMap, secret, emptyDir, persistentVolumeClaim, projected or downwardAPI."""
    volume_mounts: Annotated[JsonList, Core("Container", "volumeMounts")] = ()
    """Where the volumes appear in the container."""
    resources: Annotated[Json, Core("Container", "resources")] = Field(default_factory=dict)
    """CPU, memory and extended resources the container asks for and may use at most."""
    image_pull_policy: (
        Annotated[Literal["Always", "IfNotPresent", "Never"], Core("Container", "imagePullPolicy")] | None
    ) = None
    """When the image is pulled: Always, IfNotPresent or Never."""
    image_pull_secrets: Annotated[JsonList, Core("PodSpec", "imagePullSecrets")] = ()
    """Secrets of this namespace that let the node pull the image."""
    init_containers: Annotated[JsonList, Core("PodSpec", "initContainers")] = ()
    """Containers that run before the component."""
    tolerations: Annotated[JsonList, Core("PodSpec", "tolerations")] = ()
    """Node taints the component puts up with."""
    node_selector: Annotated[dict[str, str], Core("PodSpec", "nodeSelector")] = Field(default_factory=dict)
    """Labels the node must have, beside what runsOn and requires ask for."""
    priority_class_name: Annotated[str, Core("PodSpec", "priorityClassName")] | None = None
    """PriorityClass of the pod; it comes before qosClass in the scheduler's queue."""
    service_account_name: Annotated[str, Core("PodSpec", "serviceAccountName")] | None = None
    """ServiceAccount of this namespace the pod runs as."""
    security_context: Annotated[Json, Core("Container", "securityContext")] | None = None
    """Security options of the container."""
    pod_security_context: Annotated[Json, Core("PodSpec", "securityContext")] | None = None
    """Security options of the pod."""
    runtime_class_name: Annotated[str, Core("PodSpec", "runtimeClassName")] | None = None
    """RuntimeClass the pod runs with."""
    termination_grace_period_seconds: Annotated[int, Core("PodSpec", "terminationGracePeriodSeconds")] | None = None
    """Seconds between the request to stop and the kill."""
    pre_stop: Annotated[Json, Core("Lifecycle", "preStop")] | None = None
    """What runs in the container before it is asked to stop, for example publishing zero velocity."""
    params: Params | None = None
    """ROS parameters; a change of their content rolls the pod."""
    runs_on: RunsOn = "Any"
    """Tier of the node: Robot, Edge, Cloud (label robotics.io/tier) or Any."""
    qos_class: QosClass = "system_default"
    """Scheduling tier: realtime, sensor_data, system_default, best_effort, in the order they are served."""
    policies: Policies = Policies()
    """Policies for components without edges."""
    devices: Annotated[tuple[Device, ...], ListMap("name"), Field(max_length=16)] = ()
    """Devices of the node the component uses; exclusive ones are claimed."""
    requires: Annotated[tuple[Requirement, ...], ListMap("type", "model"), Field(max_length=16)] = ()
    """Capabilities the node must have, not claimed."""
    shared_data: SharedData | None = None
    """Who works on the same data."""
    lifecycle: Lifecycle = Lifecycle()
    """ROS 2 lifecycle of the component."""
    ready: Ready | None = None
    """When the component counts as ready; absent means when its container runs."""
    colocate_with: Peers = ()
    """Components that must be on the same node as this one."""
    separate_from: Peers = ()
    """Components that must be on another node than this one."""
    replicas: Annotated[int, Field(ge=1, le=32)] = 1
    """Identical copies; more than 1 only without exclusive devices."""
    on_disconnect: OnDisconnect | None = None
    """What happens when the node is unreachable: Keep the pod, Failover to another node, or Stop. Absent means Keep
    where runsOn is Robot and Failover otherwise."""
