"""One or more cases for every CEL rule: an object the rule accepts, one it refuses, and what it says then.

Evaluated twice: by a CEL library in unit tests and by the real API server in integration tests.
"""

from dataclasses import dataclass
from typing import Any

from tests.support.apiobjects import AMR_07, app, claim, component, device, domain, edge, holder, pool

Object = dict[str, Any]


@dataclass(frozen=True)
class RuleCase:
    """`says` is the end of the message a user reads. For rules about changes, `before` is the stored object."""

    name: str
    good: Object
    bad: Object
    says: str
    before: Object | None = None

    def __str__(self) -> str:
        return self.name


def _pair(offered: Object, asked: Object) -> Object:
    return app(edges=[edge(qos=offered, requestedQos=asked)])


def _mates(**fields: Any) -> Object:
    return app(components=[component("a", **fields), component("b"), component("c")])


def _ready(**fields: Any) -> Object:
    return app(components=[component(ready=fields)])


def _selector(**fields: Any) -> Object:
    return app(robots={"selector": fields})


ROBOTAPP = [
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
        "colocateWith exists",
        _mates(colocateWith=["b"]),
        _mates(colocateWith=["b", "x"]),
        'colocateWith names ["x"], but no component has that name; write the name of a component',
    ),
    RuleCase(
        "separateFrom exists",
        _mates(separateFrom=["c"]),
        _mates(separateFrom=["x"]),
        'separateFrom names ["x"], but no component has that name; write the name of a component',
    ),
    RuleCase(
        "sharedData.with exists",
        _mates(sharedData={"with": ["b"], "peerPods": ["x"]}),
        _mates(sharedData={"with": ["x"]}),
        'sharedData.with names ["x"], but no component has that name; write the name of a component; foreign pods belong in sharedData.peerPods',
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
        "an edge to @robot needs a robot; write robots.selector, or the name of a component in place of @robot",
    ),
    RuleCase(
        "one domain is not for every robot",
        app(dds={"domain": 7}, robots={**AMR_07, "instances": "Any"}),
        app(dds={"domain": 7}, robots=AMR_07),
        "domain 7 for every robot would let all of them obey one /cmd_vel; drop dds.domain, or write robots.instances: Any or dds.isolation: Discovery",
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
        app(components=[component(replicas=2, devices=[{"name": "cam", "type": "usb", "exclusive": False}])]),
        app(components=[component(replicas=2, devices=[{"name": "cam", "type": "usb"}])]),
        "component driver: 2 replicas cannot share the exclusive device cam; write replicas: 1, or exclusive: false on the device",
    ),
    RuleCase(
        "the domain is not set by hand",
        app(components=[component(env=[{"name": "RCUTILS_COLORIZED_OUTPUT", "value": "1"}])]),
        app(components=[component(env=[{"name": "ROS_DOMAIN_ID", "value": "7"}])]),
        "component driver: ROS_DOMAIN_ID is set by the operator from the claimed domain; drop it from env and write spec.dds.domain if you need a certain number",
    ),
    RuleCase(
        "one readiness check",
        _ready(topic="/odom"),
        _ready(topic="/odom", lifecycle="Active"),
        "write exactly one of topic, lifecycle, exec, httpGet, tcpSocket",
    ),
    RuleCase(
        "minHz is of a topic",
        _ready(topic="/odom", minHz=20),
        _ready(lifecycle="Active", minHz=20),
        "minHz is the rate of a topic; write topic too, or drop minHz",
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
        app(dds={"domain": 150, "allowUnsafeDomain": True}),
        app(dds={"domain": 150}),
        "domain 150 is unsafe: 0 is what everybody uses by default and 102-214 meet Linux ephemeral ports; write 1-101 or 215-232, leave domain out, or write allowUnsafeDomain: true",
    ),
    RuleCase(
        "domain 0",
        app(dds={"domain": 232}),
        app(dds={"domain": 0}),
        "write 1-101 or 215-232, leave domain out, or write allowUnsafeDomain: true",
    ),
    RuleCase(
        "discovery separates nobody on multicast",
        app(dds={"isolation": "Discovery"}),
        app(dds={"isolation": "Discovery", "discovery": {"mode": "Multicast"}}),
        "isolation Discovery shares a domain, and with Multicast everybody on it hears everybody; write discovery.mode: Auto, Server, Peers or Router, or isolation: Domain",
    ),
    RuleCase(
        "host network",
        app(dds={"network": "Pod"}),
        app(dds={"network": "Host"}),
        "network Host is refused until a privilege class for it exists; write network: Pod",
    ),
    RuleCase(
        "an external master has an address",
        app(ros1={"master": "External", "uri": "http://master.default.svc:11311"}),
        app(ros1={"master": "External"}),
        "an External master needs its address; write uri, for example http://master.default.svc:11311",
    ),
    RuleCase(
        "a managed master has none",
        app(ros1={"master": "Managed"}),
        app(ros1={"uri": "http://master.default.svc:11311"}),
        "uri is the address of an External master; drop uri, or write master: External",
    ),
]

