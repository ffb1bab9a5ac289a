"""Whoever skips the specs it knows reads exactly what one reads who decodes every line whole."""

import json
import random
from typing import Any

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.client.versions import Versions
from robotapp_api.client.watch import ADDED, DELETED, MODIFIED, WatchDecoder

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


class Status(msgspec.Struct):
    phase: str = ""
    more: list[str] = []


class Podlike(msgspec.Struct):
    metadata: Meta
    spec: Spec = msgspec.field(default_factory=Spec)
    status: Status = msgspec.field(default_factory=Status)


SPECS = st.fixed_dictionaries(
    {},
    optional={
        "containers": st.lists(
            st.fixed_dictionaries({"name": TEXTS}, optional={"securityContext": st.just({"user": 1})}), max_size=2
        ),
        "nodeSelector": st.dictionaries(TEXTS, TEXTS, max_size=2),
        "nodeName": st.sampled_from(["a", "b", 'x"y', "ü", ""]),
        "hostNetwork": st.booleans(),
        "securityContext": st.sampled_from([{}, {"user": 2}]),
        "tolerations": st.lists(TEXTS, max_size=2),
        "more": TEXTS,
    },
)
"""In the API server's order; `shuffled` leaves it."""
STATUSES = st.none() | st.fixed_dictionaries({}, optional={"phase": TEXTS, "more": st.lists(TEXTS, max_size=2)})
METADATA = st.fixed_dictionaries({}, optional={"labels": st.dictionaries(TEXTS, TEXTS, max_size=2)})


@st.composite
def stories(draw: st.DrawFn) -> list[bytes]:
    """News of two pods whose specs come back, mostly as the API server writes them."""
    specs = draw(st.lists(SPECS, min_size=1, max_size=3))
    order = draw(st.none() | st.randoms(use_true_random=False))
    return [_line(draw, number, specs, order) for number in range(draw(st.integers(1, 8)))]


def _line(draw: st.DrawFn, number: int, specs: list[dict[str, Any]], order: random.Random | None) -> bytes:
    spec = dict(draw(st.sampled_from(specs)))
    if draw(st.booleans()):  # it gets a node where the API server would write it
        spec = {key: spec[key] for key in spec if key != "nodeName"}
        at = [*spec].index("securityContext") if "securityContext" in spec else len(spec)
        spec = dict([*spec.items()][:at]) | {"nodeName": "c"} | dict([*spec.items()][at:])
    uid = draw(st.sampled_from(["1", "2", ""]))
    managed = draw(st.sampled_from([[], [{"f:spec": {}}], [["]"]]]))
    metadata = {
        "name": "n" + uid,
        "uid": uid,
        "resourceVersion": str(number),
        **draw(METADATA),
        "managedFields": managed,
    }
    status = draw(STATUSES)
    obj = {"metadata": metadata, "spec": spec} | ({} if status is None else {"status": status})
    if order is not None:
        obj = dict(order.sample([*obj.items()], len(obj)))
    return json.dumps({"type": draw(KINDS), "object": obj}, separators=(",", ":"), ensure_ascii=False).encode()


@given(stories())
def test_skipping_known_specs_changes_nothing_that_is_read(lines: list[bytes]) -> None:
    whole = WatchDecoder(Podlike, namespaced=True)
    known = WatchDecoder(Podlike, namespaced=True, fixed_keys=True, known_specs=True)
    assert [known.event(line) for line in lines] == [whole.event(line) for line in lines]


def _news(node: str = "", phase: str = "Pending", kind: str = MODIFIED, uid: str = "1") -> bytes:
    named = f'"nodeName":"{node}",' if node else ""
    return (
        f'{{"type":"{kind}","object":{{"metadata":{{"name":"n","uid":"{uid}","managedFields":[]}},'
        f'"spec":{{"containers":[],{named}"securityContext":{{}}}},"status":{{"phase":"{phase}"}}}}}}'
    ).encode()


def test_a_pod_that_got_a_node_and_then_a_status_is_decoded_once() -> None:
    decoder = WatchDecoder(Podlike, namespaced=True, fixed_keys=True, known_specs=True)
    made, bound, running = (
        decoder.event(line).obj for line in (_news(kind=ADDED), _news("a"), _news("a", phase="Running"))
    )
    assert bound.spec.containers is made.spec.containers
    assert (made.spec.node_name, bound.spec.node_name, running.status.phase) == ("", "a", "Running")
    assert running.spec is bound.spec


def test_what_is_kept_is_bounded_and_ends_with_the_pod() -> None:
    versions = Versions(Podlike, most_bytes=100)
    decoder = WatchDecoder(Podlike, namespaced=True, fixed_keys=True)
    for uid in "123":
        line = _news(kind=ADDED, uid=uid)
        versions.take(ADDED, line, line.index(b"]"), decoder.event(line).obj)
    assert repr(versions) == "<Versions of 2 objects, 74 bytes>"
    gone = _news(kind=DELETED, uid="3")
    versions.take(DELETED, gone, gone.index(b"]"), decoder.event(gone).obj)
    assert repr(versions) == "<Versions of 1 objects, 37 bytes>"
    news = _news()
    assert versions.again(news, news.index(b"[") + 1, news.index(b"]")) is None
