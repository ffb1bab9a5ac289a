"""YAML to plain values, strictly: a key written twice is an error, because one of the two would be lost in silence.

What stands in the text may be repeated by aliases: a line each doubles it, so the values are counted too. libyaml reads it six
times as fast as PyYAML alone; it would overflow the stack at some ten thousand levels, so levels are counted first.
"""

from collections.abc import Hashable
from typing import Any, Final

import yaml

MOST_VALUES: Final = 100_000
DEEPEST: Final = 100
_MERGE: Final = "tag:yaml.org,2002:merge"
"""Refused: a few lines of it make more keys than fit in memory, before they could be counted."""
_NUMBERS: Final = frozenset({"tag:yaml.org,2002:int", "tag:yaml.org,2002:float"})
_LONGEST_NUMBER: Final = 1000


class StrictLoader(yaml.CSafeLoader):
    """A safe loader that refuses duplicate keys, keys that are no scalars, and numbers without end."""

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        value = super().construct_scalar(node)
        if node.tag in _NUMBERS and len(value) > _LONGEST_NUMBER:  # seconds for one of sixties, as `1:1:1…`
            line = node.start_mark.line + 1
            raise yaml.YAMLError(
                f"line {line}: a number of {len(value)} characters; write it in quotes if it is a text"
            )
        return value

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[object] = set()
        for key_node, _ in node.value:
            line = key_node.start_mark.line + 1
            if key_node.tag == _MERGE:
                raise yaml.YAMLError(f'line {line}: "<<" is not read here: write the fields out')
            if not isinstance(key_node, yaml.ScalarNode):  # of aliases in aliases it would take hours to write it out
                raise yaml.YAMLError(f"line {line}: a key is a list or a map; write a text")
            key = self.construct_object(key_node, deep=True)
            if key in seen:
                raise yaml.YAMLError(f'line {line}: key "{key}" already set in map')
            seen.add(key)
        return super().construct_mapping(node, deep)


def loads(text: str) -> object:
    """The text's one document. Raises `yaml.YAMLError`."""
    try:
        _shallow(text)
        document: object = yaml.load(text, Loader=StrictLoader)  # noqa: S506 - StrictLoader is a SafeLoader
    except yaml.MarkedYAMLError as error:
        raise yaml.YAMLError(_describe_mistake(error)) from error
    except (ValueError, RecursionError) as error:
        # A date that is none, a number of a million digits, a million brackets: the parser lets these through.
        raise yaml.YAMLError(str(error)) from error
    except (LookupError, AttributeError, TypeError, ArithmeticError) as error:
        # A written tag on a value that is nothing of its kind, such as `!!bool x`: PyYAML's constructors expect the best.
        raise yaml.YAMLError(f"a value does not fit the tag that is written before it ({error})") from error
    _bounded(document)
    return document


def _describe_mistake(error: yaml.MarkedYAMLError) -> str:
    """Returns the parser's mistake with its line, without the name that the parser gives to texts that are no file."""
    mark = error.problem_mark or error.context_mark
    words = ", ".join(filter(None, (error.context, error.problem)))
    return f"line {mark.line + 1}, column {mark.column + 1}: {words}" if mark else words


def _shallow(text: str) -> None:
    """Refuse a text that is nested too deep. The parser's events are read one by one, which needs no stack."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > DEEPEST:
            raise yaml.YAMLError(f"{_place(event)}nested deeper than {DEEPEST} levels")


def _place(event: yaml.Event) -> str:
    return f"line {event.start_mark.line + 1}: " if event.start_mark else ""


def _bounded(document: object) -> None:
    """An alias may stand inside what it names, or ten of them may name ten others each."""
    left, found = [document], 0
    while left:
        value = left.pop()
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        found += len(inner)
        if found > MOST_VALUES:
            raise yaml.YAMLError(f"more than {MOST_VALUES} values, or one that holds itself")
        left.extend(inner)