CLAIM_NAME = "the name is the lock: write metadata.name dds.<pool>.<c, n<hash> or z<hash>>.<id> as spec.domain says, for example dds.default.c.7"
DEVICE_NAME = "the name is the lock: write metadata.name dev.n<hash of the node>.<id> as spec.device says, for example dev.n0123456789.can-can0"
ON_NODE = domain(scope="Node", scopeValue="amr-07")

RULES_CLAIM = claim("dds.rules.c.7", domain=domain(pool="rules"))
"""In a pool of its own, because it is really stored on a control plane that others use too."""

CLAIM = [
    RuleCase("the id is in the name", claim(), claim("dds.default.c.8"), CLAIM_NAME),
    RuleCase("the pool is in the name", claim("dds.p.c.7", domain=domain(pool="p")), claim("dds.p.c.7"), CLAIM_NAME),
    RuleCase(
        "the scope is in the name",
        claim("dds.default.n0123456789.7", domain=ON_NODE),
        claim("dds.default.z0123456789.7", domain=ON_NODE),
        CLAIM_NAME,
    ),
    RuleCase(
        "ids have no leading zeros",
        claim("dds.default.c.0", domain=domain(id=0)),
        claim("dds.default.c.07"),
        CLAIM_NAME,
    ),
    RuleCase(
        "devices by their name",
        claim("dev.n0123456789.can-can0", device=device()),
        claim("dev.n0123456789.can-can1", device=device()),
        DEVICE_NAME,
    ),
    RuleCase(
        "a device has no domain's name",
        claim("dev.n0123456789.can-can0", device=device()),
        claim("dds.default.c.7", device=device()),
        DEVICE_NAME,
    ),
    RuleCase(
        "a scope has a value",
        claim("dds.default.n0123456789.7", domain=ON_NODE),
        claim("dds.default.n0123456789.7", domain=domain(scope="Node")),
        "scopeValue names the zone or node; write it for scope Zone and Node, and leave it empty for Cluster",
    ),
    RuleCase("one thing", claim(), claim(domain=domain(), device=device()), "write exactly one of domain and device"),
    RuleCase(
        "immutable",
        RULES_CLAIM,
        {**RULES_CLAIM, "spec": {**RULES_CLAIM["spec"], "holder": holder(uid="u-2")}},
        "a claim never changes its thing or its holder; delete it and create another",
        before=RULES_CLAIM,
    ),
]

POOL = [
    RuleCase(
        "pool name",
        pool("p" * 40),
        pool("site.a"),
        "names of claims contain the pool's name; write a DNS label of at most 40 characters, for example default",
    ),
    RuleCase(
        "ids ascend",
        pool(ids="1-5,6,7-9"),
        pool(ids="1-5,5-9"),
        "ids must be ascending ranges without overlap, up to 232; write for example 1-101,215-232",
    ),
    RuleCase(
        "a range ascends",
        pool(ids="5-5"),
        pool(ids="9-5"),
        "ids must be ascending ranges without overlap, up to 232; write for example 1-101,215-232",
    ),
    RuleCase(
        "ids end at 232",
        pool(ids="215-232"),
        pool(ids="215-233"),
        "ids must be ascending ranges without overlap, up to 232; write for example 1-101,215-232",
    ),
    RuleCase(
        "shared ids ascend",
        pool(ids="1-89", sharedIds="90-101"),
        pool(ids="", sharedIds="90,80"),
        "sharedIds must be ascending ranges without overlap, up to 232; write for example 90-101",
    ),
    RuleCase(
        "an id is claimed or shared",
        pool(ids="1-89,215-232", sharedIds="90-101"),
        pool(ids="1-90", sharedIds="90-101"),
        "ids 1-90 and sharedIds 90-101 overlap, but an id is either claimed or shared; take the common ones out of one of them",
    ),
    RuleCase(
        "the scope stays",
        pool("rules"),
        pool("rules", scope="Node"),
        "scope cannot change, because claims are named after it; create another pool",
        before=pool("rules"),
    ),
    RuleCase(
        "quotas are of namespaces",
        pool(quota={"namespaces": {"team-a": 3}}),
        pool(quota={"namespaces": {"Team A": 3}}),
        "keys must be names of namespaces, for example team-a: 10",
    ),
]

CASES = {"RobotApp": ROBOTAPP, "RobotClaim": CLAIM, "DomainPool": POOL}
