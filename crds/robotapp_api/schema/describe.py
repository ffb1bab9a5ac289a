"""Descriptions of fields, read from the sentence under each attribute.

Read from source when the schema is generated, so that importing the models costs nothing for it.
"""

import ast
import inspect
import textwrap

from robotapp_api.model.base import Model


def fields_of(model: type[Model]) -> dict[str, str]:
    """Attribute name → description, including inherited attributes."""
    texts: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if issubclass(base, Model) and base is not Model:
            texts |= _attributes(base)
    return texts


def text_of(model: type[Model]) -> str:
    """Description of the model itself."""
    return flat(model.__doc__ or "")


def flat(text: str) -> str:
    """One line, as explain texts are."""
    return " ".join(text.split())


def _attributes(cls: type) -> dict[str, str]:
    try:
        source = inspect.getsource(cls)
    except OSError:  # made at run time: nobody wrote a sentence
        return {}
    definition = ast.parse(textwrap.dedent(source)).body[0]
    if not isinstance(definition, ast.ClassDef):
        return {}
    texts = {}
    for statement, following in zip(definition.body, definition.body[1:], strict=False):
        if (
            isinstance(statement, ast.AnnAssign)
            and isinstance(statement.target, ast.Name)
            and isinstance(following, ast.Expr)
            and isinstance(following.value, ast.Constant)
            and isinstance(following.value.value, str)
        ):
            texts[statement.target.id] = flat(following.value.value)
    return texts
