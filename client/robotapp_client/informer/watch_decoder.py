"""Bytes of a watch stream to typed events: line splitting, a cheap envelope, and the identity of an object."""

from collections.abc import Callable, Sequence
from typing import Any, Final, Generic, TypeVar, get_type_hints

import msgspec

from robotapp_client.api.client import ListMeta, Page
from robotapp_client.api.nesting import decode_nested
from robotapp_client.transport.errors import Status, Unreachable, error_from_status

T = TypeVar("T")

ADDED: Final = "ADDED"
MODIFIED: Final = "MODIFIED"
DELETED: Final = "DELETED"
BOOKMARK: Final = "BOOKMARK"
ERROR: Final = "ERROR"

MAX_LINE_BYTES: Final = 32 * 2**20
"""etcd refuses objects above 1.5 MiB; a longer line means we lost the thread."""
INITIAL_EVENTS_END: Final = "k8s.io/initial-events-end"
MOST_BEFORE_BYTES: Final = 4096
"""Behind so much else of an object `managedFields` is not looked for: searching costs as well."""
_MANAGED: Final = b'"managedFields":['
_SPEC: Final = b']},"spec":{'
"""What stands between the contents of managedFields and those of the spec."""


class Identity(msgspec.Struct, frozen=True, gc=False):
    """Which object this is (`key`: "namespace/name" or "name"), which life of it (`uid`), in which state (`version`)."""

    key: str
    uid: str
    version: str


class WatchEvent(msgspec.Struct, frozen=True, gc=False):
    """One line. `obj` is None for bookmarks and for objects that do not fit the type (`problem` is the reason)."""

    kind: str
    obj: Any
    identity: Identity
    initial_end: bool = False
    problem: str = ""


class _Meta(msgspec.Struct, rename="camel"):
    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""
    annotations: dict[str, str] | None = None


class _Bare(msgspec.Struct):
    metadata: _Meta


class _Envelope(msgspec.Struct):
    type: str
    object: msgspec.Raw


class _Typed(msgspec.Struct, Generic[T], gc=False):
    type: str
    object: T


class _RawPage(msgspec.Struct):
    metadata: ListMeta
    items: list[msgspec.Raw] | None = None


_ENVELOPE = msgspec.json.Decoder(_Envelope)
_RAW_PAGE = msgspec.json.Decoder(_RawPage)
_BARE = msgspec.json.Decoder(_Bare)
_STATUS = msgspec.json.Decoder(Status)
_USUAL = frozenset({ADDED, MODIFIED, DELETED})


class Lines:
    """Complete lines of pieces as they arrive. A last line without its newline was cut off and is never given."""

    def __init__(self, *, limit: int = MAX_LINE_BYTES) -> None:
        self._limit = limit
        self._parts: list[bytes] = []  # of a line in several pieces: joined once, not copied for every piece
        self._size = 0

    def __repr__(self) -> str:
        return f"<Lines, {self._size} bytes of the next>"

    def ended(self, pieces: Sequence[bytes]) -> list[bytes]:
        """The lines that end in these pieces. Raises Unreachable when one has become too long."""
        complete: list[bytes] = []
        parts = self._parts
        for piece in pieces:
            start, end = 0, piece.find(b"\n")
            if 0 <= end == len(piece) - 1 and not parts:  # as a server sends that has nothing else to send
                complete.append(piece[:-1])
                continue
            while end >= 0:  # `split` looks at byte after byte: a tenth of what a pod's event costs
                parts.append(piece[start:end])
                complete.append(b"".join(parts))
                parts.clear()
                self._size = 0
                start, end = end + 1, piece.find(b"\n", end + 1)
            if start < len(piece):
                parts.append(piece[start:])
                self._size += len(piece) - start
                if self._size > self._limit:
                    raise Unreachable(f"a watch line is longer than {self._limit} bytes", maybe_applied=False)
        return complete


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


def identify_with(as_type: Any, *, namespaced: bool) -> Callable[[Any], Identity]:
    """How to read the identity of a decoded object: a dict, or a struct with metadata.{name, namespace, uid, ...}.

    Raises TypeError at once when a struct lacks what a reflector needs, rather than at the first event.
    """
    if as_type is dict:
        return _dict_identity
    meta = get_type_hints(as_type).get("metadata")
    have = set(get_type_hints(meta)) if meta is not None else set()
    wanted = {"name", "uid", "resource_version"} | ({"namespace"} if namespaced else set())
    if missing := sorted(wanted - have):
        raise TypeError(f"{as_type.__name__}.metadata lacks {', '.join(missing)} (snake_case, rename='camel')")
    return _namespaced_identity if namespaced else _cluster_identity


