"""The rules of a CRD, evaluated the way the API server does: by the evaluator of `kubectl robotapp lint`, so that there is one."""

from collections.abc import Iterator

from robotapp_cli.lint.cel_rules import RULES, Broken, Schema, broken_rules, with_defaults

__all__ = ["Broken", "Schema", "all_rules", "broken_rules", "with_defaults"]


def all_rules(schema: Schema) -> Iterator[dict[str, str]]:
    yield from schema.get(RULES, ())
    for child in [*schema.get("properties", {}).values(), schema.get("items"), schema.get("additionalProperties")]:
        if child:
            yield from all_rules(child)
