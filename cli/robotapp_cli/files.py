"""Files a person names: YAML or JSON documents, and every mistake in them as one sentence."""

import sys
from pathlib import Path
from typing import Any, ClassVar, Final

import yaml

from robotapp_cli.failures import CliError, Exit

_TAG: Final = "tag:yaml.org,2002:"
_DEEPEST: Final = 200
"""Levels of nesting: libyaml's composer calls itself per level and ends the process where the stack does."""


_FOREIGN: Final = frozenset(f"{_TAG}{name}" for name in ("timestamp", "binary", "set", "omap", "pairs"))


class _Loader(yaml.CSafeLoader):
    """Only what JSON can say: a date stays the text it is to kubectl, and the tags JSON has nothing for are refused."""

    yaml_constructors: ClassVar = {
        **{tag: make for tag, make in yaml.CSafeLoader.yaml_constructors.items() if tag not in _FOREIGN},
        f"{_TAG}timestamp": yaml.CSafeLoader.construct_yaml_str,
    }


def documents(path: Path, *, most_bytes: int) -> list[Any]:
    """The documents of a file that are not empty; - is standard input. Raises CliError (wrong usage)."""
    try:
        if str(path) == "-":
            data = sys.stdin.buffer.read(most_bytes + 1)
        else:
            with path.open("rb") as file:
                data = file.read(most_bytes + 1)
        if len(data) > most_bytes:
            raise CliError(f"{path} is larger than {most_bytes >> 20} MiB", code=Exit.USAGE)
        return _parsed(data.decode("utf-8"))
    except OSError as error:
        raise CliError(f"{path} cannot be read: {error.strerror}", code=Exit.USAGE) from error
    except UnicodeDecodeError as error:
        raise CliError(f"{path} is not UTF-8 text", code=Exit.USAGE) from error
    except yaml.YAMLError as error:
        raise CliError(f"{path} is neither YAML nor JSON: {error}", code=Exit.USAGE) from error
    except RecursionError as error:
        raise CliError(f"{path} is nested deeper than {_DEEPEST} levels", code=Exit.USAGE) from error


def _parsed(text: str) -> list[Any]:
    _check_depth(text)
    return [found for found in yaml.load_all(text, _Loader) if found is not None]


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
