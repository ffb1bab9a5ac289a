"""What the API had before its reshaping is gone, and its names mean nothing else today."""

from collections.abc import Iterator
from typing import Any

import pytest
from tests.support.schemas import SCHEMAS
from tests.support.wrong_input.gone_fields import GONE_FIELDS, GONE_VALUES, object_around


def fields(schema: dict[str, Any], path: str) -> Iterator[str]:
    for key, member in schema.get("properties", {}).items():
        here = f"{path}.{key}" if path else key
        yield here
        yield from fields(member, here)
        yield from fields(member.get("items", {}), f"{here}[]")


@pytest.mark.parametrize("kind", GONE_FIELDS)
def test_no_old_name_is_in_the_schema(kind: str) -> None:
    present = set(fields(SCHEMAS[kind], ""))
    assert [field for field in GONE_FIELDS[kind] if field in present] == []
    assert [field for field in GONE_VALUES[kind] if field not in present] == []


@pytest.mark.parametrize("kind", GONE_FIELDS)
def test_everything_a_gone_field_lay_in_is_in_the_object_that_it_is_put_into(kind: str) -> None:
    whole = object_around(kind)
    for field in (*GONE_FIELDS[kind], *GONE_VALUES[kind]):
        target: Any = whole
        for step in field.split(".")[:-1]:
            target = target[step.removesuffix("[]")]
            target = target[0] if step.endswith("[]") else target
        assert isinstance(target, dict)
