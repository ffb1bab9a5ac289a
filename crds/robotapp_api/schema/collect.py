"""pydantic's JSON schema of a model, enriched with what pydantic does not know: descriptions, rules, stored defaults."""

from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from robotapp_api.model.base import Model, ObjectMeta, Observed
from robotapp_api.schema import describe

Schema = dict[str, Any]
RULES_KEYWORD = "x-kubernetes-validations"


class _Collector(GenerateJsonSchema):
    """Adds descriptions and rules where pydantic visits each model, so nested models are covered without a second walk."""

    def model_schema(self, schema: Any) -> Schema:
        result = super().model_schema(schema)
        model: type[Model] = schema["cls"]
        if issubclass(model, ObjectMeta):
            return {"type": "object"}
        texts = describe.fields_of(model)
        result["description"] = describe.text_of(model)
        for name, field in model.model_fields.items():
            wire = field.alias or name
            member = result["properties"][wire]
            if name in texts:
                member["description"] = texts[name]
            if issubclass(model, Observed) and name not in model.STORED:
                member.pop("default", None)
            elif isinstance(field.default, Observed):
                member["default"] = {}  # what is stored of it stands at its own fields
        if model.RULES:
            result[RULES_KEYWORD] = [rule.as_schema() for rule in model.RULES]
        return result


def collect(model: type[Model]) -> Schema:
    """The model's JSON schema with $defs, in the order in which the fields are written."""
    return model.model_json_schema(by_alias=True, mode="validation", schema_generator=_Collector)
