"""Keys of labels and annotations and values of labels, as Kubernetes takes them. A key is a name, and before it a DNS name and
a slash if it has a prefix.
"""

import re
from typing import Final

from robotapp_api.model.app.robots import LABEL_KEY
from robotapp_api.model.patterns import LABEL_VALUE_PATTERN, SUBDOMAIN_PATTERN

_WHOLE: Final = re.compile(LABEL_KEY)
_PREFIX: Final = re.compile(SUBDOMAIN_PATTERN)
_VALUE: Final = re.compile(LABEL_VALUE_PATTERN)
_LONGEST_NAME: Final = 63
_LONGEST_VALUE: Final = 63
_LONGEST_PREFIX: Final = 253
_SHOWN: Final = 60


def key_problem(key: str) -> str:
    """Why Kubernetes refuses a label or annotation with this key, and what to write; "" where it takes it."""
    prefix, slash, name = key.rpartition("/")
    shown = _shown(key)
    for part, what, most in ((name, "name", _LONGEST_NAME), (prefix, "prefix", _LONGEST_PREFIX)):
        if len(part) > most:
            return f'the {what} in key "{shown}" has {len(part)} characters; write at most {most}'
    if not _WHOLE.fullmatch(key) or (slash and not _PREFIX.fullmatch(prefix)):
        return f'"{shown}" is no label or annotation key; write for example example.com/team'
    return ""


def value_problem(value: str) -> str:
    """Why Kubernetes refuses a label with this value, and what to write; "" where it takes it."""
    if len(value) > _LONGEST_VALUE:
        return f'the value "{_shown(value)}" has {len(value)} characters; write at most {_LONGEST_VALUE}'
    if not _VALUE.fullmatch(value):
        return f'"{_shown(value)}" is no value of a label; write letters, digits, "-", "_" and ".", and begin and end with a letter or digit'
    return ""


def _shown(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
