"""Strict decoding, which is kubectl's way, refuses every field the API once had and names it."""

from collections.abc import Iterator
from typing import Any

import pytest
from tests.support import crds
from tests.support.wrong_input.gone_fields import GONE_FIELDS, GONE_VALUES, object_around, with_field

from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.live

STRICT = "?dryRun=All&fieldValidation=Strict"
FIELDS = [(kind, field, value) for kind, fields in GONE_FIELDS.items() for field, value in fields.items()]
VALUES = [(kind, field, value) for kind, fields in GONE_VALUES.items() for field, value in fields.items()]


def said(plane: ControlPlane, method: str, path: str, obj: dict[str, Any]) -> str:
    """What the server answers to an object it must refuse."""
    with pytest.raises(ApiStatusError) as refused:
        plane.api.request(method, path + STRICT, obj)
    assert refused.value.status in (400, 422)
    return refused.value.message


@pytest.fixture
def stored(control_plane: ControlPlane, kind: str) -> Iterator[str]:
    """resourceVersion of an object of that kind that really exists, because a status is taken only for such a one."""
    around = object_around(kind)
    yield control_plane.api.create(crds.collection(kind), around)["metadata"]["resourceVersion"]
    control_plane.api.delete(crds.address(around))


@pytest.mark.parametrize("kind", GONE_FIELDS)
def test_the_objects_around_the_gone_fields_are_accepted(control_plane: ControlPlane, kind: str) -> None:
    obj = object_around(kind)
    control_plane.api.create(crds.collection(kind) + STRICT, obj)


@pytest.mark.parametrize(("kind", "field", "value"), FIELDS, ids=[field for _, field, _ in FIELDS])
def test_strict_decoding_refuses_every_old_field_name(
    control_plane: ControlPlane, kind: str, field: str, value: Any
) -> None:
    where = field.replace("[]", "[0]")
    told = said(control_plane, "POST", crds.collection(kind), with_field(kind, field, value))
    assert f'unknown field "{where}"' in told


@pytest.mark.parametrize(("kind", "field", "value"), VALUES, ids=[field for _, field, _ in VALUES])
def test_an_old_value_of_a_field_that_stayed_is_refused(
    control_plane: ControlPlane, kind: str, field: str, value: Any, stored: str
) -> None:
    obj = with_field(kind, field, value)
    obj["metadata"]["resourceVersion"] = stored
    path = crds.address(obj) + ("/status" if field.startswith("status.") else "")
    assert field.replace("[]", "[0]") in said(control_plane, "PUT", path, obj)
