"""YAML text to plain values that know where they stand.

Built from the parser's events, without recursion, so that the limits below hold before anything grows: a few lines of
aliases can name a billion values, and a megabyte of brackets can end the process.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import yaml

from robotapp_api.values.strict_yaml import MOST_VALUES
from robotapp_cli.lint.findings import Path, Place
from robotapp_cli.lint.scalars import resolved

DEEPEST: Final = 100
MOST_ALIASES: Final = 64
MOST_TEXT: Final = 4 << 20
_TAG: Final = "tag:yaml.org,2002:"
_PLAIN_TAGS: Final = frozenset(f"{_TAG}{name}" for name in ("int", "float", "bool", "null", "timestamp"))
_MERGE: Final = "<<"
_UNPRINTABLE: Final = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_CURES: Final = {
    "mapping values are not allowed": "indent the line like its neighbours, or put text that holds a colon in quotes",
    "did not find expected key": "indent the line like its neighbours",
    "did not find expected '-' indicator": "begin every entry of the list with -, indented alike",
    "did not find expected ',' or": "close the bracket or brace, and put a comma between its parts",
    "did not find expected node content": "close the bracket or brace, and put a comma between its parts",
    "found unexpected end of stream": "close the quotes",
    "invalid Unicode character escape code": "write the character itself in place of its \\u codes",
    "could not find expected ':'": "write a colon and a space after the name of the field",
}
"""What to do about a complaint of the parser."""
_OUTSIDE: Final = (
    "did not find expected key",
    "did not find expected '-' indicator",
    "did not find expected node content",
    "did not find expected <document start>",
)
"""Complaints about a bracket or brace that is met where none is open."""
_OPENERS: Final = {"}": "{", "]": "["}
OPENING: Final = "{{"
"""Of what Helm replaces."""
HELM: Final = "a Helm template is checked as it is rendered: helm template … | kubectl robotapp lint -"

_PAIR: Final = re.compile(r"(?<!\\)((?:\\\\)*)\\u([dD][89abAB][0-9a-fA-F]{2})\\u([dD][c-fC-F][0-9a-fA-F]{2})")
"""A high surrogate and its low one; not behind a backslash that stands for itself."""


class UnreadableError(Exception):
    """The text ends here for its reader: one sentence and the place."""

    def __init__(self, message: str, place: Place) -> None:
        super().__init__(message)
        self.message = message
        self.place = place


@dataclass(slots=True)
class Node:
    """A value with the place where it begins. A part that aliases repeat is one node that has several parents."""

    value: Any
    place: Place
    keys: dict[str, Place] = field(default_factory=dict)
    """Of a mapping: where the names of its fields stand."""
    inner: dict[str | int, "Node"] = field(default_factory=dict)
    """Parts by name or position."""
    size: int = 1
    height: int = 0
    text: str = ""
    """A plain scalar as it is written: `yes`, which kubectl reads as true."""

    def place_of(self, path: Path, *, at_key: bool = False) -> Place:
        """Where the value at `path` begins, or its name; of what is not written, the nearest part around it.

        A mapping or list begins at its name, because its first line is already about its first entry.
        """
        node, place = self, self.place
        for left, step in zip(range(len(path) - 1, -1, -1), path, strict=True):
            inner = node.inner.get(step)
            if inner is None:
                return place
            by_name = inner.inner or (at_key and not left)
            place = node.keys.get(str(step), inner.place) if by_name else inner.place
            node = inner
        return place

    def at(self, path: Path) -> "Node | None":
        """The node at `path`, if that is written."""
        node: Node | None = self
        for step in path:
            node = node.inner.get(step) if node else None
        return node


@dataclass(slots=True)
class Document:
    """One document of a text. `problems` are sentences about single places; the value is complete all the same."""

    root: Node
    problems: list[tuple[Place, str]]


def text_of(data: bytes) -> str:
    """Raises UnreadableError for what is no UTF-8 text, and for what is too much of it."""
    if len(data) > MOST_TEXT:
        raise UnreadableError(f"the file is larger than {MOST_TEXT >> 20} MiB; check its parts one by one", Place(1, 1))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - data.rfind(b"\n", 0, error.start)
        raise UnreadableError("this is no UTF-8 text; save the file as UTF-8", Place(line, column)) from error
    found = _UNPRINTABLE.search(text)
    if found:
        line, column = text.count("\n", 0, found.start()) + 1, found.start() - text.rfind("\n", 0, found.start())
        raise UnreadableError(
            f"the control character {found[0]!a} is not allowed in YAML; remove it", Place(line, column)
        )
    return text


def read(text: str) -> Iterator[Document]:
    """The documents that hold something, one by one. Raises UnreadableError where the text ends to be readable."""
    builder = _Builder()
    text = _without_pairs(text)
    try:
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            if builder.take(event):
                yield builder.document()
                builder = _Builder()
    except yaml.MarkedYAMLError as error:
        place = _place(error.problem_mark or error.context_mark)
        above, here = _lines(text, place)
        template = OPENING in above + here
        raise UnreadableError(_sentence(error, here[place.column - 1 :], template=template), place) from error
    except (yaml.YAMLError, RecursionError, MemoryError) as error:
        raise UnreadableError(f"this cannot be read as YAML: {' '.join(str(error).split())}", Place(1, 1)) from error


def _without_pairs(text: str) -> str:
    """JSON writes a character beyond 16 bits as two escapes, which YAML does not know; kubectl takes what begins with { as JSON."""
    if not text.lstrip().startswith("{"):
        return text

    def one(found: re.Match[str]) -> str:
        high, low = int(found[2], 16), int(found[3], 16)
        return f"{found[1]}\\U{0x10000 + ((high - 0xD800) << 10) + (low - 0xDC00):08X}"

    return _PAIR.sub(one, text)


def _place(mark: Any) -> Place:
    return Place(mark.line + 1, mark.column + 1) if mark else Place(1, 1)


def _lines(text: str, place: Place) -> tuple[str, str]:
    """The line above the place, and its own; "" for what the text does not have, because YAML counts other line ends as well."""
    lines = ["", *text.split("\n", place.line)]
    above, here = (lines[at] if at < len(lines) else "" for at in (place.line - 1, place.line))
    return above, here


def _sentence(error: yaml.MarkedYAMLError, rest: str, *, template: bool) -> str:
    """The parser's complaint with what to do; `rest` is the line from its place on. template: Helm has not rendered it."""
    problem = " ".join(str(error.problem or error.context or error).split())
    if problem == "found character that cannot start any token":
        if rest.startswith("\t"):
            return "a tab stands where YAML wants spaces; indent with spaces"
        return f"{rest[:1]!r} cannot begin a value; put the value in quotes"
    if template:
        return f"this is no YAML: {problem}; {HELM}"
    if rest[:1] in _OPENERS and any(part in problem for part in _OUTSIDE):
        return (
            f"this is no YAML: the {rest[0]} closes nothing; remove it, or write the {_OPENERS[rest[0]]} that it closes"
        )
    cure = next((cure for part, cure in _CURES.items() if part in problem), "")
    return f"this is no YAML: {problem}" + (f"; {cure}" if cure else "")


@dataclass(slots=True)
class _Frame:
    """A mapping or list that is being read. A mapping's parts are keys and values in turn."""

    place: Place
    anchor: str | None
    mapping: bool
    parts: list[tuple[Node, bool]] = field(default_factory=list)
    """Each with whether it is a plain `<<`."""


class _Builder:
    """One document."""

    def __init__(self) -> None:
        self.problems: list[tuple[Place, str]] = []
        self._open: list[_Frame] = []
        self._anchors: dict[str, Node] = {}
        self._aliases = 0
        self._values = 0
        self._root: Node | None = None

    def take(self, event: yaml.Event) -> bool:
        """Read one event; true at the end of a document that holds something."""
        place = _place(event.start_mark)
        if isinstance(event, yaml.ScalarEvent):
            self._count(place)
            self._add(self._scalar(event, place), event.anchor, merge=event.value == _MERGE and event.implicit[0])
        elif isinstance(event, yaml.AliasEvent):
            self._add(self._aliased(str(event.anchor), place), None)
        elif isinstance(event, yaml.CollectionStartEvent):
            self._count(place)
            if len(self._open) >= DEEPEST:
                raise UnreadableError(f"this is nested deeper than {DEEPEST} levels", place)
            if event.tag is not None and event.tag not in ("!", f"{_TAG}map", f"{_TAG}seq"):
                self.problems.append((place, f"{_named(event.tag)} is nothing JSON has; remove the tag"))
            self._open.append(_Frame(place, event.anchor, isinstance(event, yaml.MappingStartEvent)))
        elif isinstance(event, yaml.CollectionEndEvent):
            frame = self._open.pop()
            self._add(self._mapping(frame) if frame.mapping else self._list(frame), frame.anchor)
        return isinstance(event, yaml.DocumentEndEvent) and self._root is not None and self._root.value is not None

    def document(self) -> Document:
        if self._root is None:
            raise ValueError("no document has ended")
        return Document(self._root, self.problems)

    def _count(self, place: Place) -> None:
        self._values += 1
        if self._values > MOST_VALUES:
            raise UnreadableError(f"a document of more than {MOST_VALUES} values is not checked", place)

    def _add(self, node: Node, anchor: str | None, *, merge: bool = False) -> None:
        if node.size > MOST_VALUES:
            raise UnreadableError(f"aliases make this more than {MOST_VALUES} values; write fewer of them", node.place)
        if len(self._open) + node.height > DEEPEST:
            raise UnreadableError(f"this is nested deeper than {DEEPEST} levels", node.place)
        if anchor:
            self._anchors[anchor] = node
        if self._open:
            self._open[-1].parts.append((node, merge))
        else:
            self._root = node

    def _aliased(self, anchor: str, place: Place) -> Node:
        self._aliases += 1
        if self._aliases > MOST_ALIASES:
            raise UnreadableError(f"more than {MOST_ALIASES} aliases are not followed; write the values out", place)
        if anchor not in self._anchors:
            raise UnreadableError(f"*{anchor} names nothing that is complete here; write &{anchor} before it", place)
        return self._anchors[anchor]

    def _scalar(self, event: yaml.ScalarEvent, place: Place) -> Node:
        text = str(event.value)
        if event.tag in ("!", f"{_TAG}str") or not (event.implicit[0] or event.tag):
            return Node(text, place)
        if event.tag is not None and event.tag not in _PLAIN_TAGS:
            self.problems.append((place, f"{_named(event.tag)} is nothing JSON has; remove the tag"))
            return Node(text, place)
        try:
            return Node(resolved(text), place, text=text)
        except ValueError as error:
            self.problems.append((place, str(error)))
            return Node(text, place)

    def _list(self, frame: _Frame) -> Node:
        nodes = [node for node, _ in frame.parts]
        node = Node([each.value for each in nodes], frame.place, inner=dict(enumerate(nodes)))
        return _measured(node, nodes)

    def _mapping(self, frame: _Frame) -> Node:
        node = Node({}, frame.place)
        merged: list[Node] = []
        parts = iter(frame.parts)
        for (key, is_merge), (value, _) in zip(parts, parts, strict=True):
            if is_merge:
                merged.append(value)
                continue
            name = self._name(key)
            if name in node.keys:
                self.problems.append((key.place, _twice(name, node.keys[name])))
            if name is not None:
                node.keys[name], node.inner[name], node.value[name] = key.place, value, value.value
        for each in merged:
            self._merge(node, each)
        return _measured(node, list(node.inner.values()))

    def _name(self, key: Node) -> str | None:
        """A key as JSON has it: text."""
        if isinstance(key.value, bool):
            return "true" if key.value else "false"
        if isinstance(key.value, str | int | float):
            return str(key.value)
        helm = f"; {HELM}" if isinstance(key.value, dict) else ""  # {{ .Values.name }} is a mapping as a name
        self.problems.append((key.place, f"the name of a field must be text{helm}"))
        return None

    def _merge(self, node: Node, source: Node) -> None:
        """`<<: *base`: the fields of another mapping, or of several, that the mapping has not itself."""
        sources = list(source.inner.values()) if isinstance(source.value, list) else [source]
        for each in sources:
            if not isinstance(each.value, dict):
                self.problems.append((each.place, "<< takes a mapping or a list of mappings"))
                continue
            self._values += len(each.keys)
            self._count(each.place)
            for name, place in each.keys.items():
                if name not in node.keys:
                    node.keys[name], node.inner[name], node.value[name] = place, each.inner[name], each.value[name]


def _measured(node: Node, parts: list[Node]) -> Node:
    node.size = 1 + sum(part.size for part in parts)
    node.height = 1 + max((part.height for part in parts), default=0)
    return node


def _named(tag: str) -> str:
    return f"!!{tag.removeprefix(_TAG)}" if tag.startswith(_TAG) else tag


def _twice(name: str, first: Place) -> str:
    return f"{name} is written twice, here and in line {first.line}; one of the two would be lost, so remove one"