def _dict_identity(obj: Any) -> Identity:
    meta = obj["metadata"]
    namespace = meta.get("namespace", "")
    name = meta["name"]
    return Identity(f"{namespace}/{name}" if namespace else name, meta.get("uid", ""), meta.get("resourceVersion", ""))


def _namespaced_identity(obj: Any) -> Identity:
    meta = obj.metadata
    return Identity(f"{meta.namespace}/{meta.name}", meta.uid, meta.resource_version)


def _cluster_identity(obj: Any) -> Identity:
    meta = obj.metadata
    return Identity(meta.name, meta.uid, meta.resource_version)


Read = tuple[T | None, Identity, str]
"""An object as read, its identity and, when it does not fit the type (then it is None), the problem."""


class WatchDecoder(Generic[T]):
    """Decodes list pages and watch lines of objects of `as_type`; one that does not fit never stops the others."""

    def __init__(self, as_type: type[T], *, namespaced: bool, fixed_keys: bool = False) -> None:
        """`fixed_keys`: in nothing that `as_type` reads can a user have named something "managedFields"."""
        self._fixed_keys = fixed_keys
        self.identify = identify_with(as_type, namespaced=namespaced)
        # The types are made at run time, which no checker can follow.
        typed: msgspec.json.Decoder[Any] = msgspec.json.Decoder(_Typed[as_type])  # type: ignore[valid-type]
        self._typed = typed.decode
        self._page: msgspec.json.Decoder[Page[T]] = msgspec.json.Decoder(Page[as_type])  # type: ignore[valid-type]
        self._object: msgspec.json.Decoder[T] = msgspec.json.Decoder(as_type)

    def page(self, body: bytes) -> "Page[Read[T]]":
        """A list page, in one pass unless an object in it does not fit. Raises Unreachable when it is no list."""
        return decode_nested(self._read_page, body)

    def _read_page(self, body: bytes) -> "Page[Read[T]]":
        try:
            page = self._page.decode(body)
            return Page(page.metadata, [(obj, self.identify(obj), "") for obj in page.items or ()])
        except (msgspec.ValidationError, KeyError, TypeError):
            return self._tolerant_page(body)

    def event(self, line: bytes) -> WatchEvent:
        """One line. Raises Unreachable when it is no watch event, the ApiError of an ERROR event."""
        try:  # one pass over the bytes; whatever is unusual pays for a second
            kind, obj = self._read(line)
            if kind in _USUAL:
                return WatchEvent(kind, obj, self.identify(obj))
        except (msgspec.DecodeError, UnicodeDecodeError, KeyError, TypeError, RecursionError):
            pass
        return decode_nested(self._unusual, line)

    def _read(self, line: bytes) -> tuple[str, T]:
        where = managed(line) if self._fixed_keys else None
        event = self._typed(line if where is None else line[: where[0]] + line[where[1] :])
        return event.type, event.object

    def _unusual(self, line: bytes) -> WatchEvent:
        try:
            envelope = _ENVELOPE.decode(line)
            if envelope.type == ERROR:
                raise error_from_status(_STATUS.decode(envelope.object))
            if envelope.type == BOOKMARK:
                meta = _BARE.decode(envelope.object).metadata
                end = (meta.annotations or {}).get(INITIAL_EVENTS_END) == "true"
                return WatchEvent(BOOKMARK, None, Identity("", "", meta.resource_version), initial_end=end)
            obj, identity, problem = self._tolerant(envelope.object)
            return WatchEvent(envelope.type, obj, identity, problem=problem)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise Unreachable(f"a watch line is no event: {error}", maybe_applied=False) from error

    def _tolerant_page(self, body: bytes) -> "Page[Read[T]]":
        try:
            page = _RAW_PAGE.decode(body)
            return Page(page.metadata, [self._tolerant(item) for item in page.items or ()])
        except msgspec.DecodeError as error:
            raise Unreachable(f"the answer is no list: {error}", maybe_applied=False) from error

    def _tolerant(self, raw: msgspec.Raw) -> "Read[T]":
        try:
            obj = self._object.decode(raw)
            return obj, self.identify(obj), ""
        except (msgspec.ValidationError, KeyError, TypeError) as error:
            meta = _BARE.decode(raw).metadata
            key = f"{meta.namespace}/{meta.name}" if meta.namespace else meta.name
            return None, Identity(key, meta.uid, meta.resource_version), str(error) or type(error).__name__
