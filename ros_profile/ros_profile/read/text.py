"""Bytes of a source file to text, whatever the encoding."""

from typing import Final

MAX_LINE: Final = 20_000
"""Longer lines are data or generated code: nothing in them is evidence, and some readers are slow on them."""


def decode(data: bytes) -> str:
    """UTF-8 (with or without a byte order mark), UTF-16 with one, else Latin-1, which every file can be read as. Line
    ends become line feeds and NUL characters spaces, so that line numbers are those of an editor.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").replace("\0", " ")


def printable(text: str) -> str:
    """The text without halves of characters, which no encoding can write."""
    return text.encode("utf-8", "replace").decode()
