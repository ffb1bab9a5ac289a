"""Rules of a RobotApp as a whole: ends of edges, names in components, robots, ROS."""

from collections.abc import Sequence
from typing import Any

from tests.support.apiobjects import AMR_07, app, component, edge
from tests.support.wrong_input.rule_cases.case import Object, RuleCase


def _pair(offered: Object, asked: Object) -> Object:
    return app(edges=[edge(qos=offered, requestedQos=asked)])


def _mates(**fields: Any) -> Object:
    return app(components=[component("a", **fields), component("b"), component("c")])


def _selector(**fields: Any) -> Object:
    return app(robots={"nodeSelector": fields})


def _after(status: str, **fields: Any) -> Object:
    dependency = {"component": "saver", "status": status}
    return app(components=[component("saver", **fields), component("planner", dependsOn=[dependency])])


def _completion(*components: str, **fields: Any) -> Object:
    success = {"success": {"operator": "Any", "components": list(components)}} if components else {}
    return app(
        components=[component("saver", **fields), component("planner")], completion={"deadline": "1h", **success}
    )


def _recording(name: str, **topics: Any) -> Object:
    return {"name": name, "topics": topics}


def _sweep(*counts: int, components: Sequence[Object] = (component("sim", job={}),), **spec: Any) -> Object:
    """A sweep with a parameter of so many values for each number."""
    parameters = [
        {"name": f"p{index}", "values": [str(value) for value in range(count)]} for index, count in enumerate(counts)
    ]
    return app(components=list(components), matrix={"parameters": parameters}, **spec)


def _override(name: str) -> Object:
    return {"name": "slow", **AMR_07, "components": [{"name": name, "image": "x"}]}


