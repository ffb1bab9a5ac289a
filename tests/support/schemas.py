"""The schema of every kind, as the API server has it: made once, and not to be changed."""

from robotapp_api.schema.crd import KINDS, schema_of

SCHEMAS = {model.__name__: schema_of(model) for model in KINDS}
