"""What a person wrote: names, checked before they become part of a URL, where `/` would address something else; addresses."""

from typing import Final
from urllib.parse import urlsplit

import typer

from robotapp_api.model.names import GROUP
from robotapp_api.values.arguments import is_name, not_a_name

_KINDS: Final = frozenset(
    {"ra", "robotapp", "robotapps", f"robotapp.{GROUP}", f"robotapps.{GROUP}", "no", "node", "nodes", "ns", "namespace"}
)


def object_name(text: str | None) -> str | None:
    """A callback of typer that refuses what no object can be called; None (not given) stays None.

    The kind in front of a name goes, as kubectl prints it with `-o name`.
    """
    kind, _, name = (text or "").partition("/")
    if kind.lower() in _KINDS:
        text = name
    if text is not None and not is_name(text):
        raise typer.BadParameter(not_a_name(text))
    return text


def address(text: str | None) -> str | None:
    """A callback of typer that refuses what no server can be asked at; None (not given) stays None."""
    if text is not None and not _is_address(text):
        raise typer.BadParameter(f"{text!r} is no URL such as https://127.0.0.1:10259")
    return text


def _is_address(text: str) -> bool:
    try:
        parts = urlsplit(text)
        return parts.scheme in {"https", "http"} and bool(parts.hostname) and parts.port != 0
    except ValueError:  # such as a port above 65535
        return False
