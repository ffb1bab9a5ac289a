"""YAML to plain values, strictly: a key written twice is an error, because one of the two would be lost in silence.

What stands in the text may be repeated by aliases: a line each doubles it, so the values are counted too.
"""

from collections.abc import Hashable
from typing import Any, Final

import yaml

MOST_VALUES: Final = 100_000
_MERGE: Final = "tag:yaml.org,2002:merge"
"""Refused: a few lines of it make more keys than fit in memory, before they could be counted."""


class StrictLoader(yaml.SafeLoader):
    """SafeLoader that refuses duplicate keys and what is no text."""

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        value = super().construct_scalar(node)
        try:
            value.encode()
        except (
            UnicodeEncodeError
        ) as error:  # "\ud800" may be written, but nothing can be made of it: no JSON, no digest
            line = node.start_mark.line + 1
            raise yaml.YAMLError(f"line {line}: {value[error.start]!a} is half a character") from error
        return value

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[object] = set()
        for key_node, _ in node.value:
            line = key_node.start_mark.line + 1
            if key_node.tag == _MERGE:
                raise yaml.YAMLError(f'line {line}: "<<" is not read here: write the fields out')
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, Hashable) and key in seen:
                raise yaml.YAMLError(f'line {line}: key "{key}" already set in map')
            seen.add(key if isinstance(key, Hashable) else str(key))
        return super().construct_mapping(node, deep)


def loads(text: str) -> object:
    """The text's one document. Raises `yaml.YAMLError`."""
    try:
        document: object = yaml.load(text, Loader=StrictLoader)  # noqa: S506 - StrictLoader is a SafeLoader
    except (ValueError, RecursionError) as error:
        # A date that is none, a number of a million digits, a million brackets: the parser lets these through.
        raise yaml.YAMLError(str(error)) from error
    except (LookupError, AttributeError, TypeError, ArithmeticError) as error:
        # A written tag on a value that is nothing of its kind, such as `!!bool x`: PyYAML's constructors expect the best.
        raise yaml.YAMLError(f"a value does not fit the tag that is written before it ({error})") from error
    _bounded(document)
    return document


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
