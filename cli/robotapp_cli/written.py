"""Names as a person wrote them: checked before they become part of a URL, where `/` would address something else."""

import typer

from robotapp_api.values.arguments import is_name, not_a_name


def object_name(text: str | None) -> str | None:
    """A callback of typer that refuses what no object can be called; None (not given) stays None."""
    if text is not None and not is_name(text):
        raise typer.BadParameter(not_a_name(text))
    return text
