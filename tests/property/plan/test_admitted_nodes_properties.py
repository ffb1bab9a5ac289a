"""For random fleets and pods: no closed node is left to a pod, and none of the others is lost without need."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import make_node

from robotapp_operator.plan.render.admitted_nodes import admitted_nodes, is_outdated, reach_of

NAMES = [f"n{number}" for number in range(6)]
VALUES = st.sampled_from(["a", "b"])
KEYS = st.sampled_from(["robotics.io/robot", "robotics.io/tier"])
REQUIREMENTS = st.one_of(
    st.builds(lambda key, values: {"key": key, "operator": "In", "values": sorted(values)}, KEYS, st.sets(VALUES, min_size=1)),
    st.builds(lambda key, values: {"key": key, "operator": "NotIn", "values": sorted(values)}, KEYS, st.sets(VALUES, min_size=1)),
    st.builds(lambda key, operator: {"key": key, "operator": operator}, KEYS, st.sampled_from(["Exists", "DoesNotExist"])),
)  # fmt: skip
FIELDS = st.builds(
    lambda name: {"key": "metadata.name", "operator": "In", "values": [name]}, st.sampled_from([*NAMES, "gone"])
)
TERMS = st.lists(
    st.fixed_dictionaries({}, optional={"matchExpressions": st.lists(REQUIREMENTS, min_size=1, max_size=2), "matchFields": st.lists(FIELDS, min_size=1, max_size=1)}),
    max_size=3,
)  # fmt: skip
LABELS = st.fixed_dictionaries({}, optional={"robot": VALUES, "tier": VALUES})


def spec_of(terms: list[dict[str, Any]], selector: dict[str, str]) -> dict[str, Any]:
    required = {"requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": terms}}
    return {"nodeSelector": selector} | ({"affinity": {"nodeAffinity": required}} if terms else {})


@given(
    st.fixed_dictionaries({}, optional=dict.fromkeys(NAMES, LABELS)),
    st.frozensets(st.sampled_from(NAMES)),
    TERMS,
    st.dictionaries(KEYS, VALUES, max_size=1),
)
def test_a_pod_that_is_let_go_reaches_exactly_its_nodes_that_are_not_closed(
    labels: dict[str, dict[str, str]], shut: frozenset[str], terms: list[dict[str, Any]], selector: dict[str, str]
) -> None:
    nodes = {name: make_node(name, hostname=f"h-{name}", **found) for name, found in labels.items()}
    closed = shut & nodes.keys()
    spec = spec_of(terms, selector)
    before = reach_of(spec, nodes)
    found = admitted_nodes(spec, nodes, closed)
    if not found.allowed:
        assert closed
        assert not before - closed
        return
    after = spec | found.patch
    assert reach_of(after, nodes) == before - closed
    assert not is_outdated(after, found.mark, nodes, closed, reach=lambda each: reach_of(each, nodes))
    opened = is_outdated(after, found.mark, nodes, frozenset(), reach=lambda each: reach_of(each, nodes))
    assert opened == bool(before & closed), "what was excluded is missed when it opens, and nothing else is"
    if found.patch and terms:  # what the API server allows; a pod without terms may get any
        written = found.patch["affinity"]["nodeAffinity"]["requiredDuringSchedulingIgnoredDuringExecution"]
        for old, new in zip(terms, written["nodeSelectorTerms"], strict=True):
            kept = old.get("matchExpressions", [])
            assert new.get("matchExpressions", [])[: len(kept)] == kept
            assert new.get("matchFields") == old.get("matchFields")


@given(
    st.fixed_dictionaries({}, optional=dict.fromkeys(NAMES, LABELS)),
    st.frozensets(st.sampled_from(NAMES)),
    st.sets(st.sampled_from(NAMES)),
    TERMS,
)
def test_whatever_host_names_nodes_have_a_pod_is_let_go_where_one_is_left_and_reaches_no_closed_one(
    labels: dict[str, dict[str, str]], shut: frozenset[str], nameless: set[str], terms: list[dict[str, Any]]
) -> None:
    nodes = {
        name: make_node(
            name, **found, **({} if name in nameless else {"hostname": "same" if name < "n2" else name[1:]})
        )
        for name, found in labels.items()
    }
    closed = shut & nodes.keys()
    spec = spec_of(terms, {})
    before = reach_of(spec, nodes)
    found = admitted_nodes(spec, nodes, closed)
    assert found.allowed == (not closed or bool(before - closed))
    after = reach_of(spec | found.patch, nodes)
    assert bool(after - closed) == bool(before - closed) or not found.allowed
    assert not found.allowed or after <= before - closed
    assert (
        not is_outdated(spec | found.patch, found.mark, nodes, closed, reach=lambda each: reach_of(each, nodes))
        or not found.allowed
    )
