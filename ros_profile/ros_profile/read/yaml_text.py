"""YAML within bounds, with lines: no tags, no aliases, limited depth and size. Scalars stay as they are written."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import yaml

from ros_profile.model.facts import Problem
from ros_profile.read.text import decode, printable

MAX_BYTES: Final = 1 << 20
MAX_DEPTH: Final = 40
MAX_NODES: Final = 100_000
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(slots=True)
class Node:
    """`value` is text, a list of nodes, or a list of (key, key line, node)."""

    value: "str | list[Node] | list[tuple[str, int, Node]]"
    line: int
    kind: str
    """scalar | seq | map"""
    quoted: bool = False

    def items(self) -> "list[tuple[str, int, Node]]":
        return self.value if self.kind == "map" else []  # type: ignore[return-value]

    def elements(self) -> "list[Node]":
        return self.value if self.kind == "seq" else []  # type: ignore[return-value]

    def get(self, key: str) -> "Node | None":
        return next((node for name, _, node in self.items() if name == key), None)

    @property
    def text(self) -> str:
        """A scalar as written; a list of scalars as `[a, b]`; empty for a mapping."""
        if isinstance(self.value, str):
            return self.value
        if self.kind == "seq":
            return "[" + ", ".join(node.text for node in self.elements()) + "]"
        return ""


class _LimitError(Exception):
    pass


def parse(data: bytes, file: str) -> tuple[Node | None, tuple[Problem, ...]]:
    """The first document. What stands before a mistake is kept, and the mistake is a problem."""
    if len(data) > MAX_BYTES:
        return None, (Problem(file, f"has {len(data)} bytes; at most {MAX_BYTES} are read"),)
    builder = _Builder(file)
    try:
        for event in yaml.parse(decode(data), Loader=_LOADER):
            if builder.take(event):
                break
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        reason = getattr(error, "problem", None) or "is not YAML"
        builder.problems.append(Problem(file, f"is not YAML: {reason}", mark.line + 1 if mark else 0))
    except (_LimitError, ValueError) as error:
        builder.problems.append(Problem(file, str(error)))
    return builder.root, tuple(builder.problems)


class _Builder:
    """The tree from the parser's events, which cost nothing that was not written: aliases are not followed."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.root: Node | None = None
        self.problems: list[Problem] = []
        self.count = 0
        self._open: list[Node] = []
        self._keys: list[tuple[str, int] | None] = []
        self._seen: list[set[str]] = []
        """Keys of each open collection: looking through its items would take the square of their number."""

    def take(self, event: Any) -> bool:
        """True: the first document is complete."""
        if isinstance(event, yaml.ScalarEvent):
            self._add(Node(printable(event.value), _line(event), "scalar", event.style in ("'", '"')))
        elif isinstance(event, yaml.AliasEvent):
            line = _line(event)
            self.problems.append(
                Problem(self.file, f"alias *{event.anchor} is not followed; write the value out", line)
            )
            self._add(Node("", line, "scalar"))
        elif isinstance(event, yaml.MappingStartEvent | yaml.SequenceStartEvent):
            node = Node([], _line(event), "map" if isinstance(event, yaml.MappingStartEvent) else "seq")
            self._add(node)
            self._open.append(node)
            self._keys.append(None)
            self._seen.append(set())
            if len(self._open) > MAX_DEPTH:
                raise _LimitError(f"is nested deeper than {MAX_DEPTH} levels; the rest is not read")
        elif isinstance(event, yaml.MappingEndEvent | yaml.SequenceEndEvent):
            self._open.pop()
            self._keys.pop()
            self._seen.pop()
        return isinstance(event, yaml.DocumentEndEvent)

    def _add(self, node: Node) -> None:
        self.count += 1
        if self.count > MAX_NODES:
            raise _LimitError(f"has more than {MAX_NODES} values; the rest is not read")
        if not self._open:
            self.root = node
            return
        parent = self._open[-1]
        if parent.kind == "seq":
            parent.elements().append(node)
            return
        key = self._keys[-1]
        if key is None:
            self._keys[-1] = (node.text, node.line)
            return
        self._keys[-1] = None
        if key[0] in self._seen[-1] and len(parent.items()) < 1000:
            self.problems.append(
                Problem(
                    self.file,
                    f"key {key[0][:80]!r} stands here twice; which one counts depends on the loader: keep one",
                    key[1],
                )
            )
        self._seen[-1].add(key[0])
        parent.items().append((key[0], key[1], node))


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1


def scalars(node: Node, prefix: str = "") -> Iterator[tuple[str, Node]]:
    """(dotted name, scalar or list) of everything below a mapping."""
    for key, _, child in node.items():
        name = f"{prefix}{key}"
        if child.kind == "map":
            yield from scalars(child, f"{name}.")
        else:
            yield name, child
