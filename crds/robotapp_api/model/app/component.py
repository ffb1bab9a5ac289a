"""Components: the processes of an app. Each becomes one Deployment per instance, or one Job if it ends.

Fields borrowed from PodSpec and Container stay JSON in Python, packed as text; their schema is the vendored core schema.
"""

from typing import Annotated, Literal

from pydantic import Field

from robotapp_api.model.app.device import Device, Requirement
from robotapp_api.model.app.edge import Durability, Liveliness, Reliability
from robotapp_api.model.app.parameters import ParameterFiles
from robotapp_api.model.app.program import Launch, Run
from robotapp_api.model.app.service import ComponentService
from robotapp_api.model.app.template import Template
from robotapp_api.model.base import Model
from robotapp_api.model.markers import Core, ListMap, ListSet, Rule
from robotapp_api.model.packed import PackedList, PackedMap
from robotapp_api.model.scalars import CronLine, DnsLabel, DnsName, Duration, Image, Quantity, TimeZone, TopicName

Tier = Literal["Robot", "Edge", "Cloud"]
QosClass = Literal["realtime", "sensor_data", "system_default", "best_effort"]
OnDisconnect = Literal["Keep", "Failover", "Stop"]
Words = tuple[str, ...]


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
    claim_names: Annotated[tuple[DnsName, ...], ListSet(), Field(max_length=16)] = ()
    """PersistentVolumeClaims of this namespace beside whose data it runs; template.spec.volumes and volumeMounts mount them."""


class ReadyTopic(Model):
    """A topic on which messages must arrive."""

    name: TopicName
    """Name of the topic, such as /odom."""
    min_rate: Quantity | None = None
    """Messages per second that must arrive at least, such as 20 or "0.5"; absent means one message."""


class Ready(Model):
    """When ROS itself says that the component is ready: exactly one kind of check."""

    RULES = (
        Rule(
            rule="[has(self.topic), has(self.lifecycle)].exists_one(x, x)",
            message="write exactly one of topic and lifecycle; commands, HTTP and TCP checks are readinessProbe",
        ),
    )

    topic: ReadyTopic | None = None
    """Messages arrive on this topic."""
    lifecycle: Literal["Active"] | None = None
    """Lifecycle state the node must have reached."""


class Dependency(Model):
    """A component of this app that must be ready, or complete, before this one is created."""

    component: DnsLabel
    """Name of the other component."""
    status: Literal["Ready", "Complete"] = "Ready"
    """State the other component must have reached: Ready, or Complete for one with job."""


class Job(Model):
    """How a program that ends is run: until it has ended with exit code 0, and not again afterwards."""

    backoff_limit: Annotated[int, Field(ge=0, le=100)] = 6
    """How many times a program that failed is started again before the job has failed."""
    active_deadline_seconds: Annotated[int, Field(ge=1, le=31_536_000)] | None = None
    """Seconds that all attempts together may take; then the job has failed. Absent means no limit."""


class Schedule(Model):
    """The clock by which the job of a component runs again and again."""

    cron: CronLine
    """Minute, hour, day of the month, month and day of the week, for example 0 2 * * * for every night at two; or @hourly, @daily
    or @midnight, @weekly, @monthly, @yearly or @annually."""
    time_zone: TimeZone = "UTC"
    """Time zone of the line: a name of the IANA database, such as Europe/Athens."""
    starting_deadline_seconds: Annotated[int, Field(ge=10, le=86_400)] = 600
    """How late a run may begin, in seconds, for example after an outage of the operator. Of several that were missed only the last one is
    made up for."""


