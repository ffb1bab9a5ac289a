"""Values of parameters on a command line, where ROS reads them as YAML: which texts must be quoted to stay texts."""

import re
from typing import Final

_PLAIN: Final = re.compile(r"[A-Za-z_/][\w/.+-]*(?: [\w/.+-]+)*", re.ASCII)
_NO_TEXT: Final = frozenset(
    {"y", "yes", "n", "no", "on", "off", "true", "false", "null", "nan", "inf", "infinity", ".nan", ".inf"}
)
"""Words that YAML, or the parser of rcl, reads as something else than a text."""


def quote_text(text: str) -> str:
    """Returns YAML that is read as this very text: the text itself, or the text in quotes."""
    if _PLAIN.fullmatch(text) and text.lower() not in _NO_TEXT:
        return text
    return "'" + text.replace("'", "''") + "'"
