"""Hypothesis strategies for clusters and pods as JSON, small worlds in which rules meet each other."""

from typing import Any

from hypothesis import strategies as st
from tests.support.scheduling import node_json, pod_json

Json = dict[str, Any]

NAMES = ("n0", "n1", "n2", "n3", "n4", "n5")
KEYS = ("zone", "disk", "rank")
VALUES = ("a", "b", "1", "2", "10", "x7")
TAINTS = st.fixed_dictionaries(
    {
        "key": st.sampled_from(("k1", "k2", "node.kubernetes.io/unschedulable")),
        "value": st.sampled_from(("", "v")),
        "effect": st.sampled_from(("NoSchedule", "PreferNoSchedule", "NoExecute")),
    }
)
TOLERATIONS = st.one_of(
    st.just({"operator": "Exists"}),
    st.fixed_dictionaries(
        {
            "key": st.sampled_from(("k1", "k2", "node.kubernetes.io/unschedulable")),
            "operator": st.sampled_from(("", "Equal", "Exists", "Gt")),
            "value": st.sampled_from(("", "v")),
            "effect": st.sampled_from(("", "NoSchedule", "PreferNoSchedule", "NoExecute")),
        }
    ),
)
CPU = st.sampled_from(("0", "1m", "100m", "250m", "0.5", "1", "2", "3900m"))
MEMORY = st.sampled_from(("0", "1", "64Mi", "128Mi", "1Gi", "3Gi", "1500M", "7.5Gi"))
EXTENDED = ("nvidia.com/gpu", "ephemeral-storage", "hugepages-2Mi")


@st.composite
def resource_lists(draw: st.DrawFn) -> dict[str, str]:
    found: dict[str, str] = {}
    if draw(st.booleans()):
        found["cpu"] = draw(CPU)
    if draw(st.booleans()):
        found["memory"] = draw(MEMORY)
    if draw(st.integers(0, 4)) == 0:
        found[draw(st.sampled_from(EXTENDED))] = draw(st.sampled_from(("1", "2", "4Mi")))
    return found


@st.composite
def nodes(draw: st.DrawFn) -> list[Json]:
    count = draw(st.integers(1, 6))
    return [_node(draw, name) for name in NAMES[:count]]


def _node(draw: st.DrawFn, name: str) -> Json:
    labels = draw(st.dictionaries(st.sampled_from(KEYS), st.sampled_from(VALUES), max_size=3))
    extended = draw(st.dictionaries(st.sampled_from(EXTENDED), st.sampled_from(("0", "1", "8Mi")), max_size=2))
    raw = node_json(
        name,
        labels=labels,
        cpu=draw(st.sampled_from(("0", "1", "2", "4", "7"))),
        memory=draw(st.sampled_from(("0", "1Gi", "2Gi", "8Gi", "9000000001"))),
        pods=draw(st.sampled_from(("0", "1", "3", "110"))),
        taints=draw(st.lists(TAINTS, max_size=2)),
        unschedulable=draw(st.integers(0, 5)) == 0,
    )
    raw["status"]["allocatable"].update(extended)
    return raw


def requirements(*, valid_only: bool) -> st.SearchStrategy[Json]:
    plain = st.one_of(
        st.fixed_dictionaries(
            {
                "key": st.sampled_from(KEYS),
                "operator": st.sampled_from(("In", "NotIn")),
                "values": st.lists(st.sampled_from(VALUES), min_size=1, max_size=3),
            }
        ),
        st.fixed_dictionaries({"key": st.sampled_from(KEYS), "operator": st.sampled_from(("Exists", "DoesNotExist"))}),
        st.fixed_dictionaries(
            {
                "key": st.sampled_from(KEYS),
                "operator": st.sampled_from(("Gt", "Lt")),
                "values": st.lists(st.sampled_from(("1", "2", "-3", "007")), min_size=1, max_size=1),
            }
        ),
    )
    if valid_only:
        return plain
    broken = st.sampled_from(
        (
            {"key": "zone", "operator": "In", "values": []},
            {"key": "rank", "operator": "Gt", "values": ["many"]},
            {"key": "rank", "operator": "Exists", "values": ["a"]},
        )
    )
    return st.one_of(plain, plain, plain, broken)