class SharedMemory(Model):
    """The shared memory of a component's pod, /dev/shm."""

    size: Quantity
    """How much may be in it, such as 512Mi. What is in it counts towards the memory limits of the containers."""


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
            rule="self.replicas <= 1 || (has(self.replicaIdentity) && self.replicaIdentity == 'Ordinal') || !has(self.devices) || self.devices.all(d, d.sharing != 'Exclusive')",
            message="an exclusive device allows one replica; write replicas: 1, sharing: Cluster on the device, or replicaIdentity: Ordinal for one of its own for each replica",
            expression="'component %s: %d replicas cannot share the exclusive device %s; write replicas: 1, sharing: Cluster on the device, or replicaIdentity: Ordinal for one of its own for each replica'.format([self.name, self.replicas, self.devices.filter(d, d.sharing == 'Exclusive')[0].name])",
            path=".replicas",
        ),
        Rule(  # `in [x]` costs a tenth of `== x`, whose estimate has both lengths
            rule="!has(self.devices) || self.devices.all(d, !has(d.mountAs) || self.devices.exists_one(o, has(o.mountAs) && o.mountAs in [d.mountAs]))",
            message="two devices cannot have one path; write another mountAs for one of them",
            expression="'component %s: two devices cannot have one path; write another mountAs for one of them'.format([self.name])",
            path=".devices",
        ),
        Rule(
            rule="!has(self.env) || !self.env.exists(e, e.name == 'ROS_DOMAIN_ID')",
            message="ROS_DOMAIN_ID is set by the operator from the claimed domain; drop it from env and write spec.ros2.domain if you need a certain number",
            expression="'component %s: ROS_DOMAIN_ID is set by the operator from the claimed domain; drop it from env and write spec.ros2.domain if you need a certain number'.format([self.name])",
            path=".env",
            reason="FieldValueForbidden",
        ),
        Rule(
            rule="!has(self.ready) || !has(self.readinessProbe)",
            message="ready and readinessProbe both decide when the component is ready; write one of them",
            expression="'component %s: ready and readinessProbe both decide when it is ready; write one of them'.format([self.name])",
            path=".ready",
        ),
        Rule(
            rule="[has(self.command), has(self.run), has(self.launch)].filter(x, x).size() <= 1",
            message="command, run and launch each name the program; write one of them",
            expression="'component %s: command, run and launch each name the program; write one of them'.format([self.name])",
        ),
        Rule(
            rule="!has(self.args) || (!has(self.run) && !has(self.launch))",
            message="args are those of the image's entry point or of command; write run.args, or launch.arguments",
            expression="'component %s: args are those of the entry point or of command; write run.args, or launch.arguments'.format([self.name])",
            path=".args",
        ),
        Rule(
            rule="!has(self.ros) || (!has(self.run) && !has(self.launch) && !has(self.ready))",
            message="a component with ros: None has no ROS for run, launch and ready; remove ros, or write command or args, and readinessProbe",
            expression="'component %s: ros: None has no ROS for run, launch and ready; remove ros, or write command or args, and readinessProbe'.format([self.name])",
            path=".ros",
        ),
        Rule(
            rule="!has(self.dependsOn) || !self.dependsOn.exists(d, d.component == self.name)",
            message="a component cannot wait for itself; remove its own name from dependsOn",
            expression="'component %s cannot wait for itself; remove its own name from dependsOn'.format([self.name])",
            path=".dependsOn",
        ),
        Rule(
            rule="!has(self.job) || self.replicas <= 1 || (has(self.replicaIdentity) && self.replicaIdentity == 'Ordinal')",
            message="a job runs once; write replicas: 1, or replicaIdentity: Ordinal for a job of each replica",
            expression="'component %s: a job runs once, not as %d copies; write replicas: 1, or replicaIdentity: Ordinal for a job of each replica'.format([self.name, self.replicas])",
            path=".replicas",
        ),
        Rule(
            rule="!has(self.job) || !has(self.ready)",
            message="a job is not ready, it completes; remove ready, and write dependsOn with status: Complete where others wait for it",
            expression="'component %s: a job is not ready, it completes; remove ready, and write dependsOn with status: Complete where others wait for it'.format([self.name])",
            path=".ready",
        ),
        Rule(
            rule="!has(self.schedule) || has(self.job)",
            message="schedule runs a program that ends again and again; write job: {} beside it, or remove schedule",
            expression="'component %s: schedule runs a program that ends again and again; write job: {} beside it, or remove schedule'.format([self.name])",
            path=".schedule",
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
    run: Run | None = None
    """Program in place of command and args: an executable of a ROS package."""
    launch: Launch | None = None
    """Program in place of command and args: a launch file."""
    job: Job | None = None
    """For a program that ends, such as a map saver or a calibration: it runs until it has ended with exit code 0. {} is enough.
    Absent means a program that runs on, which is started again when it ends. A change of the component runs the job again."""
    schedule: Schedule | None = None
    """Runs the job again and again by the clock. Due times while a run goes on are skipped. Such a component runs
    on, so it is no part of completion, and dependsOn cannot wait for it. Absent means a job that runs once."""
    ros: Literal["None"] | None = None
    """None for a component without ROS, such as a database or a web server: no domain, no discovery and no ROS variables, everything
    else as for others. Absent means the app's ROS."""
    working_dir: Annotated[str, Core("Container", "workingDir")] | None = None
    """Directory the entry point starts in."""
    env: Annotated[PackedList, Core("Container", "env")] = PackedList()
    """Environment variables; the operator adds the ROS ones."""
    env_from: Annotated[PackedList, Core("Container", "envFrom")] = PackedList()
    """ConfigMaps and Secrets of this namespace whose keys become environment variables."""
    ports: Annotated[PackedList, Core("Container", "ports")] = PackedList()
    """Ports of the container; a hostPort takes the verb use on robotapps/hostnetwork."""
    volume_mounts: Annotated[PackedList, Core("Container", "volumeMounts")] = PackedList()
    """Where the volumes of template.spec appear in the container."""
    resources: Annotated[PackedMap, Core("Container", "resources")] = PackedMap()
    """CPU, memory and extended resources the container asks for and may use at most."""
    image_pull_policy: (
        Annotated[Literal["Always", "IfNotPresent", "Never"], Core("Container", "imagePullPolicy")] | None
    ) = None
    """When the image is pulled: Always, IfNotPresent or Never."""
    security_context: Annotated[PackedMap, Core("Container", "securityContext")] | None = None
    """Security options of the container."""
    liveness_probe: Annotated[PackedMap, Core("Container", "livenessProbe")] | None = None
    """Check whose failure restarts the container."""
    readiness_probe: Annotated[PackedMap, Core("Container", "readinessProbe")] | None = None
    """Check that must succeed before the component counts as ready."""
    startup_probe: Annotated[PackedMap, Core("Container", "startupProbe")] | None = None
    """Check that must succeed once before the others begin."""
    lifecycle: Annotated[PackedMap, Core("Container", "lifecycle")] | None = None
    """What runs in the container after its start and before it is asked to stop, for example publishing zero velocity."""
    stdin: Annotated[bool, Core("Container", "stdin")] | None = None
    """The container keeps its standard input open, for kubectl attach -i."""
    tty: Annotated[bool, Core("Container", "tty")] | None = None
    """The container has a terminal, for programs that draw on one; with stdin for kubectl attach -it."""
    shared_memory: SharedMemory | None = None
    """Size of /dev/shm in all containers of the pod; absent means what the container runtime gives, usually 64 MiB."""
    parameters: ParameterFiles = ()
    """ROS parameter files in the order in which they are passed; a later one wins. A change of what inline and
    configMapKeyRef hold rolls the pod. They are passed as --params-file, to a launch file by launch.parametersArgument; a program
    whose command line names $(ROBOTAPP_PARAMS), and one without ROS, reads their paths there."""
    template: Template = Field(default_factory=Template)
    """Everything else of the pod."""
    service: ComponentService | None = None
    """A Service of its own, for other programs, dashboards and people."""
    runs_on: Annotated[
        tuple[Tier, ...],
        Field(max_length=3),
        Rule(
            rule="self.all(t, self.exists_one(o, o == t))",
            message="a tier stands twice in runsOn; write each once, best first, for example [Edge, Robot]",
        ),
    ] = ()
    """Tiers of nodes the component may run on, best first: Robot, Edge, Cloud (node label robotics.io/tier). Absent means
    any. [Edge, Robot] runs on board where no edge node will do."""
    qos_class: QosClass = "system_default"
    """Scheduling tier: realtime, sensor_data, system_default, best_effort, in the order they are served."""
    policies: Policies = Policies()
    """Policies for components without edges."""
    devices: Annotated[tuple[Device, ...], ListMap("name"), Field(max_length=16)] = ()
    """Devices of the node the component uses; exclusive ones are claimed."""
    requires: Annotated[tuple[Requirement, ...], ListMap("type", "model", "interface"), Field(max_length=16)] = ()
    """Capabilities the node must have, not claimed."""
    shared_data: SharedData | None = None
    """Who works on the same data."""
    ready: Ready | None = None
    """When ROS itself says that the component is ready; absent means what readinessProbe says, or that its container runs."""
    colocate_with: Peers = ()
    """Components that must be on the same node as this one."""
    separate_from: Peers = ()
    """Components that must be on another node than this one."""
    depends_on: Annotated[tuple[Dependency, ...], ListMap("component"), Field(max_length=16)] = ()
    """Components that must be ready, or complete, before this one is created. One that runs is not stopped when they cease to be ready."""
    replicas: Annotated[int, Field(ge=0, le=32)] = 1
    """Identical copies, also in the name of their ROS node unless replicaIdentity is Ordinal; more than 1 with exclusive devices only
    then. 0 suspends the component: no pod, and its devices are given back."""
    replica_identity: Literal["None", "Ordinal"] | None = None
    """Ordinal makes each replica a component of its own, named after this one with its ordinal: detector-0, detector-1 and so on, each
    with that host name, a DNS name, devices of its own and ROBOTAPP_ORDINAL, so that ROS nodes can have different names. A pod that is
    replaced keeps its ordinal; fewer replicas end those with the highest. Edges and other references to the component are for each
    replica. Absent means None: copies that nothing tells apart."""
    on_disconnect: OnDisconnect | None = None
    """What happens when the node is unreachable for connectivity.grace: Keep the pod; Failover to another node; or Stop: the pod
    ends, and its successor starts when the node is back and the pod there has ended. Absent means Keep where
    runsOn is [Robot], else Failover, but a pod on a robot is waited for, because it may still drive: only Failover that is
    written starts a second one beside it."""

    @property
    def ends(self) -> bool:
        """Returns whether its program runs once and ends."""
        return self.job is not None and self.schedule is None
