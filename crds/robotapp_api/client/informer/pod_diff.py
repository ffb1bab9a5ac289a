"""Events of pods that differ little from the last one: recognised by their bytes, and only the difference is decoded.

A pod is told of three times on its way (made, bound, running). The second time it has got a node, the third a status;
its metadata and its spec are the larger part of each. So their bytes are kept, but for the version of the object,
`managedFields`, and the name of the node, which comes to stand inside the spec.
"""

from typing import Any, Final, Generic, TypeVar, get_type_hints

import msgspec
from msgspec.structs import replace

T = TypeVar("T")
M = TypeVar("M")

MOST_BYTES: Final = 32 * 2**20
"""Specs of ten thousand pods and more; those kept longest go first."""
MOST_BEFORE_BYTES: Final = 4096
"""Behind so much else of an object `managedFields` is not looked for: searching costs as well."""
_MANAGED: Final = b'"managedFields":['
_SPEC: Final = b']},"spec":{'
"""What stands between the contents of managedFields and those of the spec."""
_UPDATE: Final = b'{"type":"MODIFIED","object":'
_AROUND_KIND: Final = len(b'{"type":"","object":')
_UID: Final = b'"uid":"'
_UID_BYTES: Final = 36
_LABELS: Final = b',"labels":{'
"""Of the object: before managedFields nothing else has such a key. No label holds a brace."""
_VERSION: Final = b'","resourceVersion":"'
_STATUS: Final = b',"status":{'
_NODE: Final = b'"nodeName":"'
_BEHIND: Final = b'"securityContext":{'
"""What follows the name of the node in nearly every pod. Containers have such a key too, all of them stand before it."""


class _Headed(msgspec.Struct, Generic[M], gc=False):
    metadata: M


class _Head(msgspec.Struct, Generic[M], gc=False):
    object: _Headed[M]


class _Kept(msgspec.Struct, gc=False):
    """The last version of an object as it was written.

    `named`, the version, `rest` up to the contents of managedFields, these, `before`, perhaps a node, `behind` up to
    those of the status.
    """

    named: bytes
    rest: bytes
    before: bytes
    behind: bytes
    node: str
    """Which node the spec names when nothing stands between `before` and `behind`."""
    size: int
    obj: Any


