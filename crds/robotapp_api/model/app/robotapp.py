"""RobotApp: a robot application as one object."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model import names
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.edge import Edge
from robotapp_api.model.app.override import Override
from robotapp_api.model.app.placement import Placement
from robotapp_api.model.app.robots import Matrix, Robots
from robotapp_api.model.app.ros import Ros, Ros1, Ros2
from robotapp_api.model.app.status import RobotAppStatus
from robotapp_api.model.base import Model, ObjectMeta
from robotapp_api.model.markers import Column, Kind, ListMap, ListSet, Rule
from robotapp_api.model.recording import Recording
from robotapp_api.model.scalars import DnsLabel, Duration

_NAMES = "self.components.map(c, c.name)"
_JOBS = "self.components.filter(j, has(j.job) && !has(j.schedule)).map(j, j.name)"
"""The components that end; one with schedule comes back."""
_WITH_SCHEDULE = "self.components.filter(j, has(j.schedule)).map(j, j.name)"
_BY_STATUS = (
    "sets.contains(self.components.filter(j, has(j.job) || has(j.schedule)).map(j, j.name), c.dependsOn.filter(d, d.status == 'Complete').map(d, d.component)) && "
    "sets.contains(self.components.filter(j, !has(j.job) || has(j.schedule)).map(j, j.name), c.dependsOn.filter(d, d.status == 'Ready').map(d, d.component))"
)
"""Whether a component waits for each other one as what it is. One with schedule has a rule of its own."""
_DEPENDENCIES = "c.dependsOn.map(d, d.component)"
_AFTER_SCHEDULE = (
    f"has(c.dependsOn) && sets.contains({_NAMES}, {_DEPENDENCIES}) && "
    f"!sets.contains(self.components.filter(j, !has(j.schedule)).map(j, j.name), {_DEPENDENCIES})"
)
"""Whether a component waits for one with schedule."""


def _known(field: str, *, has: str, advice: str) -> Rule:
    """Every name in a list of components exists. `in` and sets.contains keep the static cost 400 times below nested exists."""
    wrong = f"self.components.filter(c, {has} && !sets.contains({_NAMES}, c.{field}))"
    return Rule(
        rule=f"self.components.all(c, !({has}) || sets.contains({_NAMES}, c.{field}))",
        message=f"{field} must name components of this app; {advice}",
        expression=f"'{field} of %s is %s, but the components are %s; {advice}'.format([{wrong}.map(c, c.name), {wrong}.map(c, c.{field}), {_NAMES}])",
        path=".components",
    )


class Update(Model):
    """How a new operator version, or another content of a ConfigMap, reaches running pods."""

    operator: Literal["Automatic", "OnDemand"] = "Automatic"
    """Automatic rolls pods when a new operator version renders them differently. OnDemand waits until the annotation
    robotics.io/approve-update names that version. Your own edits always roll at once."""
    on_config_change: Literal["Roll", "None"] = "Roll"
    """Roll starts a component anew when a ConfigMap that it mounts or reads as environment or parameter file has another
    content, less and less often while it keeps changing. None leaves it running."""


class Connectivity(Model):
    """What counts as disconnected."""

    grace: Duration = "5m"
    """How long a robot's node may be not Ready before its instance counts as Offline and pods that fail over move, and how long
    the robot may be out of sight (no node of its name; Offline at once) before its instance ends."""


class Success(Model):
    """Which jobs must complete."""

    operator: Literal["All", "Any"] = "All"
    """All: each of the jobs completes. Any: the first of them does, and the others are ended."""
    components: Annotated[tuple[DnsLabel, ...], ListSet(), Field(max_length=64)] = ()
    """Components with job that count; absent means all of them. Those with schedule never do."""


class Completion(Model):
    """When an instance has completed although it has components that run on: these end with it."""

    success: Success = Success()
    """Which jobs must complete."""
    deadline: (
        Annotated[
            Duration,
            Rule(
                rule="!self.matches('^(0+([.]0+)?[a-z]+)+$')",
                message="deadline must be above zero, or the instance fails at once; write for example 30m, or leave it out for no limit",
            ),
        ]
        | None
    ) = None
    """How long the jobs may take together, from the first one's creation; then the instance has failed. Time in which they are suspended or
    wait in a queue does not count. With maxRestarts it is one limit for all attempts. Absent means no limit."""
    max_restarts: Annotated[int, Field(ge=0, le=10)] = 0
    """How many times an instance is started again when a job that counts has failed: all its jobs run again, also
    those that have completed, and its other components start anew. The count begins anew with an edit of a job, and
    with kubectl robotapp runs --failed."""
    ttl: Duration | None = None
    """How long after the end of all instances the app is deleted, with its Jobs and their logs, whether they have completed or failed.
    Absent means never."""


class RobotAppSpec(Model):
    """What is wanted; only its author writes it."""

    RULES = (
        Rule(
            rule=f"!has(self.edges) || sets.contains({_NAMES} + ['{names.ROBOT_END}'], self.edges.map(e, e.from) + self.edges.map(e, e.to))",
            message="from and to of an edge must name a component of this app or @robot",
            expression=f"'edges have unknown ends (topic, from, to): %s; write the name of a component or @robot'.format([self.edges.filter(e, !(e.from in {_NAMES} + ['{names.ROBOT_END}'] && e.to in {_NAMES} + ['{names.ROBOT_END}'])).map(e, [e.topic, e.from, e.to])])",
            path=".edges",
        ),
        _known("colocateWith", has="has(c.colocateWith)", advice="write the name of a component"),
        _known("separateFrom", has="has(c.separateFrom)", advice="write the name of a component"),
        _known(
            "sharedData.with",
            has="has(c.sharedData) && has(c.sharedData.with)",
            advice="write the name of a component; foreign pods belong in sharedData.peerPods",
        ),
        Rule(
            rule=f"self.components.all(c, !has(c.dependsOn) || sets.contains({_NAMES}, c.dependsOn.map(d, d.component)))",
            message="dependsOn must name components of this app; write the name of a component",
            expression=f"'dependsOn of %s names no component of this app; components are %s'.format([self.components.filter(c, has(c.dependsOn) && !sets.contains({_NAMES}, c.dependsOn.map(d, d.component))).map(c, c.name), {_NAMES}])",
            path=".components",
        ),
        Rule(
            rule=f"self.components.all(c, !has(c.dependsOn) || {_BY_STATUS})",
            message="dependsOn waits for a job with status: Complete, and for others with status: Ready; write that status, or job: {} in a component that ends",
            expression=f"'dependsOn of %s waits for a job with status: Complete, and for others with status: Ready; write that status, or job: {{}} in a component that ends (jobs are %s)'.format([self.components.filter(c, has(c.dependsOn) && !({_BY_STATUS})).map(c, c.name), {_JOBS}])",
            path=".components",
        ),
        Rule(
            rule=f"self.components.all(c, !({_AFTER_SCHEDULE}))",
            message="dependsOn waits for no component with schedule, which comes back and is never complete; remove it from dependsOn, or schedule there",
            expression=f"'dependsOn of %s names a component with schedule (%s), which comes back and is never complete; remove it from dependsOn, or schedule there'.format([self.components.filter(c, {_AFTER_SCHEDULE}).map(c, c.name), {_WITH_SCHEDULE}])",
            path=".components",
        ),
        Rule(
            rule=f"!has(self.completion) || has(self.matrix) || {_JOBS}.size() > 0",
            message="completion is about components that end, and none does (one with schedule comes back); write job: {} in one, or remove completion",
            path=".completion",
        ),
        Rule(
            rule=f"!has(self.completion) || !has(self.completion.success) || !has(self.completion.success.components) || sets.contains({_JOBS}, self.completion.success.components)",
            message="completion.success.components must name components with job and without schedule; write the name of one, or job: {} in it",
            expression=f"'completion.success.components are %s, but the components with job and without schedule are %s; write the name of one, or job: {{}} in it'.format([self.completion.success.components, {_JOBS}])",
            path=".completion.success.components",
        ),
        Rule(
            rule="self.components.all(c, !has(c.colocateWith) || !self.components.exists(o, has(o.separateFrom) && o.name in c.colocateWith && c.name in o.separateFrom))",
            message="one component wants to be with another that wants to be apart from it; remove one of the two names",
            expression="'colocateWith of %s contradicts separateFrom of the component it names; remove one of the two names'.format([self.components.filter(c, has(c.colocateWith) && self.components.exists(o, has(o.separateFrom) && o.name in c.colocateWith && c.name in o.separateFrom)).map(c, c.name)])",
            path=".components",
        ),
        Rule(
            rule=f"has(self.robots) || !has(self.edges) || self.edges.all(e, e.from != '{names.ROBOT_END}' && e.to != '{names.ROBOT_END}')",
            message="an edge to @robot needs a robot; write robots.nodeSelector, or the name of a component in place of @robot",
            path=".edges",
        ),
        Rule(
            rule="!has(self.ros2) || !has(self.ros2.domain) || !has(self.robots) || self.robots.assignment != 'Each' || self.ros2.isolation == 'Discovery'",
            message="one domain for every robot would let all of them obey one /cmd_vel; drop ros2.domain, or write robots.assignment: Any or ros2.isolation: Discovery",
            expression="'domain %d for every robot would let all of them obey one /cmd_vel; drop ros2.domain, or write robots.assignment: Any or ros2.isolation: Discovery'.format([self.ros2.domain])",
            path=".ros2.domain",
        ),
        Rule(
            rule="!has(self.matrix) || !has(self.robots)",
            message="a sweep has an instance for each combination of values, and robots have one each; remove matrix or robots",
            path=".matrix",
        ),
        Rule(
            rule="!has(self.matrix) || self.components.all(c, !has(c.schedule))",
            message="an instance of a sweep runs once and ends, and a component with schedule comes back; remove schedule, or matrix",
            path=".components",
        ),
        Rule(
            rule="!has(self.matrix) || self.components.exists(c, has(c.job))",
            message="an instance of a sweep ends with its components that have job, and none has it, so later ones would wait for ever; write job: {} where the program ends, and completion: {} if others run on",
            path=".components",
        ),
        Rule(
            rule=f"!has(self.matrix) || has(self.completion) || {_JOBS}.size() == 0 || (!has(self.recordings) && self.components.all(c, has(c.job)))",
            message="an instance of a sweep would not end, because it has components or recordings that run on; write completion: {} to end it with its jobs",
            path=".completion",
        ),
        Rule(
            rule="!has(self.matrix) || !has(self.ros2) || !has(self.ros2.domain) || self.ros2.isolation == 'Discovery'",
            message="one domain for all instances of a sweep would let them obey each other's topics; drop ros2.domain, or write ros2.isolation: Discovery",
            path=".ros2.domain",
        ),
        Rule(
            rule=f"!has(self.overrides) || self.overrides.all(o, sets.contains({_NAMES}, o.components.map(c, c.name)))",
            message="components of an override must be components of this app; write the name of one",
            expression=f"'overrides name components that this app does not have: %s; the components are %s'.format([self.overrides.filter(o, !sets.contains({_NAMES}, o.components.map(c, c.name))).map(o, o.components.map(c, c.name)), {_NAMES}])",
            path=".overrides",
        ),
        Rule(
            rule="!has(self.overrides) || has(self.robots)",
            message="overrides are for some of the app's robots, and the app has none; write robots.nodeSelector, or the values in the components",
            path=".overrides",
        ),
        Rule(
            rule=f"!has(self.recordings) || !self.recordings.exists(r, sets.contains({_NAMES}, [r.name]))",
            message="a recording becomes a component of its name, so no component may have it; write another name",
            expression=f"'recordings have names of components: %s; write other names'.format([self.recordings.filter(r, sets.contains({_NAMES}, [r.name])).map(r, r.name)])",
            path=".recordings",
        ),
    )

    suspend: bool = False
    """true removes all pods, keeps the domain and gives the devices back."""
    ros: Ros
    """ROS version and distribution."""
    robots: Robots | None = None
    """Robots the app runs for; absent means one instance that belongs to no robot."""
    matrix: Matrix | None = None
    """A sweep: an instance for each combination of the values of its parameters. Absent means none."""
    components: Annotated[tuple[Component, ...], ListMap("name"), Field(min_length=1, max_length=64)]
    """Processes of the app; each becomes one Deployment per instance, or one Job if it ends."""
    edges: Annotated[tuple[Edge, ...], ListMap("kind", "topic", "from", "to"), Field(max_length=256)] = ()
    """Who talks to whom, and how fast it must be."""
    overrides: Annotated[tuple[Override, ...], ListMap("name"), Field(max_length=16)] = ()
    """Values of components that differ from robot to robot, chosen by labels of the robots' nodes; of several that choose one
    robot a later one wins."""
    recordings: Annotated[tuple[Recording, ...], ListMap("name"), Field(max_length=8)] = ()
    """Topics that are written into bags, by a component of each recording's name."""
    completion: Completion | None = None
    """When an instance has ended as a whole, although it has components that run on. Absent means: when all its components are jobs
    that have ended."""
    placement: Placement = Placement()
    """Placement of the whole app."""
    ros2: Ros2 | None = None
    """Domain, middleware and discovery of a ROS 2 app; absent means defaults. Not for ROS 1."""
    ros1: Ros1 | None = None
    """Master of a ROS 1 app. Only with a ROS 1 distribution."""
    update: Update = Update()
    """How new operator versions reach running pods."""
    connectivity: Connectivity = Connectivity()
    """What counts as disconnected."""
    scheduler_name: Annotated[str, StringConstraints(min_length=1, max_length=253)] | None = None
    """Scheduler of the pods; absent means the operator's setting, ros-aware-scheduler unless the cluster's operator chose
    otherwise. With another scheduler ROS placement rules and device claims are off."""


