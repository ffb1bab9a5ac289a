"""The objects of an import as YAML that kubectl reads as they are."""

from typing import Any, Final

import yaml

from robotapp_cli.importing.services.draft import Json
from robotapp_cli.lint.scalars import resolved

_WIDTH: Final = 120
_TEXT: Final = "tag:yaml.org,2002:str"


class _Dumper(yaml.SafeDumper):
    """Quotes what PyYAML reads as text and kubectl as something else, such as y, and writes long text as a block."""

    def ignore_aliases(self, _data: Any) -> bool:
        """Writes equal parts out, each in its place."""
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    if "\n" in text and not any(line.endswith((" ", "\t")) for line in text.splitlines()) and text.isascii():
        return dumper.represent_scalar(_TEXT, text, style="|")
    try:
        is_plain = isinstance(resolved(text), str)
    except ValueError:
        is_plain = False
    return dumper.represent_scalar(_TEXT, text, style=None if is_plain else "'")


_Dumper.add_representer(str, _represent_text)


def format_objects(objects: list[Json]) -> str:
    """Returns the documents, with control characters escaped."""
    text = _dump(objects, allow_unicode=True)
    return text if text.replace("\n", "").isprintable() else _dump(objects, allow_unicode=False)


def _dump(objects: list[Json], *, allow_unicode: bool) -> str:
    return str(yaml.dump_all(objects, Dumper=_Dumper, sort_keys=False, allow_unicode=allow_unicode, width=_WIDTH))
