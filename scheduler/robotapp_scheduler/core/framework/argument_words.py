"""Arguments of plugins that take one of a few words: declared once, for the plugin's own check and for forms."""

from collections.abc import Sequence

import msgspec


def one_of(words: Sequence[str]) -> msgspec.Meta:
    """Returns the annotation of a field that takes one of these words; a form offers them."""
    return msgspec.Meta(extra_json_schema={"enum": list(words)})


def check_word(name: str, value: str, words: Sequence[str]) -> None:
    """Raises ValueError for another word."""
    if value not in words:
        raise ValueError(f"{name}: {value!r} is not allowed; write {' or '.join(words)}")
