"""Keys of labels and annotations, as Kubernetes takes them: a name, and before it a DNS name and a slash if it has a prefix."""

import re
from typing import Final

from robotapp_api.model.robots import LABEL_KEY
from robotapp_api.model.scalars import SUBDOMAIN_PATTERN

_WHOLE: Final = re.compile(LABEL_KEY)
_PREFIX: Final = re.compile(SUBDOMAIN_PATTERN)
_LONGEST_NAME: Final = 63
_LONGEST_PREFIX: Final = 253
_SHOWN: Final = 60


def key_problem(key: str) -> str:
    """Why Kubernetes refuses a label or annotation with this key, and what to write; "" where it takes it."""
    prefix, slash, name = key.rpartition("/")
    shown = key if len(key) <= _SHOWN else f"{key[:_SHOWN]}…"
    for part, what, most in ((name, "name", _LONGEST_NAME), (prefix, "prefix", _LONGEST_PREFIX)):
        if len(part) > most:
            return f'the {what} in key "{shown}" has {len(part)} characters; write at most {most}'
    if not _WHOLE.fullmatch(key) or (slash and not _PREFIX.fullmatch(prefix)):
        return f'"{shown}" is no label or annotation key; write for example example.com/team'
    return ""
