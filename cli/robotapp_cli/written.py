"""Names as a person wrote them: checked before they become part of a URL, where `/` would address something else."""

import typer

from robotapp_api.claims.identity import DNS_LABEL


def is_name(text: str) -> bool:
    """Whether any object can have this name: DNS labels joined by dots."""
    return all(DNS_LABEL.fullmatch(label) for label in text.split("."))


def not_a_name(text: str) -> str:
    return f"{text!r} is not a name; names consist of lower-case letters, digits, '-' and '.', for example teleop"


def object_name(text: str | None) -> str | None:
    """A callback of typer that refuses what no object can be called; None (not given) stays None."""
    if text is not None and not is_name(text):
        raise typer.BadParameter(not_a_name(text))
    return text
