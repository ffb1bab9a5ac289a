"""The JSON of a spec with each replica that has an ordinal as a component of its own."""

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.replicas import MOST_COMPONENTS, Json, expand_replicas, is_replica_name, list_replicas

COUNTS = st.integers(0, 40)
NAMES = st.sampled_from(["a", "b", "a-1", "c-x"])


@st.composite
def specs(draw: st.DrawFn) -> Json:
    names = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    components = [
        {"name": name, "replicas": draw(COUNTS), "replicaIdentity": draw(st.sampled_from(["None", "Ordinal"]))}
        for name in names
    ]
    edges = [
        {"topic": "/t", "from": draw(st.sampled_from(names)), "to": draw(st.sampled_from([*names, "@robot"]))}
        for _ in range(draw(st.integers(0, 3)))
    ]
    return {"components": components, "edges": edges}


@given(specs())
def test_a_spec_has_a_component_per_replica_or_stays_as_it_is(spec: Json) -> None:
    replicas = list_replicas(spec["components"])
    pods = sum(len(replicas.get(part["name"], " ")) for part in spec["components"])
    expanded = expand_replicas(spec)
    ordinals = {name: [replica.ordinal for replica in group] for name, group in replicas.items()}
    counts = {part["name"]: max(1, part["replicas"]) for part in spec["components"]}
    assert ordinals == {name: list(range(counts[name])) for name in replicas}
    if expanded is spec:
        edges = sum(len(replicas.get(edge["from"], " ")) * len(replicas.get(edge["to"], " ")) for edge in spec["edges"])
        assert not replicas or pods > MOST_COMPONENTS or edges > 256
        return
    assert len(expanded["components"]) == pods
    assert not any(part.get("replicaIdentity") == "Ordinal" for part in expanded["components"])
    names = {part["name"] for part in expanded["components"]} | {"@robot"}
    assert {edge[end] for edge in expanded["edges"] for end in ("from", "to")} <= names
    assert expand_replicas(expanded) is expanded


@given(st.integers(0, 30), st.integers(0, 30))
def test_replicas_that_stay_keep_their_names(before: int, after: int) -> None:
    def list_names(count: int) -> list[str]:
        part = {"name": "a", "replicas": count, "replicaIdentity": "Ordinal"}
        return [item["name"] for item in expand_replicas({"components": [part]})["components"]]

    fewer, more = sorted((list_names(before), list_names(after)), key=len)
    assert more[: len(fewer)] == fewer
    assert all(is_replica_name(name, "a") for name in more)


def test_a_number_without_bound_costs_nothing() -> None:
    spec = {"components": [{"name": "a", "replicas": 10**12, "replicaIdentity": "Ordinal"}]}
    assert expand_replicas(spec) is spec


def test_only_a_number_after_the_name_makes_the_name_of_a_replica() -> None:
    assert is_replica_name("a-0", "a")
    assert not any(is_replica_name(name, "a") for name in ("a", "a-", "a-01", "a-x", "ab-0", "a-0-0"))
