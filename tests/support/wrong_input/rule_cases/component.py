"""Rules of one component and of its pod."""

from typing import Any

from tests.support.apiobjects import app, component
from tests.support.wrong_input.rule_cases.case import Object, RuleCase

PROBE = {"httpGet": {"path": "/healthz", "port": 8080}}
FROM_CONFIG_MAP = {"configMapKeyRef": {"name": "drv", "key": "$(ROBOTAPP_ROBOT).yaml", "optional": True}}
FROM_SECRET = {"secretKeyRef": {"name": "s", "key": "p.yaml"}}
RUN = {"package": "demo_nodes_cpp", "executable": "talker"}
LAUNCH = {"package": "bringup", "file": "robot.launch.py"}


def _mates(**fields: Any) -> Object:
    return app(components=[component("a", **fields), component("b"), component("c")])


def _ready(**fields: Any) -> Object:
    return app(components=[component(ready=fields)])


def _metadata(**fields: Any) -> Object:
    return app(components=[component(template={"metadata": fields})])


def _pod(**fields: Any) -> Object:
    return app(components=[component(template={"spec": fields})])


def _service(*, links: tuple[Object, ...] = (), port: Object | None = None, **spec: Any) -> Object:
    service = {"spec": {"ports": [{"name": "ui", "port": 80, **(port or {})}], **spec}, "links": list(links)}
    return app(components=[component(service=service)])


def _files(*files: Object) -> Object:
    return app(components=[component(parameters=list(files))])


def _devices(*devices: Object) -> Object:
    return app(components=[component(devices=[{"type": "serial", **device} for device in devices])])


def _refused(field: str, bad: Any, advice: str, *, good: Any) -> RuleCase:
    """A field of the pod that has no place in an app, with the only value the API server lets through."""
    says = f"{field} cannot be set in the template; {advice}"
    return RuleCase(f"{field} is not the template's", _pod(**{field: good}), _pod(**{field: bad}), says)


