"""Objects as YAML: the bytes that the command and the plugins write. Pure."""

from collections.abc import Mapping, Sequence
from typing import Any

import yaml


def as_yaml(documents: Sequence[Mapping[str, Any]]) -> str:
    """The same bytes for the same objects: no anchors, no order but theirs."""
    return yaml.dump_all(documents, Dumper=_Plain, sort_keys=False, allow_unicode=True, width=120)


class _Plain(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002  # PyYAML's signature
        """Labels that two objects share are written out in both."""
        return True
