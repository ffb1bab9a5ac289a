"""Whoever skips the specs it knows reads exactly what one reads who decodes every line whole."""

import json
import random
from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from robotapp_api.client.informer.pod_diff import PodDiff, managed
from robotapp_api.client.informer.watch_decoder import ADDED, DELETED, MODIFIED, WatchDecoder

TEXTS = st.sampled_from(
    [
        "nodeName",
        '"nodeName":"',
        '"nodeName":"a",',
        ',"status":{',
        '},"status":{}',
        '"securityContext":{',
        '"',
        "\\",
        "a",
    ]
)
KINDS = st.sampled_from([ADDED, MODIFIED, MODIFIED, MODIFIED, DELETED])


class Meta(msgspec.Struct, rename="camel", kw_only=True):
    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""
    labels: dict[str, str] | None = None
    annotations: dict[str, str] | None = None


class Container(msgspec.Struct, rename="camel"):
    name: str = ""
    security_context: dict[str, Any] | None = None


class Spec(msgspec.Struct, rename="camel", kw_only=True):
    containers: list[Container] = []
    node_selector: dict[str, str] | None = None
    node_name: str = ""
    host_network: bool = False
    security_context: dict[str, Any] | None = None
    tolerations: list[str] | None = None
    more: str = ""


class Status(msgspec.Struct):
    phase: str = ""
    more: list[str] = []


class Podlike(msgspec.Struct):
    metadata: Meta
    spec: Spec = msgspec.field(default_factory=Spec)
    status: Status = msgspec.field(default_factory=Status)


NODES = st.sampled_from(["a", "b", 'x"y', "x\\", "ü", ""])
SPECS = st.fixed_dictionaries(
    {},
    optional={
        "containers": st.lists(
            st.fixed_dictionaries({"name": TEXTS}, optional={"securityContext": st.just({"user": 1})}), max_size=2
        ),
        "nodeSelector": st.dictionaries(TEXTS, TEXTS, max_size=2),
        "hostNetwork": st.booleans(),
        "tolerations": st.lists(TEXTS, max_size=2),
    },
)
TWINS = st.sampled_from([{}, {}, {"tolerations": ["a"]}, {"tolerations": ["b"]}])
STATUSES = st.fixed_dictionaries({}, optional={"phase": TEXTS, "more": st.lists(TEXTS, max_size=2)})
LABELS = st.sampled_from([{}, {"a": "a"}, {"a": "b"}, {"a": "a", "}": "}"}]) | st.dictionaries(TEXTS, TEXTS, max_size=2)


RARELY = st.sampled_from([False] * 7 + [True])


@st.composite
def stories(draw: st.DrawFn) -> list[bytes]:
    """News of a pod whose spec seldom changes, as the API server writes them; rarely something else."""
    spec = draw(SPECS)
    lines = []
    for number in range(draw(st.integers(3, 8))):
        spec = draw(SPECS) if draw(RARELY) else spec | draw(TWINS)
        kind = draw(KINDS) if draw(RARELY) else MODIFIED if number else ADDED
        news = json.dumps({"type": kind, "object": _pod(draw, number, spec)}, separators=(",", ":"), ensure_ascii=False)
        lines.append(news.encode())
    return lines


def _pod(draw: st.DrawFn, number: int, spec: dict[str, Any]) -> dict[str, Any]:
    node = {"nodeName": draw(NODES)} if draw(st.booleans()) else {}
    behind = {} if draw(RARELY) else {"securityContext": {}, "more": draw(st.sampled_from("aaab"))}
    uid = draw(st.sampled_from(["2", ""])) if draw(RARELY) else "1"
    managed = draw(st.sampled_from([[], [["]"]]])) if draw(RARELY) else [{"f:spec": {}}]
    metadata = {
        "name": "n" + uid,
        "uid": uid * 36,
        "resourceVersion": str(number),
        "labels": draw(LABELS) if draw(st.booleans()) else {"a": "a"},
        "annotations": {"labels": draw(TEXTS)} if draw(RARELY) else {},
        "managedFields": managed,
    }
    pod = {"metadata": metadata, "spec": spec | node | behind, "status": draw(STATUSES)}
    if draw(RARELY):
        del pod["status"]
    order: random.Random = draw(st.randoms(use_true_random=False))
    return dict(order.sample([*pod.items()], len(pod))) if draw(RARELY) else pod


@settings(max_examples=300)
@given(stories())
def test_skipping_known_specs_changes_nothing_that_is_read(lines: list[bytes]) -> None:
    whole = WatchDecoder(Podlike, namespaced=True)
    known = WatchDecoder(Podlike, namespaced=True, fixed_keys=True, known_specs=True)
    assert [known.event(line) for line in lines] == [whole.event(line) for line in lines]


def _news(
    node: str = "", *, phase: str = "Pending", kind: str = MODIFIED, uid: str = "1", labels: str = "", more: str = ""
) -> bytes:
    named = f'"nodeName":"{node}",' if node else ""
    return (
        f'{{"type":"{kind}","object":{{"metadata":{{"name":"n","uid":"{uid * 36}","resourceVersion":"1",'
        f'"labels":{{{labels}}},{more}"managedFields":[]}},"spec":{{"containers":[],{named}"securityContext":{{}}}},"status":{{"phase":"{phase}"}}}}}}'
    ).encode()


def test_a_pod_that_got_a_node_and_then_a_status_is_decoded_once() -> None:
    decoder = WatchDecoder(Podlike, namespaced=True, fixed_keys=True, known_specs=True)
    made, bound, running = (
        decoder.event(line).obj for line in (_news(kind=ADDED), _news("a"), _news("a", phase="Running"))
    )
    assert bound.spec.containers is made.spec.containers
    assert (made.spec.node_name, bound.spec.node_name, running.status.phase) == ("", "a", "Running")
    assert running.spec is bound.spec
    assert running.metadata.labels is made.metadata.labels is not None


def test_of_a_pod_that_got_labels_of_its_place_only_these_are_decoded() -> None:
    decoder = WatchDecoder(Podlike, namespaced=True, fixed_keys=True, known_specs=True)
    annotated = '"annotations":{"b":"}"},'
    made, bound, running = (
        decoder.event(line).obj.metadata
        for line in (
            _news(kind=ADDED, more=annotated),
            _news("a", labels='"zone":"x"', more=annotated),
            _news("a", phase="Running", labels='"zone":"x"', more=annotated),
        )
    )
    assert (made.labels, bound.labels) == ({}, {"zone": "x"})
    assert bound.annotations is made.annotations is not None
    assert running.labels is bound.labels


def test_what_is_kept_is_bounded_and_ends_with_the_pod() -> None:
    versions = PodDiff(Podlike, most_bytes=500)
    decoder = WatchDecoder(Podlike, namespaced=True, fixed_keys=True)
    for uid in "123":
        line = _news(kind=ADDED, uid=uid)
        versions.take(ADDED, line, managed(line) or (0, 0), decoder.event(line).obj)
    assert repr(versions) == "<Versions of 2 objects, 386 bytes>"
    gone = _news(kind=DELETED, uid="3")
    versions.take(DELETED, gone, managed(gone) or (0, 0), decoder.event(gone).obj)
    assert repr(versions) == "<Versions of 1 objects, 193 bytes>"
    assert versions.again(_news()) is None
    assert versions.again(_news(uid="2")) is not None
