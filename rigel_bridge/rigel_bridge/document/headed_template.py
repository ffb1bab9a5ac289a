"""Rigel 0.3's templates: `{{ vars.name }}` and `{{ data.name }}`, the header is required.

A text that is one mark and nothing else takes the type of the value; in a longer text values stand as Python prints
them. A mark with a filter or quotes is left as it stands by Rigel, except that `regex_replace`, which other plugins of
Rigel know, is worked out here.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from rigel_bridge.document.failures import nearest
from rigel_bridge.document.template import MAX_NESTED, Spent, cure, environment_value, unfit
from rigel_bridge.document.tree import Node

_MARK: Final = re.compile(r"\{\{([a-zA-Z0-9_\s\-!?.]+)\}\}")
_REPLACE: Final = re.compile(
    r"\{\{\s*(vars\.[a-zA-Z0-9_\-]+)\s*\|\s*regex_replace\(\s*'([^'\\]{0,80})'\s*,\s*'([^'\\]{0,80})'\s*\)\s*\}\}"
)
_ANY_MARK: Final = re.compile(f"{_REPLACE.pattern}|{_MARK.pattern}")
_MAX_NESTED_LISTS: Final = 3
"""Each level may be as deep as a file, and everything behind walks the whole tree."""
_MAX_SUBJECT: Final = 256
"""Characters that `regex_replace` searches. What all of a file may cost is bounded as well."""
_REPETITIONS: Final = re.compile(r"[*+?{]")


@dataclass(frozen=True, slots=True)
class HeadedTemplates:
    """Where names are looked up. `environment` holds the variables that the user named; `data` one combination of a matrix."""

    variables: Mapping[str, Node] = field(default_factory=dict)
    environment: Mapping[str, str] = field(default_factory=dict)
    data: Mapping[str, Node] = field(default_factory=dict)
    spent: Spent = field(default_factory=Spent)

    def resolve(self, node: Node) -> Node:
        """The node with its marks replaced; of a mark alone, the node it stands for at this node's place."""
        return self._resolve(node, ())

    def render(self, node: Node, text: str) -> str:
        """A text that stands at `node`, as text."""
        return self._text(node, text, ())

    def keys(self, node: Node) -> Node:
        """The tree with the marks in its keys replaced, as Rigel does it; values are left alone."""
        if isinstance(node.value, list):
            return replace(node, value=[self.keys(child) for child in node.value])
        if not isinstance(node.value, dict):
            return node
        found: dict[str, Node] = {}
        for key, child in node.value.items():
            name = self.render(child, key) if "{{" in key else key
            if name in found:
                raise child.fail(f"key {name[:80]} is already in line {found[name].place.line}")
            found[name] = self.keys(child)
        return replace(node, value=found)

    def with_data(self, data: Mapping[str, Node]) -> "HeadedTemplates":
        """The same with one combination of a matrix; the bounds count on."""
        return replace(self, data=data)

    def _resolve(self, node: Node, inside: tuple[str, ...]) -> Node:
        if not isinstance(node.value, str):
            return node
        if whole := _MARK.fullmatch(node.value.strip()):
            found = self._named(node, _name(whole[1]), inside)
            return replace(found, place=node.place, path=node.path)
        text = self._text(node, node.value, inside)
        return node if text == node.value else replace(node, value=text)

    def _text(self, node: Node, text: str, inside: tuple[str, ...]) -> str:
        return _ANY_MARK.sub(lambda match: self._one(node, match, inside), text)

    def _one(self, node: Node, match: re.Match[str], inside: tuple[str, ...]) -> str:
        filtered, pattern, replacement, plain = match.groups()
        found = self._named(node, _name(plain or filtered), inside)
        if found.kind in ("map", "seq"):
            raise node.fail(f"{match[0]} stands for {found.described()}, which is no part of a text")
        value = _printed(found)
        if filtered:
            value = self._substituted(node, pattern, replacement, value)
        return self.spent.add(node, value)

    def _substituted(self, node: Node, pattern: str, replacement: str, value: str) -> str:
        """`regex_replace`. Without groups a search takes at most the length to the power of the repetitions, plus one."""
        if len(value) > _MAX_SUBJECT:
            raise node.fail(f"regex_replace takes at most {_MAX_SUBJECT} characters, found {len(value)}")
        repetitions = len(_REPETITIONS.findall(pattern))
        if "(" in pattern or repetitions > 2:
            raise node.fail(
                f"regex_replace takes a pattern without groups and with at most two repetitions: {pattern!r}"
            )
        self.spent.search(node, (len(value) + 1) ** (repetitions + 1))
        try:
            return re.sub(pattern, lambda _: replacement, value)
        except re.error as error:
            raise node.fail(f"regex_replace: {pattern!r} is no pattern: {error}") from error

    def _named(self, node: Node, name: str, inside: tuple[str, ...]) -> Node:
        self.spent.one_more(node)
        header, _, key = name.partition(".")
        if header == "data":
            return self._shared(node, key)
        if header == "secrets":
            raise node.fail(
                f"{{{{ {name} }}}} is a secret, and a RobotApp can be read by many: keep it in a Secret, "
                "and name that with envFrom or valueFrom of the component"
            )
        if header != "vars" or not key:
            hint = f"; write {{{{ vars.{name} }}}}" if name in self.variables else ""
            raise node.fail(f"{{{{ {name} }}}} has no header that Rigel knows; allowed: vars, data{hint}")
        return self._variable(node, key, inside)

    def _shared(self, node: Node, key: str) -> Node:
        if key not in self.data:
            raise node.fail(
                f"{{{{ data.{key} }}}} is known only while Rigel runs; here only a matrix of the sequence gives data"
            )
        return self._resolve(self.data[key], ())

    def _whole(self, node: Node, inside: tuple[str, ...]) -> Node:
        """A var with everything in it resolved, so that none stands for itself; each part counts against the bounds."""
        if isinstance(node.value, dict):
            parts = {key: self._whole(child, inside) for key, child in node.value.items()}
            self.spent.add(node, " " * len(parts))
            return replace(node, value=parts)
        if isinstance(node.value, list):
            self.spent.add(node, " " * len(node.value))
            return replace(node, value=[self._whole(child, inside) for child in node.value])
        return self._resolve(node, inside)

    def _variable(self, node: Node, key: str, inside: tuple[str, ...]) -> Node:
        if key in inside:
            raise node.fail(f"{{{{ vars.{key} }}}} stands for itself: {' -> '.join((*inside, key))}")
        if len(inside) >= MAX_NESTED:
            raise node.fail(f"vars stand for one another more than {MAX_NESTED} deep; write the value out")
        if key in self.variables:
            variable = self.variables[key]
            if variable.kind in ("map", "seq") and len(inside) >= _MAX_NESTED_LISTS:
                raise node.fail(f"lists and mappings stand for one another more than {_MAX_NESTED_LISTS} deep in vars")
            if isinstance(variable.value, str) and (problem := unfit(variable.value, allowed="\n\t")):
                raise variable.fail(problem)
            return self._whole(variable, (*inside, key))
        if key in self.environment:
            value = environment_value(node, key, self.environment)
            return replace(node, value=value, kind="str", raw=value)
        hint = nearest(key, sorted(self.variables))
        raise node.fail(f"{{{{ vars.{key} }}}} is not in vars{hint}{cure(key)}")


def _name(text: str) -> str:
    return re.sub(r"\s", "", text)


def _printed(node: Node) -> str:
    return "None" if node.value is None else str(node.value)
