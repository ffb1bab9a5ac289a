"""The desired state of one instance of an app, with everything conditional already decided.

The schema defaults what depends on nothing else; what depends on the distro, the middleware or the robot is decided here,
once, so that rendering, status and `render` agree.
"""

import contextlib
import dataclasses
import functools
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, Final, NamedTuple

import msgspec

from robotapp_api.checks.replicas import expand_spec
from robotapp_api.checks.ros import discovery_of, rmw_of, ros_components, ros_version_of, uses_ros
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.edge import Edge
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.app.ros import Discovery, Ros1, Ros2
from robotapp_api.model.app.service import ComponentService
from robotapp_api.model.app.template import HelperContainer, HelperTemplate
from robotapp_api.model.base import dump
from robotapp_api.model.distros import DISCOVERY_IMAGE, HELPER_USER, IPV4, MASTER_IMAGE, RECORDER_IMAGE
from robotapp_api.model.names import OUR_SCHEDULERS, SCHEDULER_NAME, Annotation
from robotapp_api.values.naming import child_name
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.quantities.times import read_moment
from robotapp_api.values.references import Values, reference_values
from robotapp_api.values.replicas import NumberedReplica, find_replicas
from robotapp_api.values.schedules.due_times import DueTimes, parse_due_times
from robotapp_api.values.sweeps.matrix import MatrixInstance, expand_matrix, list_variables
from robotapp_claims.rules.completion.endings import CompletionRules, completion_rules_of
from robotapp_claims.rules.objects import App as ClaimsApp
from robotapp_claims.rules.share import AppKey
from robotapp_operator.plan.spec.covers import content_hash
from robotapp_operator.plan.spec.objects import Job

# Derived names of what is no component. A dot cannot occur in a component's name, so the hash differs from any of theirs.
SERVERS: Final = ("discovery.0", "discovery.1")
"""Two, on different nodes: while one is replaced the other still introduces late joiners."""
SERVERS_SERVICE: Final = "discovery."
LONGEST_SERVER_NAME: Final = 63
"""Fast DDS takes no longer host name in `ROS_DISCOVERY_SERVER`, dots included."""
ROUTER: Final = "router."
MASTER: Final = "master."
PEERS: Final = "peers."
REPLICAS: Final = "replicas."
"""Begins the name of the Service under which the replicas of a component have theirs."""

DEFAULT_POOL: Final = "default"
NEVER: Final = "Never"
"""Value of `placement.reschedule.when`."""
LONGEST_S: Final = 10 * 365 * 86_400.0
"""Longer durations count as this one where a moment is computed from them."""


class HelperDefaults(NamedTuple):
    """Images and user of helper pods: discovery servers, router and master. `{distro}` stands for the app's distribution.

    Also the IP family of the pods, which their middleware must speak.
    """

    discovery_image: str = DISCOVERY_IMAGE
    master_image: str = MASTER_IMAGE
    user: int = HELPER_USER
    """User id of their processes where the components share none; 0 leaves it to the platform."""
    ip_family: str = IPV4
    """That of the pods' first address, and so of the names under which they find each other."""
    recorder_image: str = RECORDER_IMAGE
    """Image of recordings that write none."""


NO_SETTINGS: Final = HelperDefaults()
_IDENTITY: Final = {"name", "replicas", "replica_identity"}
"""Fields of a component that decide which replicas have ordinals."""


class Abilities(NamedTuple):
    """What of a pod the operator may render in this cluster: settings of the operator."""

    host_access: bool = False
    """Fields that reach the node; the chart sets it together with the policy that guards them."""
    stop_signals: bool = False
    """`lifecycle.stopSignal`, whose feature gate is off unless a cluster switches it on."""


NO_ABILITIES: Final = Abilities()


class EnvVar(NamedTuple):
    name: str
    value: str


class Domain(NamedTuple):
    """The id an instance may use, and the claim that is the lock on it ("" for a shared id)."""

    id: int
    claim: str = ""


