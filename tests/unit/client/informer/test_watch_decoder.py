"""From chunks to lines to events."""

import itertools
import json
import random
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scripted import bookmark, error_event, event, item

from robotapp_client.api.nesting import shallow
from robotapp_client.informer.watch_decoder import BOOKMARK, Identity, Lines, WatchDecoder, managed
from robotapp_client.transport.errors import Gone, ServerError, Unreachable


def split(pieces: list[bytes], *, at_once: int = 1, **settings: int) -> list[list[bytes]]:
    """What ends with each packet of so many pieces."""
    lines = Lines(**settings)
    return [lines.ended(pieces[start : start + at_once]) for start in range(0, len(pieces), at_once)]


def in_all(pieces: list[bytes], *, at_once: int = 1) -> list[bytes]:
    return list(itertools.chain.from_iterable(split(pieces, at_once=at_once)))


@given(
    texts=st.lists(st.binary(max_size=30).filter(lambda text: b"\n" not in text), max_size=8),
    cuts=st.lists(st.integers(0, 200), max_size=8),
    at_once=st.integers(1, 5),
)
def test_lines_do_not_depend_on_how_the_bytes_arrive(texts: list[bytes], cuts: list[int], at_once: int) -> None:
    stream = b"".join(text + b"\n" for text in texts)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    pieces = [stream[start:end] for start, end in itertools.pairwise(edges)]
    assert in_all(pieces, at_once=at_once) == texts
    assert in_all([text + b"\n" for text in texts], at_once=at_once) == texts


def test_a_line_without_its_end_was_cut_off() -> None:
    assert in_all([b"a\nb", b"c"]) == [b"a"]


def test_lines_that_arrive_at_once_come_together() -> None:
    pieces = [b"a\n", b"b\nc", b"d\n", b"e"]
    assert split(pieces) == [[b"a"], [b"b"], [b"cd"], []]
    assert split(pieces, at_once=2) == [[b"a", b"b"], [b"cd"]]


def test_a_line_without_end_does_not_fill_the_memory() -> None:
    with pytest.raises(Unreachable, match="longer than 10 bytes"):
        split([b"a\nbcdef", b"ghijk", b"l", b"\n"], limit=10)
    assert split([b"a\nbcdef", b"ghij\n"], limit=10) == [[b"a"], [b"bcdefghij"]]


class Meta(msgspec.Struct, rename="camel"):
    name: str
    uid: str
    resource_version: str


class Node(msgspec.Struct):
    metadata: Meta


def line(obj: object, *, spaced: bool = False) -> bytes:
    return json.dumps(obj, separators=None if spaced else (",", ":")).encode()


@pytest.mark.parametrize("spaced", [False, True])
@pytest.mark.parametrize("kind", ["ADDED", "MODIFIED", "DELETED"])
def test_events_carry_the_object_and_who_it_is(kind: str, spaced: bool) -> None:
    read = WatchDecoder(Node, namespaced=False).event(line(event(kind, item("n", 7)), spaced=spaced))
    assert (read.kind, read.identity, read.problem) == (kind, Identity("n", "uid-n", "7"), "")
    assert read.obj == Node(Meta("n", "uid-n", "7"))


@pytest.mark.parametrize("end", [False, True])
def test_bookmarks_carry_a_version_only(end: bool) -> None:
    read = WatchDecoder(Node, namespaced=False).event(line(bookmark(9, initial_end=end)))
    assert (read.kind, read.obj, read.identity.version, read.initial_end) == (BOOKMARK, None, "9", end)


@pytest.mark.parametrize(("code", "kind"), [(410, Gone), (500, ServerError)])
def test_error_events_are_raised(code: int, kind: type[Exception]) -> None:
    with pytest.raises(kind):
        WatchDecoder(Node, namespaced=False).event(line(error_event(code)))


@pytest.mark.parametrize("broken", [b"", b"{", b"7", b"\xff", b'{"type":"ADDED"}', b'{"type":"ADDED","object":7}'])
def test_what_is_no_event_breaks_the_watch(broken: bytes) -> None:
    for as_type in (dict, Node):
        with pytest.raises(Unreachable):
            WatchDecoder(as_type, namespaced=False).event(broken)


def test_an_object_that_does_not_fit_says_why_and_who_it_is() -> None:
    misfit = {"metadata": {"name": "n", "namespace": "ns", "uid": "u", "resourceVersion": "7"}, "size": "big"}

    class Sized(Node):
        size: int = 0

    read = WatchDecoder(Sized, namespaced=False).event(line(event("ADDED", misfit)))
    assert (read.obj, read.identity) == (None, Identity("ns/n", "u", "7"))
    assert "Expected `int`" in read.problem


