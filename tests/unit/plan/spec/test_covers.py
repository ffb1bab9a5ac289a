"""Is what we want already there?"""

from typing import Any

import pytest

from robotapp_operator.plan.diff.newer import is_newer
from robotapp_operator.plan.spec.covers import content_hash, covers


@pytest.mark.parametrize(
    ("observed", "wanted", "same"),
    [
        ({"a": 1, "b": 2}, {"a": 1}, True),
        ({"a": 1}, {"a": 1, "b": 2}, False),
        ({"a": [1, 2]}, {"a": [1]}, False),
        ({"a": [{"x": 1, "default": 2}]}, {"a": [{"x": 1}]}, True),
        ({}, {"a": {}, "b": [], "c": ""}, True),
        ({"a": None}, {"a": {}}, True),
        ({"a": "x"}, {"a": {"b": 1}}, False),
        ({"a": "x"}, {"a": ["x"]}, False),
        ("1", "1000m", True),
        ("1Gi", "1024Mi", True),
        (1, "1", True),
        ("2", "1000m", False),
        (True, 1, True),
        ("true", True, False),
        ("abc", "abd", False),
        (None, "1", False),
    ],
)
def test_covers(observed: Any, wanted: Any, same: bool) -> None:
    assert covers(observed, wanted) is same


def test_flags_that_core_does_not_store_when_they_are_off_are_covered_by_absence() -> None:
    mount = {"name": "v", "mountPath": "/v"}
    assert covers(mount, mount | {"readOnly": False})
    assert not covers(mount | {"readOnly": True}, mount | {"readOnly": False})
    assert covers({"containerPort": 80}, {"containerPort": 80, "hostPort": 0})
    assert not covers({}, {"automountServiceAccountToken": False}), "whoever takes it off mounts a token"


def test_the_hash_ignores_key_order_only() -> None:
    assert content_hash({"a": 1, "b": [1, 2]}) == content_hash({"b": [1, 2], "a": 1})
    assert content_hash({"a": [1, 2]}) != content_hash({"a": [2, 1]})
    assert len(content_hash("x")) == 16


@pytest.mark.parametrize(
    ("one", "other", "newer"),
    [
        ("1.10.0", "1.9.0", True),
        ("1.9.0", "1.10.0", False),
        ("1.0.0", "1.0.0", False),
        ("1.0.0", "", True),
        ("1.0.0", "1.0.0-rc1", True),
        ("1.0.0", "1.0.0rc1", True),  # as Python's metadata has it
        ("1.0.0rc1", "1.0.0", False),
        ("1.0.0rc2", "1.0.0rc1", True),
        ("1.0.0.dev3", "1.0.0", False),
        ("1.0.0+g12", "1.0.0", False),
        ("1.0.0", "1.0.0+g12", False),
        ("latest", "1.0.0", False),
        ("", "1.0.0", False),
        ("1.0.1", "1.0", True),
    ],
)
def test_versions_are_compared_as_numbers(one: str, other: str, newer: bool) -> None:
    assert is_newer(one, other) is newer