class PodDiff(Generic[T]):
    """The last versions of pods: structs with `metadata` (which has `labels`), `spec` (which has a `node_name`) and `status`.

    `start` and `end` in a watch line are where the contents of managedFields are, if they are easily found (`managed`).
    """

    def __init__(self, as_type: type[T], *, most_bytes: int = MOST_BYTES) -> None:
        hints = get_type_hints(as_type)
        meta = hints["metadata"]
        # The type is made at run time, which no checker can follow.
        head: msgspec.json.Decoder[Any] = msgspec.json.Decoder(_Head[meta])  # type: ignore[valid-type]
        self._head = head.decode
        self._labels = msgspec.json.Decoder(get_type_hints(meta)["labels"]).decode
        self._status = msgspec.json.Decoder(hints["status"]).decode
        self._make: Any = as_type
        self._most_bytes = most_bytes
        self._bytes = 0
        self._kept: dict[bytes, _Kept] = {}

    def __repr__(self) -> str:
        return f"<Versions of {len(self._kept)} objects, {self._bytes} bytes>"

    def again(self, line: bytes) -> T | None:
        """The object of an update, if its spec is the one it had, but for the node. Raises DecodeError, ValidationError."""
        first = line.find(_UID, 0, MOST_BEFORE_BYTES) + len(_UID)
        known = self._kept.get(line[first : first + _UID_BYTES])
        if known is None or not line.startswith(known.named):
            return None
        metadata, rest, end = self._metadata(known, line)
        spec, status = _spec(known, line, end)
        if not status:
            return None
        obj: T = self._make(metadata=metadata, spec=spec, status=self._status(line[status:-2]))
        known.rest, known.obj = rest, obj
        return obj

    def _metadata(self, known: _Kept, line: bytes) -> tuple[Any, bytes, int]:
        """Metadata, decoded where more than the version is new, its bytes, and where the contents of managedFields end."""
        at, rest = len(known.named), known.rest
        last = line.find(b'"', at)
        if line.startswith(rest, last):
            version = line[at:last].decode()
            end = line.find(b"]", last + len(rest))
            return replace(known.obj.metadata, resource_version=version), rest, end
        first = rest.find(_LABELS) + len(_LABELS)
        if first >= len(_LABELS) and line.startswith(rest[:first], last):
            # The API server gives a pod labels of the place it is bound to: nothing else is new.
            closed = line.find(b"}", last + first)
            behind = rest[rest.find(b"}", first) :]
            if line.startswith(behind, closed):
                labels = self._labels(line[last + first - 1 : closed + 1])
                metadata = replace(known.obj.metadata, resource_version=line[at:last].decode(), labels=labels)
                start = closed + len(behind)
                return metadata, line[last:start], line.find(b"]", start)
        where = managed(line)
        if where is None:
            return None, rest, len(line)
        start, end = where
        return self._head(line[:start] + b"]}}}").object.metadata, line[last:start], end

    def take(self, kind: str, line: bytes, where: tuple[int, int], obj: Any) -> None:
        """Of a line that was decoded whole: the next version may be nearly the same."""
        start, end = where
        first, status = line.find(_UID, 0, start) + len(_UID), line.rfind(_STATUS)
        at = first + _UID_BYTES
        uid = line[first:at]
        if uid in self._kept:
            self._bytes -= self._kept.pop(uid).size
        if kind == "DELETED" or not line.startswith(_VERSION, at) or status < end:
            return
        at += len(_VERSION)
        named = _UPDATE + line[len(kind) + _AROUND_KIND : at]
        before, behind, node = _around_node(line, end, status, obj.spec.node_name)
        size = start + status - end
        self._kept[uid] = _Kept(named, line[line.find(b'"', at) : start], before, behind, node, size, obj)
        self._bytes += size
        while self._bytes > self._most_bytes:
            self._bytes -= self._kept.pop(next(iter(self._kept))).size


def managed(line: bytes) -> tuple[int, int] | None:
    """Where in a watch line the contents of metadata.managedFields are, if they are easily found: nearly half of a pod.

    Nothing else of valid JSON is found. A quote inside a string is escaped, so what looks like the two keys here are
    keys, and the bracket before the second is none of a string; as it is the first one, it ends this very list.
    """
    start = line.find(_MANAGED, 0, MOST_BEFORE_BYTES) + len(_MANAGED)
    if start < len(_MANAGED):
        return None
    end = line.find(b"]", start)
    return (start, end) if line.startswith(_SPEC, end) else None


def _around_node(line: bytes, end: int, status: int, node: str) -> tuple[bytes, bytes, str]:
    """Where the spec can get a node: what is before and behind, and which it names without one there."""
    at = line.rfind(_BEHIND, end, status)
    at = status if at < 0 else at
    before = line[end:at]
    if node:
        named = b'%b%b",' % (_NODE, node.encode())
        if before.endswith(named):
            before, node = before[: -len(named)], ""
    return before, line[at : status + len(_STATUS)], node


def _spec(known: _Kept, line: bytes, end: int) -> tuple[Any, int]:
    """The spec that begins there and where the status does; 0 when more than the node is new."""
    if not line.startswith(known.before, end):
        return None, 0
    at, node = end + len(known.before), known.node
    if line.startswith(_NODE, at):
        first = at + len(_NODE)
        last = line.find(b'"', first)
        node, at = line[first:last].decode(), last + 2
    if not line.startswith(known.behind, at) or "\\" in node:
        return None, 0
    spec = known.obj.spec
    return spec if spec.node_name == node else replace(spec, node_name=node), at + len(known.behind) - 1
