"""pydantic schema → structural schema: what is translated, and what is refused with the field's path."""

from typing import Annotated, Any

import pytest
from pydantic import Field

from robotapp_api.model.base import Model, Observed
from robotapp_api.model.markers import Core, ListMap, ListSet, Rule
from robotapp_api.model.scalars import Duration, Quantity, ShortText
from robotapp_api.schema.collect import Schema, collect
from robotapp_api.schema.structural import NotStructuralError, to_structural


class Inner(Model):
    """An inner object."""

    RULES = (Rule(rule="self.size > 0", message="write a size above 0"),)

    size: int = 3
    """How big."""
    note: ShortText | None = None
    """What else."""


class Tree(Model):
    """Recursive."""

    child: "Tree | None" = None
    """Another one."""


def properties(**fields: Any) -> Schema:
    """Schema of the members of a model with these fields."""
    members = {
        "__annotations__": {name: kind for name, (kind, _) in fields.items()},
        "__module__": __name__,
        "__doc__": "Sample.",
    }
    for name, (_, default) in fields.items():
        if default is not ...:
            members[name] = default
    schema = collect(type("Sample", (Model,), members))
    for member in schema["properties"].values():
        member["description"] = "Described."
    result: Schema = to_structural(schema)["properties"]
    return result


def test_references_are_inlined_with_their_rules() -> None:
    inner = properties(inner=(Annotated[Inner, Rule(rule="true", message="m")], ...))["inner"]
    assert [rule["rule"] for rule in inner["x-kubernetes-validations"]] == ["self.size > 0", "true"]
    assert inner["properties"]["size"] == {
        "description": "How big.",
        "type": "integer",
        "format": "int32",
        "default": 3,
    }
    assert inner["description"] == "Described."


def test_optional_means_absent_not_null() -> None:
    member = properties(limit=(Duration | None, None))["limit"]
    assert "nullable" not in member
    assert "default" not in member
    assert member["maxLength"] == 24


def test_an_object_that_may_be_absent_keeps_an_empty_default_when_its_members_have_defaults() -> None:
    assert properties(inner=(Inner, Inner()))["inner"]["default"] == {}
    assert properties(inner=(Inner, Inner(note="n")))["inner"]["default"] == {"note": "n"}


def test_lists_say_how_they_merge() -> None:
    member = properties(items=(Annotated[tuple[Inner, ...], ListMap("size"), Field(max_length=4)], ()))["items"]
    assert (member["x-kubernetes-list-type"], member["x-kubernetes-list-map-keys"]) == ("map", ["size"])
    assert "default" not in member
    names = properties(names=(Annotated[tuple[ShortText, ...], ListSet(), Field(max_length=4)], ()))["names"]
    assert names["x-kubernetes-list-type"] == "set"
    plain = properties(names=(Annotated[tuple[ShortText, ...], Field(max_length=4)], ()))["names"]
    assert plain["x-kubernetes-list-type"] == "atomic"


def test_quantities_take_numbers_and_text() -> None:
    member = properties(bandwidth=(Quantity | None, None))["bandwidth"]
    assert member["x-kubernetes-int-or-string"]
    assert member["anyOf"] == [{"type": "integer"}, {"type": "string"}]


def test_borrowed_fields_have_the_core_schema_and_our_description() -> None:
    member = properties(env=(Annotated[tuple[dict[str, Any], ...], Core("Container", "env")], ()))["env"]
    assert member["description"] == "Described."
    assert member["x-kubernetes-list-map-keys"] == ["name"]
    assert "valueFrom" in member["items"]["properties"]


def test_what_nobody_observed_is_not_stored() -> None:
    class Seen(Observed):
        """Seen."""

        STORED = frozenset({"robot"})

        robot: ShortText = ""
        """Key."""
        restarts: int = 0
        """Count."""

    schema = to_structural(collect(Seen))["properties"]
    assert schema["robot"]["default"] == ""
    assert "default" not in schema["restarts"]


def test_exclusive_minimum_is_a_flag_in_openapi_3_0() -> None:
    member = properties(hz=(Annotated[float, Field(gt=0)], 1.0))["hz"]
    assert (member["minimum"], member["exclusiveMinimum"]) == (0, True)


@pytest.mark.parametrize(
    ("kind", "problem"),
    [
        (str, "string without maxLength"),
        (tuple[ShortText, ...], "list without maxItems"),
        (dict[str, ShortText], "map without maxProperties"),
        (ShortText | bool, "is a union"),
        (Annotated[tuple[int, str], Field(max_length=2)], "prefixItems"),
        (Annotated[dict[ShortText, ShortText], Field(max_length=2)], "propertyNames"),
        (Annotated[Any, Field()], "no type"),
    ],
)
def test_what_a_structural_schema_cannot_say_is_refused_with_its_path(kind: Any, problem: str) -> None:
    with pytest.raises(NotStructuralError, match=rf"^\.field: .*{problem}"):
        properties(field=(kind, ...))


def test_a_field_without_a_description_is_refused() -> None:
    class Silent(Model):
        """Says nothing about its field."""

        size: int = 0

    with pytest.raises(NotStructuralError, match=r"^\.size: has no description"):
        to_structural(collect(Silent))


def test_recursion_is_refused() -> None:
    with pytest.raises(NotStructuralError, match="recurse"):
        to_structural(collect(Tree))