class RobotApp(Model):
    """A robot application: ROS components that share a domain, sit close enough to each other and to the robot, and own
    the devices they need.
    """

    RULES = (
        Rule(
            rule="size(self.metadata.name) <= 40",
            message="metadata.name may have at most 40 characters, because names of children are derived from it; write a shorter name",
            expression="'metadata.name has %d characters; names of children are derived from it, write at most 40'.format([size(self.metadata.name)])",
        ),
    )
    CRD: ClassVar = Kind(
        plural="robotapps",
        singular="robotapp",
        short_names=("ra", "rapp"),
        namespaced=True,
        columns=(
            Column("Ready", ".status.summary.ready"),
            Column("Phase", ".status.phase"),
            Column("Domain", ".status.summary.domain"),
            Column("Robots", ".status.summary.robots"),
            Column("Budget", ".status.summary.budget"),
            Column("Devices", ".status.summary.devices"),
            Column("Age", ".metadata.creationTimestamp", type="date"),
            Column("RMW", ".status.summary.rmw", wide=True),
            Column("Discovery", ".status.summary.discovery", wide=True),
            Column("Nodes", ".status.summary.nodes", wide=True),
            Column("Message", ".status.summary.message", wide=True),
        ),
        selectable=(".spec.schedulerName", ".status.phase"),
    )

    api_version: Literal["robotics.io/v1alpha1"] = names.API_VERSION
    """Version of the schema this object is written in."""
    kind: Literal["RobotApp"] = "RobotApp"
    """Kind of this object."""
    metadata: ObjectMeta = ObjectMeta()
    """Name, namespace, labels and annotations."""
    spec: RobotAppSpec
    """What is wanted; only its author writes it."""
    status: RobotAppStatus = RobotAppStatus()
    """The observation; only the operator writes it."""
