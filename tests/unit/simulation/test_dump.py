"""Dumps are read with bounds, one object at a time, and a bad one is named."""

import json
from typing import Any

import pytest
from tests.support.scheduling import node_json, pod_json

from robotapp_scheduler.simulation import dump as dumps
from robotapp_scheduler.simulation.dump import MOST_PROBLEMS, Dump, DumpError, Reader, encode
from robotapp_scheduler.simulation.export import shareable
from robotapp_scheduler.watch.routes import kinds, resources


def read(*documents: Any) -> Dump:
    reader = Reader(kinds())
    for at, document in enumerate(documents):
        reader.add(document if isinstance(document, bytes) else json.dumps(document).encode(), f"file-{at}")
    return reader.dump


def a_list(*items: Any, kind: str = "List") -> Any:
    return {"apiVersion": "v1", "kind": kind, "items": list(items)}


def names(dump: Dump, kind: str) -> list[str]:
    return [each.metadata.name for each in dump.of(kind)]


def test_lists_of_all_kinds_of_one_kind_and_single_objects_are_read() -> None:
    node, pod = {"kind": "Node", **node_json("n")}, {"kind": "Pod", **pod_json("p")}
    found = read(a_list(node, pod), a_list(node_json("m"), kind="NodeList"), {"kind": "Node", **node_json("o")})
    assert names(found, "Node") == ["n", "m", "o"]
    assert names(found, "Pod") == ["p"]
    assert found.count == 4


def test_what_no_rule_reads_is_counted_by_kind() -> None:
    assert read(a_list({"kind": "Secret"}, {"kind": "Secret"}, {})).ignored == {"Secret": 2, "(no kind)": 1}


@pytest.mark.parametrize(
    "bad",
    [
        {"kind": "Pod", "spec": {"nodeName": 3}},
        {"kind": "Node", "metadata": []},
        {"kind": 7},
        {"kind": "Pod", "spec": None},
    ],
)
def test_a_bad_object_is_left_out_with_its_place_and_the_rest_is_read(bad: Any) -> None:
    found = read(a_list(bad, {"kind": "Node", **node_json("n")}))
    assert names(found, "Node") == ["n"]
    assert found.bad == 1
    assert "file-0: items[0]: left out" in found.problems[0]


def test_thousands_of_bad_objects_are_counted_and_some_named() -> None:
    found = read(a_list(*[{"kind": "Pod", "spec": 1}] * 3000))
    assert found.bad == 3000
    assert len(found.problems) == MOST_PROBLEMS


@pytest.mark.parametrize(
    ("content", "hint"),
    [
        (b"apiVersion: v1\nkind: Pod\n", "-o json"),
        (b"", "nothing in it"),
        (b" \n", "nothing in it"),
        (b'{"items": 3}', "no JSON of Kubernetes objects"),
        (b"[" * 100_000, "no JSON of Kubernetes objects"),
        (b'{"a":' * 100_000, "no JSON of Kubernetes objects"),
        (b"\xff\xfe", "-o json"),
    ],
)
def test_what_is_no_dump_is_refused_with_what_is_allowed(content: bytes, hint: str) -> None:
    with pytest.raises(DumpError, match=hint):
        read(content)


def test_an_object_as_deep_as_the_sea_is_refused() -> None:
    deep = b'{"kind":"List","items":[{"kind":"Pod","spec":' + b'{"a":' * 5000 + b"1" + b"}" * 5000 + b"}]}"
    with pytest.raises(DumpError, match="recursion"):
        read(deep)


def test_more_objects_than_allowed_end_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dumps, "MOST_OBJECTS", 10)
    with pytest.raises(DumpError, match="more than 10 objects"):
        read(a_list(*[{"kind": "Service"}] * 11))


def test_an_export_is_read_back_and_holds_nothing_the_rules_do_not_read() -> None:
    given = pod_json("p", annotations={"a": "b"})
    given["spec"]["containers"][0]["env"] = [{"name": "PASSWORD", "value": "secret"}]
    given["metadata"]["managedFields"] = [{"manager": "kubectl"}]
    first = read(a_list({"kind": "Pod", **given}, {"kind": "Node", **node_json("n")}))
    text = encode([("v1", kind, each) for kind in ("Pod", "Node") for each in first.of(kind)])
    assert b"secret" not in text
    assert b"kubectl" not in text
    again = read(text)
    assert again.of("Pod") == first.of("Pod")
    assert again.of("Node") == first.of("Node")
    assert json.loads(text)["items"][0]["apiVersion"] == "v1"


def test_an_export_holds_the_annotations_that_rules_read_and_no_others() -> None:
    theirs = {"kubectl.kubernetes.io/last-applied-configuration": "secret", "robotics.io.evil.example/x": "secret"}
    read_ = {
        "robotics.io/allowed-namespaces": "a",
        "scheduler.robotics.io/dds-domain": "{}",
        "volume.kubernetes.io/selected-node": "n",
    }
    pod = pod_json("p", annotations=theirs | read_) | {"status": {"phase": "Failed", "message": "secret"}}
    meta = {"name": "x", "annotations": theirs | read_}
    others = ("Node", "Deployment", "PersistentVolumeClaim", "RobotApp")
    given = [pod | {"kind": "Pod"}, *({"kind": kind, "metadata": meta, "spec": {}} for kind in others)]
    for kind, items in read(a_list(*given)).objects.items():
        (item,) = map(shareable, items)
        assert item.metadata.annotations == read_, kind
        assert b"secret" not in encode([("v1", kind, item)])


def test_pods_come_last_and_every_watched_kind_is_known() -> None:
    assert list(resources())[-1].kind == "Pod"
    assert {"Node", "Pod", "RobotApp", "RobotClaim", "NodeTelemetry", "Deployment", "ReplicaSet"} <= kinds().keys()