@dataclasses.dataclass(frozen=True, kw_only=True)
class App:
    """A RobotApp as the plan sees it: identity and spec, without its status.

    In `spec` each replica that has an ordinal is a component of its own.
    """

    name: str
    namespace: str
    uid: str
    generation: int
    spec: RobotAppSpec
    annotations: Mapping[str, str] = dataclasses.field(default_factory=dict)
    created: str = ""
    default_scheduler: str = SCHEDULER_NAME
    """Scheduler of apps that name none: a setting of the operator."""
    helper_defaults: HelperDefaults = NO_SETTINGS
    """What helper pods are made of where the app writes nothing: settings of the operator."""
    unknown_fields: tuple[str, ...] = ()
    """Fields of the stored spec that a later version brought."""
    abilities: Abilities = NO_ABILITIES
    queue: str = ""
    """Queue of kueue that the app's Jobs wait in (a label of the RobotApp); "" for none. Then kueue alone suspends and resumes them."""
    overrides: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """By component: the overrides that made the spec what it is for one robot."""
    spec_with_replicas: RobotAppSpec | None = None
    """The spec as its author wrote it, None where that is `spec`: without ordinals."""
    replicas: Mapping[str, NumberedReplica] = dataclasses.field(default_factory=dict)
    """Those that have an ordinal, by their names as components."""

    def __post_init__(self) -> None:
        expanded = expand_spec(self.spec)
        if expanded is not self.spec:
            identities = [component.model_dump(by_alias=True, include=_IDENTITY) for component in self.spec.components]
            object.__setattr__(self, "replicas", find_replicas(identities))
            object.__setattr__(self, "spec_with_replicas", self.spec)
            object.__setattr__(self, "spec", expanded)

    @property
    def written(self) -> RobotAppSpec:
        """The spec as its author wrote it, to whose fields sentences refer."""
        return self.spec_with_replicas or self.spec

    def written_name(self, component: str) -> str:
        """Returns the name that a component, or the component of a replica, has in the spec."""
        replica = self.replicas.get(component)
        return replica.component if replica else component

    def reference_values(self, component: str, robot: str) -> Values:
        """Returns what is expanded in the pods of a component for this robot."""
        replica = self.replicas.get(component)
        return reference_values(robot, replica.ordinal if replica else None, matrix=self.matrix_variables(robot))

    @functools.cached_property
    def sweep(self) -> Mapping[str, MatrixInstance]:
        """The instances of the app's sweep by their names, in the order of its values; {} without a matrix."""
        matrix = dump(self.spec.matrix) if self.spec.matrix else None
        return {instance.name: instance for instance in expand_matrix(matrix)}

    def matrix_variables(self, instance: str) -> Values | None:
        """Returns the variables with the values of an instance of a sweep; None for an app without a matrix."""
        if self.spec.matrix is None:
            return None
        return list_variables(self.sweep[instance].values) if instance in self.sweep else {}

    @property
    def services(self) -> Mapping[str, ComponentService]:
        """The Services that components ask for, by the component's name in the spec: one for all replicas."""
        return {component.name: component.service for component in self.written.components if component.service}

    @property
    def distro(self) -> str:
        return self.spec.ros.distro

    @property
    def ros_version(self) -> int:
        """1 or 2; as written, else from the distro, else 2; NO_ROS where no component uses ROS."""
        return ros_version_of(self.spec)

    def uses_ros(self, component: Component) -> bool:
        """Whether the component is a ROS program."""
        return uses_ros(component, self.distro)

    @property
    def ros_components(self) -> Sequence[Component]:
        """The components that use ROS."""
        return ros_components(self.spec)

    @property
    def suspended(self) -> bool:
        """Whether no component may have a pod: by `suspend`, or by `replicas: 0` of each."""
        return self.spec.suspend or all(component.replicas == 0 for component in self.spec.components)

    @property
    def orders_starts(self) -> bool:
        """Whether a component waits for another one."""
        return any(component.depends_on for component in self.spec.components)

    @property
    def has_jobs(self) -> bool:
        """Whether a component ends."""
        return any(component.job is not None for component in self.spec.components)

    @functools.cached_property
    def completion_rules(self) -> CompletionRules | None:
        """When instances end, None for those that run on. Recordings end with the others."""
        if not self.has_jobs:
            return None
        recordings = {recording.name for recording in self.spec.recordings}
        parts = [component for component in self.spec.components if component.name not in recordings]
        body: dict[str, Any] = {
            "components": [
                {"name": part.name, "replicas": part.replicas, "job": {} if part.ends else None} for part in parts
            ],
            "completion": dump(self.spec.completion) if self.spec.completion else None,
        }
        return completion_rules_of(
            msgspec.convert({"metadata": {"generation": self.generation}, "spec": body}, ClaimsApp)
        )

    @functools.cached_property
    def due_times(self) -> Mapping[str, DueTimes]:
        """Returns when the components with schedule are due, by name, without those whose line or zone is refused."""
        due_times: dict[str, DueTimes] = {}
        for component in self.spec.components:
            if component.schedule is not None:
                with contextlib.suppress(ValueError):
                    due_times[component.name] = parse_due_times(component.schedule.cron, component.schedule.time_zone)
        return due_times

    @functools.cached_property
    def schedule_hashes(self) -> Mapping[str, str]:
        """Hash of the schedule of each component that has one, by its name: another one begins it anew."""
        return {
            part.name: content_hash(part.schedule.model_dump(mode="json", exclude_defaults=True))
            for part in self.spec.components
            if part.schedule is not None
        }

    @functools.cached_property
    def run_hashes(self) -> Mapping[str, str]:
        """Hash of what the user wrote about the run of each component with job, by its name: another one runs the job again.

        Left out is what decides when it starts and for how long: how often a failed one is tried, and what it waits for.
        """
        return {
            part.name: content_hash(
                [
                    self.distro,
                    part.model_dump(mode="json", exclude_defaults=True, exclude={"job", "depends_on", "replicas"}),
                ]
            )
            for part in self.spec.components
            if part.job is not None
        }

    @functools.cached_property
    def all_runs_hash(self) -> str:
        """Hash of what the user wrote about the runs of all components with job and without schedule."""
        scheduled = {part.name for part in self.spec.components if part.schedule is not None}
        return content_hash({name: text for name, text in self.run_hashes.items() if name not in scheduled})

    @property
    def max_restarts(self) -> int:
        """The number of times an instance is started again when a job has failed."""
        return self.completion_rules.max_restarts if self.completion_rules else 0

    @property
    def ttl(self) -> timedelta | None:
        """`completion.ttl`: how long after its end the app is deleted, None for never."""
        ttl = self.spec.completion.ttl if self.spec.completion else None
        return timedelta(seconds=min(_seconds(ttl), LONGEST_S)) if ttl is not None else None

    @property
    def edges_in_use(self) -> tuple[Edge, ...]:
        """The edges without those that have an end in a suspended component."""
        suspended = {component.name for component in self.spec.components if component.replicas == 0}
        return tuple(edge for edge in self.spec.edges if not {edge.from_, edge.to} & suspended)

    @property
    def rmw(self) -> str:
        """Middleware as written or the distro's default; "" for ROS 1 and without ROS."""
        return rmw_of(self.spec)

    @property
    def pool(self) -> str:
        return self.spec.ros2.pool if self.spec.ros2 else DEFAULT_POOL

    @property
    def requested_domain(self) -> int | None:
        return self.spec.ros2.domain if self.spec.ros2 else None

    @property
    def share_with(self) -> tuple[AppKey, ...]:
        """The apps whose domain this one requests to share."""
        others = self.spec.ros2.share_with if self.spec.ros2 else ()
        return tuple((other.namespace or self.namespace, other.name) for other in others)

    @property
    def takes_domains(self) -> bool:
        """Returns whether each instance takes a domain of its own: those that share one, or use the shared ids of the pool, take none."""
        isolation = self.spec.ros2.isolation if self.spec.ros2 else "Domain"
        return self.ros_version == 2 and isolation == "Domain" and not self.share_with

    @property
    def wants_devices(self) -> bool:
        return any(component.devices for component in self.spec.components)

    @property
    def discovery(self) -> str:
        """Discovery mode with `Auto` decided; "" for ROS 1 and without ROS."""
        return discovery_of(self.spec)

    @property
    def helper(self) -> HelperContainer:
        """What the app writes about its helper pods: discovery servers, router or master."""
        if self.ros_version == 1:
            return self.spec.ros1 or Ros1()
        return (self.spec.ros2 or Ros2()).discovery

    @property
    def helper_template(self) -> HelperTemplate:
        """The pod template it writes for them."""
        return self.helper.template or HelperTemplate()

    @property
    def helper_image(self) -> str:
        """The image it writes for them, "" for none."""
        helper = self.helper
        return helper.image if isinstance(helper, Ros1 | Discovery) else ""

    @property
    def our_scheduler(self) -> bool:
        return self.scheduler_name in OUR_SCHEDULERS

    @property
    def scheduler_name(self) -> str:
        """As written, else the operator's setting."""
        return self.spec.scheduler_name or self.default_scheduler

    @property
    def grace_s(self) -> float:
        """`connectivity.grace` in seconds, of which templates are made: at most `LONGEST_S`."""
        return min(_seconds(self.spec.connectivity.grace), LONGEST_S)

    @property
    def budget_for_s(self) -> float:
        """`placement.reschedule.for` in seconds: how long a budget is exceeded, or met again, before that counts."""
        return _seconds(self.spec.placement.reschedule.for_)

    @property
    def moves_for_budgets(self) -> bool:
        """Whether a component may be moved because a budget is exceeded: the app asks for it, and our scheduler proposes nodes."""
        return self.our_scheduler and self.spec.placement.reschedule.when != NEVER

    @property
    def cooldown(self) -> timedelta:
        """`placement.reschedule.cooldown`."""
        return timedelta(seconds=min(_seconds(self.spec.placement.reschedule.cooldown), LONGEST_S))

    @property
    def managed_master(self) -> bool:
        """ROS 1 with a roscore of ours."""
        return self.ros_version == 1 and (self.spec.ros1 is None or self.spec.ros1.master == "Managed")

    @functools.cached_property
    def spec_hashes(self) -> Mapping[str, str]:
        """Hash of what the user wrote for each component, by its name, and under "" for the instance's infrastructure.

        Other versions compute the same ones: defaults are left out, so a field that a newer schema adds changes nothing until
        it is used. Also left out is what every version carries out in templates of a newer one (`newer`), and what no
        template depends on.
        """
        left_out: Any = {
            "suspend": True,
            "update": True,
            "edges": True,
            "matrix": True,  # an instance is named after its values, and further ones are no edit of it
            "overrides": True,  # what they change is in the components already
            "recordings": True,  # they are components already
            "ros2": {"domain", "pool", "share_with"},
            "components": {"__all__": {"image", "replicas"}},
        }
        body = self.spec.model_dump(mode="json", exclude_defaults=True, exclude=left_out)
        parts: list[dict[str, Any]] = body["components"]
        names = [self.written_name(part["name"]) for part in parts]
        # How many replicas there are is no edit of the others.
        first_parts: dict[str, dict[str, Any]] = {}
        for name, part in zip(names, parts, strict=True):
            first_parts.setdefault(name, part)
        body["components"] = [*first_parts.values()]
        hashes = {"": content_hash(body)}
        for name, own in zip(names, parts, strict=True):
            body["components"] = [own if other == name else other for other in dict.fromkeys(names)]
            hashes[own["name"]] = content_hash(body)
        return hashes


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Desired:
    """One instance: names of its infrastructure and the resolved middleware settings."""

    app: App
    robot: str
    rmw: str
    distro: str
    discovery: str
    transport: str = "Auto"

    @property
    def robot_name(self) -> str:
        """The robot of the instance; "" without robots and for an instance of a sweep."""
        return "" if self.app.spec.matrix else self.robot

    @property
    def matrix_variables(self) -> Values:
        """The variables with the values of an instance of a sweep; {} for other instances."""
        return self.app.matrix_variables(self.robot) or {}

    @property
    def instance_values(self) -> Values:
        """What is expanded in pods and Services that belong to no component."""
        return self.app.reference_values("", self.robot)

    def values_of(self, component: str) -> Values:
        """Returns what is expanded in the pods of a component."""
        return self.app.reference_values(component, self.robot)

    def name_of(self, part: str) -> str:
        """Name of the Deployment or Service of a component or infrastructure part."""
        return child_name(self.app.name, self.robot, part)

    @property
    def server_hosts(self) -> tuple[str, ...]:
        """Host names of the discovery servers' pods."""
        return tuple(part.replace(".", "-") for part in SERVERS)

    @property
    def servers_service(self) -> str:
        """The Service under which the discovery servers' host names resolve."""
        longest = LONGEST_SERVER_NAME - max(len(host) for host in self.server_hosts) - len(".")
        return child_name(self.app.name, self.robot, SERVERS_SERVICE, longest=longest)

    @property
    def server_names(self) -> tuple[str, ...]:
        """DNS names of the discovery servers, short form as `peer_names`."""
        return tuple(f"{host}.{self.servers_service}" for host in self.server_hosts)

    @property
    def router_name(self) -> str:
        return self.name_of(ROUTER)

    @property
    def master_name(self) -> str:
        return self.name_of(MASTER)

    @property
    def peers_service(self) -> str:
        return self.name_of(PEERS)

    def replicas_service(self, component: str) -> str:
        """The Service under which the replica of this name as a component has a DNS name; a pod has one such Service."""
        if self.discovery == "Peers" and component in {part.name for part in self.app.ros_components}:
            return self.peers_service
        return self.name_of(f"{REPLICAS}{self.app.written_name(component)}")

    @property
    def peer_names(self) -> tuple[str, ...]:
        """One DNS name per component with ROS, short form: resolved by the pod's search path."""
        return tuple(f"{component.name}.{self.peers_service}" for component in self.app.ros_components)

    def names_to_await(self, component: str) -> tuple[str, ...]:
        """DNS names the middleware resolves once, when `component` starts."""
        if self.discovery == "Server":
            return self.server_names
        if self.discovery == "Peers":
            ended = {f"{part.name}.{self.peers_service}" for part in self.app.ros_components if part.job is not None}
            names = (name for name in self.peer_names if not name.startswith(f"{component}."))
            return tuple(name for name in names if name not in ended)
        return ()


def is_edited(app: App, component: str, job: Job) -> bool:
    """Returns whether the user has changed a component with job since this Job of it was made."""
    return job.metadata.annotations.get(Annotation.RUN_HASH) != app.run_hashes[component]


def find_deletion_time(app: App, completion_time: str) -> datetime | None:
    """Returns when an app is deleted that has ended then, None where it is not. completion_time: RFC 3339, "" before the end.

    It comes from objects that others may write, so a text that is no moment counts as none.
    """
    end = read_moment(completion_time)
    return None if app.ttl is None or end is None else end.astimezone(UTC) + app.ttl


def _seconds(duration: str) -> float:
    """Infinite for one that is longer than int64 nanoseconds, which the schema's pattern allows."""
    try:
        return parse_us(duration) / 1_000_000
    except ValueError:
        return float("inf")


def desired_of(app: App, robot: str) -> Desired:
    """The instance's desired state; defined for a spec that is not accepted, too."""
    return Desired(
        app=app,
        robot=robot,
        rmw=app.rmw,
        distro=app.distro,
        discovery=app.discovery,
        transport=app.spec.ros2.transport if app.spec.ros2 else "Auto",
    )