COMPONENT = [
    RuleCase(
        "a mate is not kept apart",
        _mates(colocateWith=["b"], separateFrom=["c"]),
        _mates(colocateWith=["b"], separateFrom=["b"]),
        "component a: b is both in colocateWith and in separateFrom; remove it from one of them",
    ),
    RuleCase(
        "not itself",
        _mates(colocateWith=["b"]),
        _mates(separateFrom=["a"]),
        "component a names itself in colocateWith or separateFrom; remove it there",
    ),
    RuleCase(
        "exclusive devices are not shared by replicas",
        app(components=[component(replicas=2, devices=[{"name": "cam", "type": "usb", "sharing": "Cluster"}])]),
        app(components=[component(replicas=2, devices=[{"name": "cam", "type": "usb"}])]),
        "component driver: 2 replicas cannot share the exclusive device cam; write replicas: 1, sharing: Cluster on the device, or replicaIdentity: Ordinal for one of its own for each replica",
    ),
    RuleCase(
        "replicas with ordinals have exclusive devices of their own",
        app(components=[component(replicas=2, replicaIdentity="Ordinal", devices=[{"name": "cam", "type": "usb"}])]),
        app(components=[component(replicas=2, replicaIdentity="None", devices=[{"name": "cam", "type": "usb"}])]),
        "component driver: 2 replicas cannot share the exclusive device cam; write replicas: 1, sharing: Cluster on the device, or replicaIdentity: Ordinal for one of its own for each replica",
    ),
    RuleCase(
        "a path of its own for each device",
        _devices({"name": "a", "mountAs": "/dev/lidar"}, {"name": "b", "mountAs": "/dev/base"}, {"name": "c"}),
        _devices({"name": "a", "mountAs": "/dev/lidar"}, {"name": "b", "mountAs": "/dev/lidar"}),
        "component driver: two devices cannot have one path; write another mountAs for one of them",
    ),
    RuleCase(
        "a path takes one device",
        _devices({"name": "front-lidar", "count": 1, "mountAs": "/dev/lidar"}),
        _devices({"name": "front-lidar", "count": 2, "mountAs": "/dev/lidar"}),
        "device front-lidar: one path takes one device; write count: 1, or leave mountAs out and read its variable",
    ),
    RuleCase(
        "a device is mounted below /dev",
        _devices({"name": "a", "mountAs": "/dev/serial/by-id/usb-FTDI_A5:1.0-if00@x+y"}),
        _devices({"name": "a", "mountAs": "/dev/../etc/passwd"}),
        "write a path below /dev, such as /dev/lidar, of letters, digits and . _ : @ + -",
    ),
    RuleCase(
        "a device replaces none that every container has",
        _devices({"name": "a", "mountAs": "/dev/null0"}),
        _devices({"name": "a", "mountAs": "/dev/null/0"}),
        "every container has this path already; write another one, such as /dev/lidar",
    ),
    RuleCase(
        "the domain is not set by hand",
        app(components=[component(env=[{"name": "RCUTILS_COLORIZED_OUTPUT", "value": "1"}])]),
        app(components=[component(env=[{"name": "ROS_DOMAIN_ID", "value": "7"}])]),
        "component driver: ROS_DOMAIN_ID is set by the operator from the claimed domain; drop it from env and write spec.ros2.domain if you need a certain number",
    ),
    RuleCase(
        "one program",
        app(components=[component(command=["driver"], args=["--fast"])]),
        app(components=[component(command=["driver"], run=RUN)]),
        "component driver: command, run and launch each name the program; write one of them",
    ),
    RuleCase(
        "a package or a launch file",
        app(components=[component(run=RUN)]),
        app(components=[component(launch=LAUNCH, run=RUN)]),
        "component driver: command, run and launch each name the program; write one of them",
    ),
    RuleCase(
        "arguments of run",
        app(components=[component(run={**RUN, "args": ["--fast"]})]),
        app(components=[component(run=RUN, args=["--fast"])]),
        "component driver: args are those of the entry point or of command; write run.args, or launch.arguments",
    ),
    RuleCase(
        "no ROS, no launch file",
        app(components=[component(ros="None", args=["postgres"])]),
        app(components=[component(ros="None", launch=LAUNCH)]),
        "component driver: ros: None has no ROS for run, launch and ready; remove ros, or write command or args, and readinessProbe",
    ),
    RuleCase(
        "no wait for itself",
        _mates(dependsOn=[{"component": "b"}]),
        _mates(dependsOn=[{"component": "a"}]),
        "component a cannot wait for itself; remove its own name from dependsOn",
    ),
    RuleCase(
        "remapped names",
        app(components=[component(run={**RUN, "remaps": {"scan": "/front/scan", "~/image": "image"}})]),
        app(components=[component(run={**RUN, "remaps": {"a b": "/scan"}})]),
        "a name to remap is no ROS name; write for example {scan: /front/scan}",
    ),
    RuleCase(
        "names of nodes are not remapped",
        app(components=[component(run={**RUN, "name": "front"})]),
        app(components=[component(run={**RUN, "remaps": {"__node": "front"}})]),
        "__node, __name and __ns are no topics; write run.name and run.namespace",
    ),
    RuleCase(
        "a launch file is found",
        app(components=[component(launch={"file": "/ws/robot.launch.py"})]),
        app(components=[component(launch={"file": "robot.launch.py"})]),
        "without package, file is a path in the container; write package, or a path that begins with /",
    ),
    RuleCase(
        "the argument for parameters has one value",
        app(components=[component(launch={**LAUNCH, "parametersArgument": "params"}, parameters=[FROM_SECRET])]),
        app(components=[component(launch={**LAUNCH, "arguments": {"params": "/p"}, "parametersArgument": "params"})]),
        "parametersArgument is given the path of the parameter file; remove this argument from arguments",
    ),
    RuleCase(
        "names of launch arguments",
        app(components=[component(launch={**LAUNCH, "arguments": {"perception/use_base_link_z": "true"}})]),
        app(components=[component(launch={**LAUNCH, "arguments": {"use sim": "true"}})]),
        "a name of a launch argument has letters, digits, '_', '.', '-' and '/' only; write for example {use_sim_time: \"true\"}",
    ),
    RuleCase(
        "one check of ROS",
        _ready(topic={"name": "/odom", "minRate": "0.5"}),
        _ready(topic={"name": "/odom"}, lifecycle="Active"),
        "write exactly one of topic and lifecycle; commands, HTTP and TCP checks are readinessProbe",
    ),
    RuleCase(
        "no check at all",
        _ready(lifecycle="Active"),
        _ready(),
        "write exactly one of topic and lifecycle; commands, HTTP and TCP checks are readinessProbe",
    ),
    RuleCase(
        "ready or readinessProbe",
        app(components=[component(readinessProbe=PROBE)]),
        app(components=[component(readinessProbe=PROBE, ready={"lifecycle": "Active"})]),
        "component driver: ready and readinessProbe both decide when it is ready; write one of them",
    ),
    RuleCase(
        "a job is one",
        app(components=[component(job={}, replicas=2, replicaIdentity="Ordinal")]),
        app(components=[component(job={}, replicas=2)]),
        "component driver: a job runs once, not as 2 copies; write replicas: 1, or replicaIdentity: Ordinal for a job of each replica",
    ),
    RuleCase(
        "what comes back is a job",
        app(components=[component(job={}, schedule={"cron": "0 2 * * MON-FRI", "timeZone": "Europe/Athens"})]),
        app(components=[component(schedule={"cron": "0 2 * * MON-FRI"})]),
        "component driver: schedule runs a program that ends again and again; write job: {} beside it, or remove schedule",
    ),
    RuleCase(
        "a schedule has no intervals",
        app(components=[component(job={}, schedule={"cron": "@hourly"})]),
        app(components=[component(job={}, schedule={"cron": "@every 5m"})]),
        "a schedule has times of day and no intervals; write for example */5 * * * * for every five minutes, or @hourly",
    ),
    RuleCase(
        "a name of a cron line is one that CronJobs have",
        app(components=[component(job={}, schedule={"cron": "@midnight"})]),
        app(components=[component(job={}, schedule={"cron": "@reboot"})]),
        "the names are @hourly, @daily or @midnight, @weekly, @monthly, @yearly or @annually, in small letters; write one of them, or five fields, for example 0 2 * * *",
    ),
    RuleCase(
        "a cron line has no time zone",
        app(components=[component(job={}, schedule={"cron": "0 2 * * *"})]),
        app(components=[component(job={}, schedule={"cron": "CRON_TZ=Europe/Athens 0 2 * * *"})]),
        "a cron line has no time zone; write it into timeZone, and the five fields alone here",
    ),
    RuleCase(
        "a cron line has five fields",
        app(components=[component(job={}, schedule={"cron": "0 2 * * *"})]),
        app(components=[component(job={}, schedule={"cron": "0 0 2 * * *"})]),
        "6 fields are written; write five: minute, hour, day of the month, month and day of the week, for example 0 2 * * *",
    ),
    RuleCase(
        "fields of a cron line have some characters",
        app(components=[component(job={}, schedule={"cron": "0 2 * * MON-FRI"})]),
        app(components=[component(job={}, schedule={"cron": "0 2 ? * *"})]),
        "fields have digits, letters and * , - / alone, with blanks between them; write * for every one, for example 0 2 * * *",
    ),
    RuleCase(
        "a time zone is a name",
        app(components=[component(job={}, schedule={"cron": "@hourly", "timeZone": "Etc/GMT+3"})]),
        app(components=[component(job={}, schedule={"cron": "@hourly", "timeZone": "../etc/passwd"})]),
        "write a name of the IANA database of time zones, for example Europe/Athens or UTC",
    ),
    RuleCase(
        "a job is never ready",
        app(components=[component(job={"backoffLimit": 0}, readinessProbe=PROBE)]),
        app(components=[component(job={"backoffLimit": 0}, ready={"lifecycle": "Active"})]),
        "component driver: a job is not ready, it completes; remove ready, and write dependsOn with status: Complete where others wait for it",
    ),
    RuleCase(
        "a tier stands once",
        app(components=[component(runsOn=["Edge", "Robot", "Cloud"])]),
        app(components=[component(runsOn=["Edge", "Robot", "Edge"])]),
        "a tier stands twice in runsOn; write each once, best first, for example [Edge, Robot]",
    ),
    RuleCase(
        "a parameter file is one",
        _files({"inline": "/**: {ros__parameters: {v: 1.0}}"}, FROM_CONFIG_MAP, FROM_SECRET),
        _files({"inline": "{}", **FROM_CONFIG_MAP}),
        "an entry of parameters is one file; write exactly one of inline, configMapKeyRef, secretKeyRef",
    ),
    RuleCase(
        "a parameter file is none",
        _files(FROM_SECRET),
        _files({}),
        "an entry of parameters is one file; write exactly one of inline, configMapKeyRef, secretKeyRef",
    ),
    RuleCase(
        "label keys of the template",
        _metadata(labels={"example.com/team": "a", "robotics.io.example.com/x": "b", "my-robotics.io/x": "c"}),
        _metadata(labels={"example.com/": "a"}),
        "a key is no label or annotation key; write for example example.com/team",
    ),
    RuleCase(
        "labels of the operator",
        _metadata(labels={"team": "a"}),
        _metadata(labels={"robotics.io/app": "other"}),
        "robotics.io/app: keys of robotics.io and app.kubernetes.io/ belong to the operator; write a key of your own, for example example.com/team",
    ),
    RuleCase(
        "annotations of the scheduler",
        _metadata(annotations={"prometheus.io/scrape": "true"}),
        _metadata(annotations={"granted.robotics.io/devices": "can-can0"}),
        "granted.robotics.io/devices: keys of robotics.io and app.kubernetes.io/ belong to the operator; write a key of your own, for example example.com/team",
    ),
    RuleCase(
        "recommended labels",
        _metadata(labels={"helm.sh/chart": "fleet"}),
        _metadata(labels={"app.kubernetes.io/name": "driver"}),
        "app.kubernetes.io/name: keys of robotics.io and app.kubernetes.io/ belong to the operator; write a key of your own, for example example.com/team",
    ),
    RuleCase(
        "a port on nodes",
        _service(type="NodePort", port={"nodePort": 30080}),
        _service(port={"nodePort": 30080}),
        "nodePort needs a port on every node; write type: NodePort, or leave nodePort out",
    ),
    RuleCase(
        "fields of a load balancer",
        _service(type="LoadBalancer", loadBalancerSourceRanges=["10.0.0.0/8"]),
        _service(type="NodePort", loadBalancerSourceRanges=["10.0.0.0/8"]),
        "loadBalancerClass and loadBalancerSourceRanges need type: LoadBalancer; write that type, or leave them out",
    ),
    RuleCase(
        "traffic from outside",
        _service(type="NodePort", externalTrafficPolicy="Local"),
        _service(externalTrafficPolicy="Local"),
        "externalTrafficPolicy needs type: NodePort or LoadBalancer; write one of them, or leave it out",
    ),
    RuleCase(
        "a link's port is one of the Service",
        _service(links=({"name": "map", "port": "ui", "path": "/map?zoom=2"},)),
        _service(links=({"name": "map", "port": "http"},)),
        "link map names the port http, which service.spec.ports does not have; write the name of one of its ports",
    ),
    _refused("nodeName", "amr-07", "write nodeSelector, or robots and runsOn of the component", good=""),
    _refused("schedulerName", "other", "write spec.schedulerName, which is for all components", good=""),
    _refused(
        "restartPolicy",
        "Never",
        "leave it out, or write job: {} in the component for a program that ends",
        good="Always",
    ),
    _refused("resourceClaims", [{"name": "gpu"}], "write devices of the component", good=[]),
    _refused("schedulingGates", [{"name": "x.io/y"}], "write spec.suspend: true to hold an app back", good=[]),
    _refused("ephemeralContainers", [{"name": "x"}], "leave it out: kubectl debug adds them to a running pod", good=[]),
]
