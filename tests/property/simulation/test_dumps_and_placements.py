"""Laws of dumps and simulations, whatever is in them."""

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduling import node_json, pod_json

from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.simulation.dump import DumpError, Reader, encode
from robotapp_scheduler.simulation.run import Outcome, simulate
from robotapp_scheduler.watch.routes import kinds, resources

CONFIG = configuration.built_in(catalogue())
VERSIONS = {resource.kind: resource.api_version for resource in resources()}
CPU = st.sampled_from(("100m", "500m", "1", "2500m", "9"))


@st.composite
def clusters(draw: st.DrawFn) -> list[Any]:
    nodes = [
        {"kind": "Node", **node_json(f"n{at}", cpu=draw(CPU), unschedulable=draw(st.booleans()))}
        for at in range(draw(st.integers(0, 5)))
    ]
    names = [node["metadata"]["name"] for node in nodes]
    pods = [
        {
            "kind": "Pod",
            **pod_json(
                f"p{at}",
                cpu=draw(CPU),
                node=draw(st.sampled_from(["", "", "", *names])),
                priority=draw(st.integers(0, 2)),
                scheduler=draw(st.sampled_from(("ros-aware-scheduler", "kubernetes-scheduler", "default-scheduler"))),
            ),
        }
        for at in range(draw(st.integers(0, 12)))
    ]
    return [*nodes, *pods]


def outcome(*documents: Any, replay: int = 0) -> Outcome:
    reader = Reader(kinds())
    for document in documents:
        reader.add(json.dumps(document).encode(), "test")
    return simulate(reader.dump, CONFIG, replay=replay)


def a_list(items: list[Any]) -> Any:
    return {"kind": "List", "items": items}


@given(clusters(), st.integers(0, 20))
def test_the_same_cluster_in_one_file_in_many_and_exported_again_gives_the_same_placements(
    objects: list[Any], replay: int
) -> None:
    whole = outcome(a_list(objects), replay=replay)
    assert outcome(*objects, replay=replay) == whole
    reader = Reader(kinds())
    reader.add(json.dumps(a_list(objects)).encode(), "test")
    exported = encode((VERSIONS[kind], kind, obj) for kind, found in reader.dump.objects.items() for obj in found)
    assert outcome(json.loads(exported), replay=replay) == whole


@given(clusters(), st.integers(0, 20))
def test_every_waiting_pod_of_ours_is_told_about_once_with_a_node_or_a_reason(objects: list[Any], replay: int) -> None:
    found = outcome(a_list(objects), replay=replay)
    ours = {"ros-aware-scheduler", "kubernetes-scheduler"}
    pods = {item["metadata"]["name"]: item["spec"] for item in objects if item["kind"] == "Pod"}
    told = [placement.name for placement in found.placements]
    waiting = {name for name, spec in pods.items() if spec["schedulerName"] in ours and not spec["nodeName"]}
    again = {placement.name for placement in found.placements if placement.was}
    assert sorted(told) == sorted(waiting | again)
    assert len(told) == len(set(told))
    assert len(again) == min(
        replay, sum(1 for spec in pods.values() if spec["schedulerName"] in ours and spec["nodeName"])
    )
    for placement in found.placements:
        assert (placement.node is None) == bool(placement.message)


@given(st.binary(max_size=200) | st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(
        ("kind", "items", "metadata", "spec", "status", "name", "nodeName", "containers", "labels", "allocatable")
    ), inner, max_size=4), max_leaves=20,
).map(lambda value: json.dumps(value).encode()))  # fmt: skip
def test_no_bytes_crash_the_reader_or_the_simulation(content: bytes) -> None:
    reader = Reader(kinds())
    try:
        reader.add(content, "noise")
        reader.add(b'{"kind":"List","items":[' + content + b"]}", "noise in a list")
    except DumpError:
        pass
    simulate(reader.dump, CONFIG, replay=3)
