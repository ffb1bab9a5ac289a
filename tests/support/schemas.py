"""The schema of every kind as the API server has it, and its CEL rules as `kubectl robotapp lint` evaluates them."""

from collections.abc import Iterator

from robotapp_api.schema.crd import KINDS, schema_of
from robotapp_cli.lint.cel_rules import RULES, Broken, Schema, broken_rules, with_defaults

__all__ = ["SCHEMAS", "Broken", "Schema", "all_rules", "broken_rules", "with_defaults"]

SCHEMAS = {model.__name__: schema_of(model) for model in KINDS}
"""Made once; a test must not change it."""


def all_rules(schema: Schema) -> Iterator[dict[str, str]]:
    """Yields every CEL rule of a schema and of the schemas in it."""
    yield from schema.get(RULES, ())
    for child in [*schema.get("properties", {}).values(), schema.get("items"), schema.get("additionalProperties")]:
        if child:
            yield from all_rules(child)
