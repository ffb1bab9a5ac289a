"""The shipped schema and the small checker that reads it."""

from collections.abc import Iterator
from typing import Any

import pytest
from tests.support.rigel.rigelfiles import orchestration, refusal

from rigel_bridge.render.schema import _PATTERNS, problems, robotapp_schema

OBJECT = {"type": "object", "required": ["a"], "properties": {"a": {"type": "integer", "minimum": 1, "maximum": 3}}}
SMALL = {"rule": "self.matches('^[a-z]$')", "message": "write a small letter"}
ALWAYS = {"rule": "self == 'Always'", "message": "leave it out"}
NOTHING = {"rule": "size(self) == 0", "message": "write devices"}


def messages(value: Any, schema: dict[str, Any]) -> list[str]:
    return [message for _, message in problems(value, schema)]


@pytest.mark.parametrize(
    ("value", "schema", "message"),
    [
        ({}, OBJECT, "a is missing"),
        ({"a": 1, "b": 2}, OBJECT, "is not a field of RobotApp"),
        ({"a": 0}, OBJECT, "must be at least 1, found 0"),
        ({"a": 4}, OBJECT, "must be at most 3, found 4"),
        ({"a": True}, OBJECT, "must be a whole number, found true"),
        ([], OBJECT, "must be a mapping, found []"),
        ("x", {"type": "boolean"}, 'must be true or false, found "x"'),
        (None, {"type": "string"}, "must be text, found nothing"),
        ("", {"type": "string", "minLength": 1}, "must not be empty"),
        ("x", {"type": "string", "minLength": 2}, "must have at least 2 characters"),
        ("abc", {"type": "string", "maxLength": 2}, "must have at most 2 characters, found 3"),
        ("A", {"type": "string", "pattern": "^[a-z]$"}, '"A" is not possible; write what fits ^[a-z]$'),
        ("A", {"type": "string", "x-kubernetes-validations": [SMALL]}, '"A": write a small letter'),
        ("Never", {"type": "string", "x-kubernetes-validations": [ALWAYS]}, '"Never": leave it out'),
        ([1], {"type": "array", "x-kubernetes-validations": [NOTHING]}, "[1]: write devices"),
        (
            "fast",
            {"type": "string", "enum": ["slow", "faster"]},
            '"fast" is not allowed (did you mean faster?); allowed: slow, faster',
        ),
        ([1, 2], {"type": "array", "maxItems": 1, "items": {}}, "must have at most 1 entries, found 2"),
        ([], {"type": "array", "minItems": 1}, "must have at least 1 entries"),
        ({"x": 1}, {"type": "object", "additionalProperties": {"type": "string"}}, "must be text, found 1"),
        (
            {"x": 1, "y": 1},
            {"type": "object", "maxProperties": 1, "additionalProperties": {}},
            "must have at most 1 entries, found 2",
        ),
        (1.5, {"x-kubernetes-int-or-string": True}, "must be text or a whole number, found 1.5"),
        (
            "1M!",
            {"x-kubernetes-int-or-string": True, "pattern": "^[0-9]+M?$"},
            '"1M!" is not possible; write what fits ^[0-9]+M?$',
        ),
    ],
)
def test_each_keyword_finds_its_problem(value: Any, schema: dict[str, Any], message: str) -> None:
    assert message in messages(value, schema)


def test_a_kept_rule_is_silent() -> None:
    assert messages("Always", {"type": "string", "x-kubernetes-validations": [ALWAYS]}) == []
    assert messages([], {"type": "array", "x-kubernetes-validations": [NOTHING]}) == []


def test_rules_that_are_more_than_a_pattern_stay_with_the_api_server() -> None:
    other = {"rule": "!self.matches('^x$') || size(self) > 3", "message": "never shown here"}
    schema = {"type": "string", "x-kubernetes-validations": [SMALL, other]}
    assert messages("x", schema) == []


@pytest.mark.parametrize("value", ["40M", 40, {"a": 1}, {"a": 3}])
def test_what_is_allowed_is_silent(value: Any) -> None:
    schema = (
        OBJECT
        if isinstance(value, dict)
        else {"x-kubernetes-int-or-string": True, "anyOf": [{"type": "integer"}, {"type": "string"}]}
    )
    assert messages(value, schema) == []


def test_a_problem_knows_its_path() -> None:
    schema = {"type": "array", "items": OBJECT}
    assert [path for path, _ in problems([{"a": 1}, {"a": 9}], schema)] == [(1, "a")]


def test_the_checker_knows_every_keyword_of_the_shipped_schema() -> None:
    known = {
        *(
            "type",
            "properties",
            "items",
            "additionalProperties",
            "required",
            "enum",
            "pattern",
            "minLength",
            "maxLength",
        ),
        *("minimum", "maximum", "minItems", "maxItems", "maxProperties", "x-kubernetes-int-or-string", "anyOf"),
        "x-kubernetes-preserve-unknown-fields",
        # no restriction of a single object, or left to the API server
        *("description", "default", "format", "x-kubernetes-validations"),
        *("x-kubernetes-list-type", "x-kubernetes-list-map-keys", "x-kubernetes-map-type"),
    }

    def keywords(schema: Any) -> set[str]:
        children = [*schema.get("properties", {}).values(), schema.get("items"), schema.get("additionalProperties")]
        return set(schema).union(*(keywords(child) for child in children if isinstance(child, dict)))

    assert keywords(robotapp_schema()) <= known


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ("edges: [{topic: /a, from: base_driver, to: '@robot'}]", '"base_driver" is not possible (did you mean base-driver?); write the name of a component'),
        ("edges: [{topic: a b, from: base-driver, to: '@robot'}]", '"a b" is not possible; write letters, digits, _ and /, such as /cmd_vel'),
        ("ros2: {rmw: fastrtps}", '"fastrtps" is not possible; write the name of a ROS middleware, such as rmw_fastrtps_cpp'),
    ],
)  # fmt: skip
def test_a_pattern_that_is_missed_is_told_in_words(block: str, message: str) -> None:
    assert message in refusal(orchestration(f"robotapp: {{{block}}}"))


def test_every_pattern_of_a_field_has_words_unless_it_is_one_of_kubernetes() -> None:
    ours = robotapp_schema()["properties"]["spec"]["properties"]
    found = {text for key in ("ros", "ros2", "edges") for text in patterns(ours[key])} | set(
        patterns(ours["components"]["items"]["properties"]["devices"])
    )
    assert found <= _PATTERNS.keys()


def patterns(schema: Any) -> Iterator[str]:
    if isinstance(schema, list):
        yield from (text for one in schema for text in patterns(one))
    elif isinstance(schema, dict):
        if isinstance(schema.get("pattern"), str):
            yield schema["pattern"]
        yield from (text for one in schema.values() for text in patterns(one))
