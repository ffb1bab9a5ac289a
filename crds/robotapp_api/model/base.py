"""Base of every API model: camelCase on the wire, frozen in memory, unknown fields ignored.

Unknown fields are ignored because an older operator must survive objects written for a newer schema; refusing typos is
the API server's job (strict field validation). The sentence under an attribute is its `kubectl explain` text.
"""

from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field
from pydantic.alias_generators import to_camel

from robotapp_api.model.markers import Rule
from robotapp_api.model.packed import unpacked


class Model(BaseModel):
    """An object of the API. `RULES` are its CEL rules; they travel into the CRD, Python never evaluates them."""

    model_config = ConfigDict(
        extra="ignore",
        frozen=True,
        alias_generator=to_camel,
        validate_by_name=True,
        validate_by_alias=True,
        serialize_by_alias=True,
    )
    RULES: ClassVar[tuple[Rule, ...]] = ()


class Observed(Model):
    """A part of status. Its defaults only help readers: nothing is stored that nobody observed, except `STORED`."""

    STORED: ClassVar[frozenset[str]] = frozenset()
    """Fields (wire names) whose default the API server does store."""


class ObjectMeta(Model):
    """The part of metav1.ObjectMeta that our code reads."""

    name: str = ""
    namespace: str = ""
    uid: str = ""
    generation: int = 0
    resource_version: str = ""
    labels: dict[str, str] = Field(default_factory=dict)
    annotations: dict[str, str] = Field(default_factory=dict)
    creation_timestamp: str | None = None
    deletion_timestamp: str | None = None


def dump(model: Model) -> dict[str, Any]:
    """The model as plain JSON with wire names: without nulls, and without empty values nobody wrote."""
    empty: tuple[Any, ...] = ([], {}, "", 0) if isinstance(model, ObjectMeta) else ([], {})
    result = {}
    for name, field in type(model).model_fields.items():
        value = _plain(getattr(model, name))
        if value is not None and (value not in empty or name in model.model_fields_set):
            result[field.alias or name] = value
    return result


def _plain(value: Any) -> Any:
    if isinstance(value, Model):
        return dump(value)
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return unpacked(value)
