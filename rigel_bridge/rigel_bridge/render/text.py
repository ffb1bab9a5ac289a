"""Objects as YAML: the bytes that the command and the plugins write. Pure."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import yaml

from rigel_bridge.document.failures import BridgeError, Place, control_character, printable

MAX_CHARACTERS: Final = 1024 * 1024


def as_yaml(documents: Sequence[Mapping[str, Any]]) -> str:
    """The same bytes for the same objects: no anchors, no order but theirs. BridgeError when they are too many."""
    texts: list[str] = []
    for document in documents:
        text = yaml.dump(document, Dumper=_Plain, sort_keys=False, allow_unicode=True, width=120)
        # What would turn the text on a screen around stands in double quotes only, where an escape is the same character.
        texts.append("\n".join(printable(line) for line in text.split("\n")))
        if sum(map(len, texts)) > MAX_CHARACTERS:
            raise BridgeError(Place("Rigelfile"), "stands for more than 1 MiB of objects: choose fewer jobs")
    return "---\n".join(texts)


class _Plain(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002  # PyYAML's signature
        """Labels that two objects share are written out in both."""
        return True


def _text(dumper: _Plain, value: str) -> yaml.Node:
    style = '"' if control_character(value, allowed="\n") else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=style)


_Plain.add_representer(str, _text)
