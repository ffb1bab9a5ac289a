"""Hypothesis strategies for clusters in which pods spread, attract and repel each other, odd labels included."""

from typing import Any

from hypothesis import strategies as st
from tests.support.scheduling import node_json, pod_json

from campaigns.cluster_cases.case import admitted
from campaigns.reference_scheduler import ClusterDump

Json = dict[str, Any]
NAMES = ("n0", "n1", "n2", "n3", "n4", "n5")
REQUIRED = "requiredDuringSchedulingIgnoredDuringExecution"
PREFERRED = "preferredDuringSchedulingIgnoredDuringExecution"
ZONE = "topology.kubernetes.io/zone"
KEYS = (ZONE, ZONE, "kubernetes.io/hostname", "rack")
SPACES = ("default", "default", "other", "third")
APPS = ("web", "db")
TAINT = {"key": "k", "value": "", "effect": "NoSchedule"}

SELECTORS = st.one_of(
    st.sampled_from(APPS).map(lambda app: {"matchLabels": {"app": app}}),
    st.just({"matchExpressions": [{"key": "app", "operator": "In", "values": ["web", "db"]}]}),
    st.just({"matchExpressions": [{"key": "tier", "operator": "DoesNotExist"}]}),
    st.just(
        {"matchLabels": {"app": "web"}, "matchExpressions": [{"key": "tier", "operator": "NotIn", "values": ["b"]}]}
    ),
    st.just({}),
    st.none(),
)
LABELS = st.fixed_dictionaries({}, optional={"app": st.sampled_from(APPS), "tier": st.sampled_from(("a", "b"))})


@st.composite
def nodes(draw: st.DrawFn, name: str) -> Json:
    labels = {}
    if draw(st.integers(0, 4)):
        labels[ZONE] = draw(st.sampled_from(("z1", "z2", "z3", "")))
    if draw(st.booleans()):
        labels["rack"] = draw(st.sampled_from(("r1", "r2")))
    raw = node_json(name, labels=labels, taints=[TAINT] if draw(st.integers(0, 4)) == 0 else [])
    if draw(st.integers(0, 5)) == 0:
        del raw["metadata"]["labels"]["kubernetes.io/hostname"]
    return raw


@st.composite
def constraints(draw: st.DrawFn) -> Json:
    found: Json = {
        "topologyKey": draw(st.sampled_from(KEYS)),
        "whenUnsatisfiable": draw(st.sampled_from(("DoNotSchedule", "ScheduleAnyway"))),
        "maxSkew": draw(st.integers(1, 3)),
        "labelSelector": draw(SELECTORS),
    }
    if draw(st.booleans()):
        found["minDomains"] = draw(st.integers(1, 4))
    if draw(st.integers(0, 3)) == 0:
        found["matchLabelKeys"] = ["tier"]
    for policy in ("nodeAffinityPolicy", "nodeTaintsPolicy"):
        if draw(st.integers(0, 2)) == 0:
            found[policy] = draw(st.sampled_from(("Honor", "Ignore")))
    return found


@st.composite
def terms(draw: st.DrawFn) -> Json:
    found: Json = {"topologyKey": draw(st.sampled_from(KEYS)), "labelSelector": draw(SELECTORS)}
    if draw(st.integers(0, 2)) == 0:
        found["namespaces"] = draw(st.lists(st.sampled_from(("default", "other", "third")), max_size=2))
    if draw(st.integers(0, 2)) == 0:
        found["namespaceSelector"] = draw(
            st.sampled_from(
                (
                    {},
                    {"matchLabels": {"team": "b"}},
                    {"matchExpressions": [{"key": "team", "operator": "DoesNotExist"}]},
                )
            )
        )
    return found


@st.composite
def affinities(draw: st.DrawFn) -> Json:
    found: Json = {}
    for side in ("podAffinity", "podAntiAffinity"):
        rules: Json = {}
        if draw(st.integers(0, 2)) == 0:
            rules[REQUIRED] = draw(st.lists(terms(), min_size=1, max_size=2))
        if draw(st.integers(0, 2)) == 0:
            rules[PREFERRED] = [
                {"weight": draw(st.integers(1, 100)), "podAffinityTerm": draw(terms())}
                for _ in range(draw(st.integers(1, 2)))
            ]
        if rules:
            found[side] = rules
    return found


@st.composite
def pods(draw: st.DrawFn, name: str, *, node: str = "") -> Json:
    raw = pod_json(name, node=node, cpu=None, memory=None, labels=draw(LABELS), namespace=draw(st.sampled_from(SPACES)))
    if draw(st.booleans()):
        raw["spec"]["affinity"] = draw(affinities())
    if not node:
        raw["spec"]["topologySpreadConstraints"] = draw(st.lists(constraints(), max_size=2))
        if draw(st.integers(0, 3)) == 0:
            raw["spec"]["nodeSelector"] = {"rack": "r1"}
        if draw(st.integers(0, 3)) == 0:
            raw["spec"]["tolerations"] = [{"key": "k", "operator": "Exists"}]
    elif draw(st.integers(0, 5)) == 0:
        raw["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    raw["spec"]["containers"] = [{"name": "main", "image": "pause"}]
    return admitted(raw)


def namespace(name: str, team: str = "") -> Json:
    return {"kind": "Namespace", "metadata": {"name": name, "labels": {"team": team} if team else {}}}


@st.composite
def services(draw: st.DrawFn, name: str) -> Json:
    selector = draw(st.sampled_from(({"app": "web"}, {"tier": "a"}, {"app": "web", "tier": "a"})))
    meta = {"name": name, "namespace": draw(st.sampled_from(("default", "other")))}
    return {"kind": "Service", "metadata": meta, "spec": {"selector": selector}}


@st.composite
def worlds(draw: st.DrawFn) -> tuple[ClusterDump, Json]:
    """A cluster and the pod to place."""
    names = NAMES[: draw(st.integers(1, 6))]
    placed = [draw(pods(f"old{i}", node=draw(st.sampled_from(names)))) for i in range(draw(st.integers(0, 8)))]
    dump = ClusterDump(
        nodes=[draw(nodes(name)) for name in names],
        pods=placed,
        namespaces=[namespace("default", "a"), namespace("other", "b"), namespace("third")],
        services=[draw(services(f"s{i}")) for i in range(draw(st.integers(0, 2)))],
    )
    return dump, draw(pods("p"))
