"""Files a person names: YAML or JSON documents, and every mistake in them as one sentence."""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, Final

import yaml

from robotapp_cli.failures import CliError, Exit

_TAG: Final = "tag:yaml.org,2002:"
_DEEPEST: Final = 200
"""Levels of nesting: libyaml's composer calls itself per level and ends the process where the stack does."""


_HALF: Final = re.compile(r"\\u[dD][89a-fA-F]")
"""Half a character, whose other half may be missing: the JSON parser does not mind."""
_FOREIGN: Final = frozenset(f"{_TAG}{name}" for name in ("timestamp", "binary", "set", "omap", "pairs"))


class _Loader(yaml.CSafeLoader):
    """Only what JSON can say: a date stays the text it is to kubectl, and the tags JSON has nothing for are refused."""

    yaml_constructors: ClassVar = {
        **{tag: make for tag, make in yaml.CSafeLoader.yaml_constructors.items() if tag not in _FOREIGN},
        f"{_TAG}timestamp": yaml.CSafeLoader.construct_yaml_str,
    }


def content(path: Path, *, most_bytes: int) -> bytes:
    """The bytes of a file, - is standard input; one more than `most_bytes` of a file that is larger. Raises CliError."""
    try:
        if str(path) == "-":
            return sys.stdin.buffer.read(most_bytes + 1)
        with path.open("rb") as file:
            return file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # a NUL in a name is a ValueError
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise CliError(f"{path} cannot be read: {why}", code=Exit.USAGE) from error


def documents(path: Path, *, most_bytes: int) -> list[Any]:
    """The documents of a file that are not empty; - is standard input. Raises CliError (wrong usage)."""
    data = content(path, most_bytes=most_bytes)
    if len(data) > most_bytes:
        raise CliError(f"{path} is larger than {most_bytes >> 20} MiB", code=Exit.USAGE)
    try:
        return _parsed(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise CliError(f"{path} is not UTF-8 text", code=Exit.USAGE) from error
    except (yaml.YAMLError, ValueError) as error:  # a number of thousands of digits is a ValueError
        raise CliError(f"{path} is neither YAML nor JSON: {error}", code=Exit.USAGE) from error
    except RecursionError as error:
        raise CliError(f"{path} is nested deeper than {_DEEPEST} levels", code=Exit.USAGE) from error


def objects(path: Path, *, most_bytes: int) -> Iterator[dict[str, Any]]:
    """The Kubernetes objects of a file, Lists taken apart; - is standard input. Raises CliError (wrong usage)."""
    for document in documents(path, most_bytes=most_bytes):
        for found in _items(document):
            if not isinstance(found, dict):
                raise CliError(f"{path}: holds something that is no Kubernetes object", code=Exit.USAGE)
            yield found


def _items(document: Any) -> list[Any]:
    if not (isinstance(document, dict) and str(document.get("kind", "")).endswith("List")):
        return [document]
    items = document.get("items") or []
    return items if isinstance(items, list) else [items]


def _parsed(text: str) -> list[Any]:
    if text.lstrip().startswith(("{", "[")):
        try:
            return [_from_json(text)]
        except ValueError:
            pass  # YAML may begin so, too
    _check_depth(text)
    return [found for found in yaml.load_all(text, _Loader) if found is not None]


def _from_json(text: str) -> Any:
    """A dump of a cluster would take the YAML parser minutes. Raises ValueError."""
    document = json.loads(text, parse_constant=_no_number)
    if _HALF.search(text):
        json.dumps(document, ensure_ascii=False).encode()
    return _shallow(document)


def _no_number(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def _shallow(document: Any) -> Any:
    """The document as it is. Raises RecursionError when it is nested too deep."""
    level = [document]
    for _ in range(_DEEPEST):
        inner = [each.values() if isinstance(each, dict) else each for each in level]
        level = [value for values in inner for value in values if isinstance(value, dict | list)]
        if not level:
            return document
    raise RecursionError


def _check_depth(text: str) -> None:
    """Raise RecursionError as Python's own parsers do."""
    depth = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _DEEPEST:
            raise RecursionError