FIELDS = st.fixed_dictionaries(
    {
        "key": st.just("metadata.name"),
        "operator": st.sampled_from(("In", "In", "NotIn")),
        "values": st.lists(st.sampled_from((*NAMES, "elsewhere")), min_size=1, max_size=1),
    }
)


@st.composite
def terms(draw: st.DrawFn, *, valid_only: bool = False) -> Json:
    term: Json = {}
    expressions = draw(st.lists(requirements(valid_only=valid_only), max_size=2))
    if expressions:
        term["matchExpressions"] = expressions
    fields = draw(st.lists(FIELDS, max_size=2)) if draw(st.integers(0, 3)) == 0 else []
    if fields:
        term["matchFields"] = fields
    return term


@st.composite
def affinities(draw: st.DrawFn) -> Json:
    found: Json = {}
    if draw(st.booleans()):
        found["requiredDuringSchedulingIgnoredDuringExecution"] = {
            "nodeSelectorTerms": draw(st.lists(terms(), min_size=1, max_size=3))
        }
    if draw(st.booleans()):
        valid_only = draw(st.integers(0, 9)) > 0
        found["preferredDuringSchedulingIgnoredDuringExecution"] = [
            {"weight": draw(st.integers(0, 100)), "preference": draw(terms(valid_only=valid_only))}
            for _ in range(draw(st.integers(1, 3)))
        ]
    return found


PORTS = st.fixed_dictionaries(
    {
        "containerPort": st.just(7400),
        "hostPort": st.sampled_from((0, 7400, 7401)),
        "hostIP": st.sampled_from(("", "0.0.0.0", "10.0.0.1", "10.0.0.2")),  # noqa: S104 - a value of the API
        "protocol": st.sampled_from(("TCP", "UDP")),
    }
)


@st.composite
def containers(draw: st.DrawFn, *, init: bool = False) -> Json:
    container: Json = {"name": "c", "resources": {"requests": draw(resource_lists())}}
    if draw(st.integers(0, 4)) == 0:
        container["ports"] = draw(st.lists(PORTS, max_size=2))
    if init and draw(st.booleans()):
        container["restartPolicy"] = "Always"
    return container


@st.composite
def pods(draw: st.DrawFn, name: str = "p", *, node: str = "") -> Json:
    raw = pod_json(name, node=node)
    spec = raw["spec"]
    spec["containers"] = draw(st.lists(containers(), min_size=1, max_size=2))
    if draw(st.integers(0, 3)) == 0:
        spec["initContainers"] = draw(st.lists(containers(init=True), max_size=3))
    if draw(st.integers(0, 5)) == 0:
        spec["overhead"] = {"cpu": "10m", "memory": "1Mi"}
    if draw(st.integers(0, 5)) == 0:
        spec["resources"] = {"requests": draw(resource_lists())}
    if not node:
        spec["tolerations"] = draw(st.lists(TOLERATIONS, max_size=2))
        if draw(st.integers(0, 3)) == 0:
            spec["nodeSelector"] = draw(st.dictionaries(st.sampled_from(KEYS), st.sampled_from(VALUES), max_size=2))
        if draw(st.booleans()):
            spec["affinity"] = {"nodeAffinity": draw(affinities())}
    return raw


@st.composite
def worlds(draw: st.DrawFn) -> tuple[list[Json], list[Json], Json]:
    """(nodes, placed pods, the pod to place)."""
    all_nodes = draw(nodes())
    names = [node["metadata"]["name"] for node in all_nodes]
    placed = [draw(pods(f"old{i}", node=draw(st.sampled_from(names)))) for i in range(draw(st.integers(0, 6)))]
    return all_nodes, placed, draw(pods())
