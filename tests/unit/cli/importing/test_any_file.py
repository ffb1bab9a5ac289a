"""Any values in any field: an import ends with objects or with a ComposeError that has a place."""

import contextlib
import json
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.cli.importing.compose import import_files

from robotapp_cli.importing.report import ComposeError
from robotapp_cli.importing.services.component import HANDLERS, REASONS
from robotapp_cli.importing.writing import format_objects

LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-5, 10**20),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=6),
    st.sampled_from(["a:b", "/a:/b", "1:2", "=", "$X", "${X:?}", "CMD", "10s", "1g", "/dev/ttyUSB0"]),
)
KEYS = st.sampled_from(
    [
        "source",
        "target",
        "type",
        "size",
        "path",
        "file",
        "service",
        "test",
        "resources",
        "limits",
        "count",
        "condition",
        "A",
    ]
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(KEYS, inner, max_size=3)),
    max_leaves=6,
)
SERVICES = st.dictionaries(st.sampled_from([*HANDLERS, *REASONS, "build", "extends", "profiles"]), VALUES, max_size=2)


@settings(max_examples=200, deadline=None)
@given(
    SERVICES, st.dictionaries(st.sampled_from(["volumes", "configs", "secrets", "include", "name"]), VALUES, max_size=1)
)
def test_nothing_but_a_compose_error_ends_an_import(service: dict[str, Any], top: dict[str, Any]) -> None:
    text = json.dumps({"services": {"a": {"image": "ros:jazzy", **service}}, **top})
    with contextlib.suppress(ComposeError):
        assert format_objects(import_files({"compose.yaml": text}).objects)