def test_dicts_are_known_by_their_metadata() -> None:
    decoder = WatchDecoder(dict, namespaced=True)
    assert decoder.identify(item("a", 1)) == Identity("default/a", "uid-a", "1")
    assert decoder.identify({"metadata": {"name": "n"}}) == Identity("n", "", "")


def nested(levels: int) -> str:
    return '{"a":' * levels + "1" + "}" * levels


@pytest.mark.parametrize("levels", [1200, 200_000])
@pytest.mark.parametrize("spec", ['{"selector": %s}', '{"nobody reads this": [%s]}'])
def test_an_object_nested_without_end_is_read_as_far_as_anybody_looks(levels: int, spec: str) -> None:
    meta = '{"namespace": "a", "name": "b", "uid": "u", "resourceVersion": "7"}'
    obj = f'{{"metadata": {meta}, "spec": {spec % nested(levels)}}}'
    decoder = WatchDecoder(dict, namespaced=True)
    found = decoder.event(f'{{"type": "ADDED", "object": {obj}}}'.encode())
    assert found.identity == Identity("a/b", "u", "7")
    (read,) = decoder.page(f'{{"metadata": {{"resourceVersion": "9"}}, "items": [{obj}]}}'.encode()).items or ()
    assert (read[1], read[2]) == (found.identity, "")
    assert found.obj["metadata"]["name"] == "b"


@given(
    st.recursive(st.none() | st.text() | st.integers(), lambda each: st.lists(each) | st.dictionaries(st.text(), each))
)
def test_what_is_shallow_already_stays_as_it_is(value: object) -> None:
    body = json.dumps(value, ensure_ascii=False).encode()
    assert shallow(body) == body
    cut = json.loads(shallow(body, most=1))
    assert isinstance(cut, type(value))


class Labelled(msgspec.Struct, rename="camel"):
    name: str = ""
    uid: str = ""
    resource_version: str = ""
    labels: dict[str, str] | None = None
    finalizers: list[str] | None = None


class Spec(msgspec.Struct, rename="camel"):
    priority: int = 0
    tolerations: list[str] | None = None


class Thing(msgspec.Struct):
    metadata: Labelled = msgspec.field(default_factory=Labelled)
    spec: Spec = msgspec.field(default_factory=Spec)


TEXTS = st.sampled_from(['"managedFields":[', ']},"spec":{', "]", "[", '\\"]},', "f:x", '"', "\\"]) | st.text(
    max_size=5
)
VALUES = st.recursive(
    st.none() | st.integers() | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=8,
)
THINGS = st.fixed_dictionaries(
    {},
    optional={
        "metadata": st.fixed_dictionaries(
            {},
            optional={
                "labels": st.dictionaries(TEXTS, TEXTS, max_size=2),
                "managedFields": st.lists(VALUES, max_size=3),
                "finalizers": st.lists(TEXTS, max_size=2),
                "more": VALUES,
            },
        ),
        "status": VALUES,
        "spec": st.fixed_dictionaries({}, optional={"more": VALUES, "tolerations": st.lists(TEXTS, max_size=2)}),
    },
)


@given(thing=THINGS, spaced=st.booleans(), order=st.randoms(use_true_random=False))
def test_what_is_read_does_not_depend_on_whether_managed_fields_were(
    thing: dict[str, Any], spaced: bool, order: random.Random
) -> None:
    thing = shuffled(thing, order) | ({"metadata": shuffled(thing["metadata"], order)} if "metadata" in thing else {})
    sent = line(event("ADDED", thing), spaced=spaced)
    whole, brief = (WatchDecoder(Thing, namespaced=False, fixed_keys=fixed) for fixed in (False, True))
    assert brief.event(sent) == whole.event(sent)


def shuffled(mapping: dict[str, Any], order: random.Random) -> dict[str, Any]:
    return dict(order.sample(list(mapping.items()), len(mapping)))


def test_managed_fields_are_found_as_the_api_server_writes_them() -> None:
    fields = [{"manager": "kubelet", "fieldsV1": {"f:status": {'k:{"type":"Ready"}': {}}}}]
    start, end = b'{"metadata":{"ownerReferences":[],"managedFields":[', b']},"spec":{}}'
    sent = line({"metadata": {"ownerReferences": [], "managedFields": fields}, "spec": {}})
    assert managed(sent) == (len(start), len(sent) - len(end))
    assert managed(start + b"[1]" + end) is None
    assert managed(b" " * 5000 + sent) is None
    assert managed(b"{}") is None
