"""A cluster in JSON, read with bounds: `kubectl get … -o json`, our own export, or single objects, one after another.

A list is cut into its items first and each item is decoded alone, straight into the slim structs of the scheduler: what
the rules do not read costs nothing, and one bad object is reported instead of ending it all.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec

MOST_BYTES: Final = 64 << 20
MOST_OBJECTS: Final = 500_000
MOST_PROBLEMS: Final = 20
"""Bad objects that are named; the rest is counted."""
ALLOWED: Final = (
    "a dump is a List of Kubernetes objects or one of them, in JSON, as `kubectl get nodes,pods -A -o json` and"
    " `python -m robotapp_scheduler export` write it"
)


class DumpError(ValueError):
    """The bytes are no dump; the text names what is allowed."""


class _Name(msgspec.Struct):
    name: str = ""
    namespace: str = ""


class _Head(msgspec.Struct):
    kind: str = ""
    metadata: _Name = msgspec.field(default_factory=_Name)


class _Document(msgspec.Struct):
    kind: str = ""
    items: list[msgspec.Raw] | None = None


@dataclass(slots=True)
class Dump:
    """Decoded objects by kind, in the order they were written; what was left out, and why."""

    objects: dict[str, list[Any]] = field(default_factory=dict)
    ignored: dict[str, int] = field(default_factory=dict)
    """Kinds the scheduler does not look at, with how many there were."""
    problems: list[str] = field(default_factory=list)
    bad: int = 0
    """Objects that could not be decoded; the first of them are in `problems`."""

    @property
    def count(self) -> int:
        """Objects that were understood."""
        return sum(len(found) for found in self.objects.values())

    def of(self, kind: str) -> list[Any]:
        """The objects of a kind."""
        return self.objects.get(kind, [])


class Reader:
    """Collects documents into one dump. `kinds` is the struct into which an object of each kind is decoded."""

    def __init__(self, kinds: Mapping[str, type[Any]]) -> None:
        self._decoders = {kind: msgspec.json.Decoder(as_type) for kind, as_type in kinds.items()}
        self._head = msgspec.json.Decoder(_Head)
        self._document = msgspec.json.Decoder(_Document)
        self._seen = 0
        self.dump = Dump()

    def __repr__(self) -> str:
        return f"Reader({self.dump.count} objects)"

    def add(self, content: bytes, where: str) -> None:
        """One document: a List of any kinds, a list of one kind, or a single object. Raises `DumpError`."""
        if not content.strip():
            raise DumpError(f"{where}: nothing in it; {ALLOWED}")
        try:
            document = self._document.decode(content)
        except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
            raise DumpError(f"{where}: no JSON of Kubernetes objects ({error}); {ALLOWED}") from error
        if document.items is None:
            self._take(content, document.kind, where)
            return
        of_all = document.kind.removesuffix("List")
        for at, item in enumerate(document.items):
            self._take(bytes(item), of_all, f"{where}: items[{at}]")

    def _take(self, content: bytes, kind_of_list: str, where: str) -> None:
        self._seen += 1
        if self._seen > MOST_OBJECTS:
            raise DumpError(f"{where}: more than {MOST_OBJECTS} objects")
        try:
            head = self._head.decode(content)
            kind = head.kind or kind_of_list
            decoder = self._decoders.get(kind)
            if decoder is None:
                self.dump.ignored[kind or "(no kind)"] = self.dump.ignored.get(kind or "(no kind)", 0) + 1
                return
            self.dump.objects.setdefault(kind, []).append(decoder.decode(content))
        except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
            self._bad(where, error)

    def _bad(self, where: str, error: Exception) -> None:
        self.dump.bad += 1
        if len(self.dump.problems) < MOST_PROBLEMS:
            self.dump.problems.append(f"{where}: left out: {error}")


def encode(objects: Iterable[tuple[str, str, Any]]) -> bytes:
    """A dump of (apiVersion, kind, struct), as a `v1` List that `Reader` and kubectl can read."""
    encoder = msgspec.json.Encoder()
    lines = []
    for api_version, kind, obj in objects:
        head = encoder.encode({"apiVersion": api_version, "kind": kind})
        body = encoder.encode(obj)
        lines.append(head[:-1] + (b"," if body != b"{}" else b"") + body[1:])
    return b'{"apiVersion":"v1","kind":"List","items":[\n' + b",\n".join(lines) + b"\n]}\n"