APP = [
    RuleCase(
        "name length",
        app("n" * 40),
        app("n" * 41),
        "metadata.name has 41 characters; names of children are derived from it, write at most 40",
    ),
    RuleCase(
        "edge ends exist",
        app(edges=[edge("@robot", "driver"), edge("operator", "driver")], robots=AMR_07),
        app(edges=[edge("oprator", "driver")]),
        'edges have unknown ends (topic, from, to): [["/cmd_vel", "oprator", "driver"]]; write the name of a component or @robot',
    ),
    RuleCase(
        "a job completes",
        _after("Complete", job={}),
        _after("Ready", job={}),
        'dependsOn of ["planner"] waits for a job with status: Complete, and for others with status: Ready; write that status, or job: {} in a component that ends (jobs are ["saver"])',
    ),
    RuleCase(
        "what is no job is ready",
        _after("Ready"),
        _after("Complete"),
        'dependsOn of ["planner"] waits for a job with status: Complete, and for others with status: Ready; write that status, or job: {} in a component that ends (jobs are [])',
    ),
    RuleCase(
        "completion takes a job",
        _completion(job={}),
        _completion(),
        "completion is about components that end, and none does (one with schedule comes back); write job: {} in one, or remove completion",
    ),
    RuleCase(
        "a deadline of jobs is above zero",
        app(components=[component("saver", job={})], completion={"deadline": "0h0.01s"}),
        app(components=[component("saver", job={})], completion={"deadline": "0h0s"}),
        "deadline must be above zero, or the instance fails at once; write for example 30m, or leave it out for no limit",
    ),
    RuleCase(
        "completion counts jobs",
        _completion("saver", job={}),
        _completion("planner", job={}),
        'completion.success.components are ["planner"], but the components with job and without schedule are ["saver"]; write the name of one, or job: {} in it',
    ),
    RuleCase(
        "nothing waits for what comes back",
        _after("Complete", job={}),
        _after("Complete", job={}, schedule={"cron": "@daily"}),
        'dependsOn of ["planner"] names a component with schedule (["saver"]), which comes back and is never complete; remove it from dependsOn, or schedule there',
    ),
    RuleCase(
        "what comes back completes nothing",
        _completion(job={}),
        _completion(job={}, schedule={"cron": "@daily"}),
        "completion is about components that end, and none does (one with schedule comes back); write job: {} in one, or remove completion",
    ),
    RuleCase(
        "no sweep of what comes back",
        _sweep(2),
        _sweep(2, components=[component("sim", job={}), component("log", job={}, schedule={"cron": "@daily"})]),
        "an instance of a sweep runs once and ends, and a component with schedule comes back; remove schedule, or matrix",
    ),
    RuleCase(
        "durations in words",
        app(edges=[edge(latency={"budget": "1m30s"})]),
        app(edges=[edge(latency={"budget": "30"})]),
        "write a number and a unit (us, ms, s, m or h), up to three times, for example 30ms, 1.5s or 1m30s",
    ),
    RuleCase(
        "durations that cannot be compared",
        app(edges=[edge(qos={"deadline": "1s", "lease": "1s"}, requestedQos={"deadline": "2s", "lease": "2s"})]),
        app(edges=[edge(qos={"deadline": "soon", "lease": "1s"}, requestedQos={"deadline": "2s", "lease": "long"})]),
        "write a number and a unit (us, ms, s, m or h), up to three times, for example 30ms, 1.5s or 1m30s",
    ),
    RuleCase(
        "components of overrides exist",
        app(robots=AMR_07, overrides=[_override("driver")]),
        app(robots=AMR_07, overrides=[_override("drivr")]),
        'overrides name components that this app does not have: [["drivr"]]; the components are ["operator", "driver"]',
    ),
    RuleCase(
        "overrides need robots",
        app(robots=AMR_07, overrides=[_override("driver")]),
        app(overrides=[_override("driver")]),
        "overrides are for some of the app's robots, and the app has none; write robots.nodeSelector, or the values in the components",
    ),
    RuleCase(
        "a recording records something",
        app(recordings=[_recording("all", names=["/scan"])]),
        app(recordings=[_recording("all", exclude="/scan")]),
        'nothing would be recorded; write names, such as [/scan], or regex, such as "/camera/.*" (".*" for all)',
    ),
    RuleCase(
        "a recording has a name of its own",
        app(recordings=[_recording("all", regex=".*")]),
        app(recordings=[_recording("driver", regex=".*")]),
        'recordings have names of components: ["driver"]; write other names',
    ),
    RuleCase(
        "a sweep has no robots",
        _sweep(2),
        _sweep(2, robots=AMR_07),
        "a sweep has an instance for each combination of values, and robots have one each; remove matrix or robots",
    ),
    RuleCase(
        "instances of a sweep end",
        _sweep(2),
        _sweep(2, components=[component("sim")]),
        "an instance of a sweep ends with its components that have job, and none has it, so later ones would wait for ever; write job: {} where the program ends, and completion: {} if others run on",
    ),
    RuleCase(
        "an instance of a sweep ends with its jobs",
        _sweep(2, components=[component("sim", job={}), component("world")], completion={}),
        _sweep(2, components=[component("sim", job={}), component("world")]),
        "an instance of a sweep would not end, because it has components or recordings that run on; write completion: {} to end it with its jobs",
    ),
    RuleCase(
        "instances of a sweep have domains of their own",
        _sweep(2, ros2={"domain": 7, "isolation": "Discovery", "discovery": {"mode": "Server"}}),
        _sweep(2, ros2={"domain": 7}),
        "one domain for all instances of a sweep would let them obey each other's topics; drop ros2.domain, or write ros2.isolation: Discovery",
    ),
    RuleCase(
        "a sweep has at most 256 instances",
        _sweep(16, 16),
        _sweep(16, 17),
        "a sweep has at most 256 instances, and the values of its parameters have more combinations; write fewer values, or a RobotApp for each part",
    ),
    RuleCase(
        "colocateWith exists",
        _mates(colocateWith=["b"]),
        _mates(colocateWith=["b", "x"]),
        'colocateWith of ["a"] is [["b", "x"]], but the components are ["a", "b", "c"]; write the name of a component',
    ),
    RuleCase(
        "separateFrom exists",
        _mates(separateFrom=["c"]),
        _mates(separateFrom=["x"]),
        'separateFrom of ["a"] is [["x"]], but the components are ["a", "b", "c"]; write the name of a component',
    ),
    RuleCase(
        "sharedData.with exists",
        _mates(sharedData={"with": ["b"], "peerPods": ["x"]}),
        _mates(sharedData={"with": ["x"]}),
        'sharedData.with of ["a"] is [["x"]], but the components are ["a", "b", "c"]; write the name of a component; foreign pods belong in sharedData.peerPods',
    ),
    RuleCase(
        "dependsOn exists",
        _mates(dependsOn=[{"component": "b"}]),
        _mates(dependsOn=[{"component": "b"}, {"component": "x"}]),
        'dependsOn of ["a"] names no component of this app; components are ["a", "b", "c"]',
    ),
    RuleCase(
        "the other side does not separate",
        app(components=[component("a", colocateWith=["b"]), component("b", separateFrom=["c"]), component("c")]),
        app(components=[component("a", colocateWith=["b"]), component("b", separateFrom=["a"])]),
        'colocateWith of ["a"] contradicts separateFrom of the component it names; remove one of the two names',
    ),
    RuleCase(
        "@robot needs robots",
        app(edges=[edge("operator", "@robot")], robots=AMR_07),
        app(edges=[edge("operator", "@robot")]),
        "an edge to @robot needs a robot; write robots.nodeSelector, or the name of a component in place of @robot",
    ),
    RuleCase(
        "one domain is not for every robot",
        app(ros2={"domain": 7}, robots={**AMR_07, "assignment": "Any"}),
        app(ros2={"domain": 7}, robots=AMR_07),
        "domain 7 for every robot would let all of them obey one /cmd_vel; drop ros2.domain, or write robots.assignment: Any or ros2.isolation: Discovery",
    ),
    RuleCase(
        "a selector chooses",
        app(robots=AMR_07),
        _selector(),
        "an empty selector would choose every node; write matchLabels, for example robotics.io/robot: amr-07",
    ),
    RuleCase(
        "label keys of a selector",
        _selector(matchLabels={"robotics.io/robot": "amr-07", "tier": "edge"}),
        _selector(matchLabels={"robotics.io/": "amr-07"}),
        "a key is no label key; write for example robotics.io/robot",
    ),
    RuleCase(
        "In needs values",
        _selector(matchExpressions=[{"key": "robotics.io/robot", "operator": "In", "values": ["amr-07"]}]),
        _selector(matchExpressions=[{"key": "robotics.io/robot", "operator": "In"}]),
        "In and NotIn need values, Exists and DoesNotExist take none",
    ),
    RuleCase(
        "two ends",
        app(edges=[edge()]),
        app(edges=[edge("driver", "driver")]),
        "edge /cmd_vel: from and to are both driver; write another component in one of them, or drop the edge",
    ),
    RuleCase(
        "a budget is positive",
        app(edges=[edge(latency={"budget": "30ms"})]),
        app(edges=[edge(latency={"budget": "0ms"})]),
        "budget must be above zero; write for example 30ms",
    ),
    RuleCase(
        "reliability",
        _pair({"reliability": "reliable"}, {"reliability": "best_effort"}),
        _pair({"reliability": "best_effort"}, {"reliability": "reliable"}),
        "edge /cmd_vel: reliability best_effort is offered but reliable is asked, so DDS refuses the pair; write qos.reliability: reliable or requestedQos.reliability: best_effort",
    ),
    RuleCase(
        "durability",
        _pair({"durability": "transient_local"}, {"durability": "volatile"}),
        _pair({"durability": "volatile"}, {"durability": "transient_local"}),
        "edge /cmd_vel: durability volatile is offered but transient_local is asked, so DDS refuses the pair; write qos.durability: transient_local or requestedQos.durability: volatile",
    ),
    RuleCase(
        "liveliness",
        _pair({"liveliness": "manual_by_topic"}, {"liveliness": "automatic"}),
        _pair({"liveliness": "automatic"}, {"liveliness": "manual_by_topic"}),
        "edge /cmd_vel: liveliness automatic is offered but manual_by_topic is asked, so DDS refuses the pair; write qos.liveliness: manual_by_topic or requestedQos.liveliness: automatic",
    ),
    RuleCase(
        "deadline",
        _pair({"deadline": "50ms"}, {"deadline": "0.05s"}),
        _pair({"deadline": "50ms"}, {"deadline": "20ms"}),
        "edge /cmd_vel: deadline 50ms is offered but 20ms is asked, so DDS refuses the pair; write a shorter qos.deadline or a longer requestedQos.deadline",
    ),
    RuleCase(
        "lease",
        _pair({"lease": "1s"}, {"reliability": "reliable"}),
        _pair({"lease": "1s"}, {"lease": "500ms"}),
        "edge /cmd_vel: lease 1s is offered but 500ms is asked, so DDS refuses the pair; write a shorter qos.lease or a longer requestedQos.lease",
    ),
    RuleCase(
        "unsafe domains",
        app(ros2={"domain": 150, "allowUnsafeDomain": True}),
        app(ros2={"domain": 150}),
        "domain 150 is unsafe: 0 is what everybody uses by default and 102-214 meet Linux ephemeral ports; write 1-101 or 215-232, leave domain out, or write allowUnsafeDomain: true",
    ),
    RuleCase(
        "domain 0",
        app(ros2={"domain": 232}),
        app(ros2={"domain": 0}),
        "write 1-101 or 215-232, leave domain out, or write allowUnsafeDomain: true",
    ),
    RuleCase(
        "discovery separates nobody on multicast",
        app(ros2={"isolation": "Discovery"}),
        app(ros2={"isolation": "Discovery", "discovery": {"mode": "Multicast"}}),
        "isolation Discovery shares a domain, and with Multicast everybody on it hears everybody; write discovery.mode: Auto, Server, Peers or Router, or isolation: Domain",
    ),
    RuleCase(
        "an external master has an address",
        app(ros1={"master": "External", "uri": "http://master.default.svc:11311"}),
        app(ros1={"master": "External"}),
        "an External master needs its address; write uri, for example http://master.default.svc:11311",
    ),
    RuleCase(
        "the address of an external master begins with http://",
        app(ros1={"master": "External", "uri": "http://master.example:11311"}),
        app(ros1={"master": "External", "uri": "master.example:11311"}),
        "uri master.example:11311 does not begin with http://; write for example http://master.default.svc:11311",
    ),
    RuleCase(
        "a managed master has none",
        app(ros1={"master": "Managed"}),
        app(ros1={"uri": "http://master.default.svc:11311"}),
        "uri is the address of an External master; drop uri, or write master: External",
    ),
]
