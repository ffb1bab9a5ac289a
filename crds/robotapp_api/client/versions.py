"""News of an object whose spec is the one it had: recognised by its bytes, which are not decoded again.

A pod is told of three times on its way (made, bound, running), and its spec is the larger part of each. The second time
it has got a node, the third a status. So the bytes of its spec are kept, in the two parts between which the name of the
node comes to stand.
"""

from typing import Any, Final, Generic, TypeVar, get_type_hints

import msgspec
from msgspec.structs import replace

T = TypeVar("T")
M = TypeVar("M")

MOST_BYTES: Final = 32 * 2**20
"""Specs of ten thousand pods and more; those kept longest go first."""
SPEC: Final = b']},"spec":{'
"""What stands between the contents of managedFields and those of the spec."""
_UPDATE: Final = b'{"type":"MODIFIED"'
_STATUS: Final = b',"status":{'
_NODE: Final = b'"nodeName":"'
_BEHIND: Final = b'"securityContext":{'
"""What follows the name of the node in nearly every pod. Containers have such a key too, all of them stand before it."""


class _Headed(msgspec.Struct, Generic[M], gc=False):
    metadata: M


class _Head(msgspec.Struct, Generic[M], gc=False):
    object: _Headed[M]


class _Kept(msgspec.Struct, gc=False):
    """The last version of an object. Its spec had the bytes `before` and `behind`, and perhaps a node between them."""

    before: bytes
    behind: bytes
    node: str
    """Which node the spec names when nothing stands between the two."""
    size: int
    obj: Any


class Versions(Generic[T]):
    """The last versions of pods: structs with `metadata`, `spec` (which has a `node_name`) and `status`.

    `start` and `end` in a watch line are where the contents of managedFields are (`watch.managed`).
    """

    def __init__(self, as_type: type[T], *, most_bytes: int = MOST_BYTES) -> None:
        hints = get_type_hints(as_type)
        meta = hints["metadata"]
        # The type is made at run time, which no checker can follow.
        head: msgspec.json.Decoder[Any] = msgspec.json.Decoder(_Head[meta])  # type: ignore[valid-type]
        self._head = head.decode
        self._status = msgspec.json.Decoder(hints["status"]).decode
        self._make: Any = as_type
        self._most_bytes = most_bytes
        self._bytes = 0
        self._kept: dict[str, _Kept] = {}

    def __repr__(self) -> str:
        return f"<Versions of {len(self._kept)} objects, {self._bytes} bytes>"

    def again(self, line: bytes, start: int, end: int) -> T | None:
        """The object of an update, if its spec is the one it had, but for the node. Raises DecodeError, ValidationError."""
        if not line.startswith(_UPDATE):
            return None
        metadata = self._head(line[:start] + b"]}}}").object.metadata
        known = self._kept.get(metadata.uid)
        if known is None:
            return None
        begin = end + len(SPEC)
        if not line.startswith(known.before, begin):
            return None
        at, node = begin + len(known.before), known.node
        if line.startswith(_NODE, at):
            first = at + len(_NODE)
            last = line.find(b'"', first)
            node, at = line[first:last].decode(), last + 2
        if not line.startswith(known.behind, at) or "\\" in node:
            return None
        spec = known.obj.spec
        if spec.node_name != node:
            spec = replace(spec, node_name=node)
        status = self._status(line[at + len(known.behind) - 1 : -2])
        obj: T = self._make(metadata=metadata, spec=spec, status=status)
        known.obj = obj
        return obj

    def take(self, kind: str, line: bytes, end: int, obj: Any) -> None:
        """Of a line that was decoded whole: the next version may have its spec."""
        uid = obj.metadata.uid
        if uid in self._kept:
            self._drop(uid)
        begin, status = end + len(SPEC), line.rfind(_STATUS)
        if not uid or kind == "DELETED" or status < begin:
            return
        at = line.rfind(_BEHIND, begin, status)
        at = status if at < 0 else at
        before, node, size = line[begin:at], obj.spec.node_name, status - begin
        if node:
            named = b'%b%b",' % (_NODE, node.encode())
            if before.endswith(named):
                before, node = before[: -len(named)], ""
        self._kept[uid] = _Kept(before, line[at : status + len(_STATUS)], node, size, obj)
        self._bytes += size
        while self._bytes > self._most_bytes:
            self._drop(next(iter(self._kept)))

    def _drop(self, uid: str) -> None:
        self._bytes -= self._kept.pop(uid).size
