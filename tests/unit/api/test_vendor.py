"""Cutting a core schema out of an OpenAPI document."""

from typing import Any

import pytest

from robotapp_api.schema import vendor

PREFIX = "io.k8s.api.core.v1."


def ref(kind: str) -> dict[str, Any]:
    return {"allOf": [{"$ref": f"#/components/schemas/{PREFIX}{kind}"}]}


def convert(node: dict[str, Any], *, name: str = "field", **definitions: Any) -> Any:
    return vendor._Source({PREFIX + kind: schema for kind, schema in definitions.items()}).convert(node, name=name)


def test_references_are_inlined_and_the_nearer_description_wins() -> None:
    probe = {
        "description": "Probe. More.",
        "type": "object",
        "properties": {"port": {"type": "integer", "format": "int32"}},
    }
    node = {**ref("Probe"), "description": "Liveness, e.g. of a server. Cannot be updated."}
    assert convert(node, Probe=probe) == {
        "description": "Liveness, e.g. of a server.",
        "type": "object",
        "properties": {"port": {"type": "integer", "format": "int32"}},
    }


def test_every_kind_of_value_gets_a_bound() -> None:
    assert convert({"type": "string"})["maxLength"] == 1024
    assert convert({"type": "array", "items": {"type": "string"}}, name="args") == {
        "type": "array",
        "items": {"type": "string", "maxLength": 4096},
        "maxItems": 128,
    }
    assert convert({"type": "object", "additionalProperties": {"type": "string"}})["maxProperties"] == 64


def test_keys_of_keyed_lists_become_required_when_their_default_is_dropped() -> None:
    item = {"type": "object", "properties": {"name": {"type": "string", "default": ""}}}
    node = {"type": "array", "items": item, "x-kubernetes-list-type": "map", "x-kubernetes-list-map-keys": ["name"]}
    result = convert(node)
    assert result["items"]["required"] == ["name"]
    assert "default" not in result["items"]["properties"]["name"]


@pytest.mark.parametrize(
    ("kind", "field"), [("ContainerPort", "hostIP"), ("Volume", "iscsi"), ("ResourceRequirements", "claims")]
)
def test_what_reaches_the_host_is_left_out(kind: str, field: str) -> None:
    schema = {"type": "object", "properties": {field: {"type": "string"}, "name": {"type": "string"}}}
    assert list(convert(ref(kind), **{kind: schema})["properties"]) == ["name"]


def test_a_recursive_type_is_an_error() -> None:
    with pytest.raises(RecursionError):
        convert(ref("Loop"), Loop={"type": "object", "properties": {"next": ref("Loop")}})
