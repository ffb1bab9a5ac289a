"""Typed access to one mapping of a Rigelfile: every getter checks the type and names the place."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from rigel_bridge.document.failures import closest, nearest
from rigel_bridge.document.tree import Node


class Resolver(Protocol):
    """The template rules of a generation. Only text that is used is rendered."""

    def resolve(self, node: Node) -> Node:
        """The node with its marks replaced."""

    def render(self, node: Node, text: str) -> str:
        """A text that stands at `node`, as text."""


@dataclass(frozen=True, slots=True)
class Section:
    """A mapping with its templates. Getters give None for an absent key (or an empty one: `key:`)."""

    node: Node
    templates: Resolver

    def __contains__(self, key: str) -> bool:
        return self.get(key) is not None

    def get(self, key: str) -> Node | None:
        found = self.node.mapping().get(key)
        return None if found is None or found.kind == "null" else found

    def first(self, *keys: str) -> Node | None:
        """The one of several spellings that is there; two of them are an error."""
        found = [node for key in keys if (node := self.get(key))]
        if len(found) > 1:
            raise found[1].fail(f"means the same as {found[0].path} in line {found[0].place.line}: keep one")
        return found[0] if found else None

    def refuse_unknown(self, known: Collection[str]) -> None:
        for key, node in self.unknown(known):
            text = f"is not known here{nearest(key, list(known))}; known: {', '.join(known)}"
            raise node.fail(text, meant=closest(key, list(known)))

    def unknown(self, known: Collection[str]) -> Iterator[tuple[str, Node]]:
        yield from ((key, node) for key, node in self.node.mapping().items() if key not in known)

    def text(self, key: str) -> str | None:
        found = self.get(key)
        return None if found is None else self.text_of(found)

    def required_text(self, key: str) -> str:
        found = self.text(key)
        if not found:
            raise self.node.fail(f"{key} is missing")
        return found

    def text_of(self, node: Node) -> str:
        found = self.templates.resolve(node)
        if not isinstance(found.value, str):
            hint = "" if found.kind in ("map", "seq") else "; put it in quotes"
            raise node.fail(f"expected text, found {found.described()}{hint}")
        return found.value

    def choice(self, key: str, allowed: Collection[str]) -> str | None:
        found = self.text(key)
        if found is not None and found not in allowed:
            node = self.get(key) or self.node
            raise node.fail(f"{found!r} is not allowed{nearest(found, list(allowed))}; allowed: {', '.join(allowed)}")
        return found

    def flag(self, key: str) -> bool | None:
        found = self.resolved(key)
        if found is not None and not isinstance(found.value, bool):
            raise found.fail(f"expected true or false, found {found.described()}")
        return None if found is None else bool(found.value)

    def number(self, key: str) -> int | None:
        found = self.resolved(key)
        if found is None:
            return None
        if not isinstance(found.value, int) or isinstance(found.value, bool):
            raise found.fail(f"expected a whole number, found {found.described()}")
        return found.value

    def resolved(self, key: str) -> Node | None:
        found = self.get(key)
        return None if found is None else self.templates.resolve(found)

    def texts(self, key: str) -> list[str]:
        found = self.resolved(key)
        return [] if found is None else [self.text_of(item) for item in found.sequence()]

    def section(self, key: str) -> "Section | None":
        found = self.resolved(key)
        return None if found is None else self.at(found)

    def sections(self, key: str) -> "list[Section]":
        found = self.resolved(key)
        return [] if found is None else [self.at(item) for item in found.sequence()]

    def at(self, node: Node) -> "Section":
        found = self.templates.resolve(node)
        found.mapping()
        return Section(found, self.templates)

    def plain(self, node: Node) -> Any:
        """The node as plain data, templates rendered."""
        value = self.templates.resolve(node).value
        if isinstance(value, dict):
            return {key: self.plain(child) for key, child in value.items()}
        if isinstance(value, list):
            return [self.plain(child) for child in value]
        return value
