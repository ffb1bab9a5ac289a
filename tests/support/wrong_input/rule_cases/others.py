"""Rules of RobotClaim, DomainPool and RobotAppInstance."""

from tests.support.apiobjects import claim, device, domain, holder, instance, pool
from tests.support.wrong_input.rule_cases.case import Object, RuleCase

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


def _edge(p95: str) -> Object:
    return {"edges": [{"topic": "/cmd_vel", "from": "operator", "to": "driver", "budget": "30ms", "p95": p95}]}


INSTANCE = [
    RuleCase(
        "an instance stays what it is",
        instance("rules-amr-07"),
        instance("rules-amr-07", robot="amr-08"),
        "an instance never becomes another one; the operator deletes this object and creates a new one",
        before=instance("rules-amr-07"),
    ),
    RuleCase(
        "round-trip times in words",
        {**instance("rules-amr-07"), "status": _edge("18ms")},
        {**instance("rules-amr-07"), "status": _edge("18")},
        "write a number and a unit (us, ms, s, m or h), up to three times, for example 30ms, 1.5s or 1m30s",
        before=instance("rules-amr-07"),
    ),
]
