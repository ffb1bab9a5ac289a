"""Whatever is in a file: findings with a place in it, never an exception."""

import json
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.apiobjects import pool
from tests.support.seeds import count_examples
from tests.support.wrong_input.malformed import full_app

from robotapp_cli.lint.linter import lint

PIECES = st.sampled_from(
    [
        "apiVersion: robotics.io/v1alpha1\n", "kind: RobotApp\n", "kind: List\nitems:\n", "---\n", "spec:\n", "  ", "- ", "\n",
        "components:\n", "name: a", "image: &x i", "*x", "&x ", "{", "}", "[", "]", ": ", "? ", "<<: *x", "!!set ", "!!binary ",
        "'", '"', "|\n", ">-\n", "#", "\t", "\\u", "\ud7ff", "%YAML 1.1\n", "...", ".inf", "1e999", "0x", "~", "\x85", "\u2028", "\x00",
    ]
)  # fmt: skip
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=5) | st.sampled_from(["1s", "9" * 24 + "h", "a", "@robot"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5) | st.sampled_from(["name", "limits", "key"]), inner, max_size=3),
    max_leaves=6,
)  # fmt: skip


def paths(value: Any, at: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    own = [at] if at else []
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return own + [path for key, each in inner for path in paths(each, (*at, key))]


WHOLES = (full_app(), pool(ids="1-5,7", quota={"default": 3, "namespaces": {"a": 1}}))
PLACES = [(number, path) for number, whole in enumerate(WHOLES) for path in paths(whole)]


def check(data: bytes) -> None:
    lines = data.count(b"\n") + data.count(b"\r") + data.count(b"\x85") + data.count(b"\xe2\x80\xa8") + 2
    for found in lint(data).findings:
        assert 1 <= found.place.line <= lines
        assert found.place.column >= 1
        assert found.message


@settings(max_examples=count_examples(100), deadline=None)
@given(st.lists(PIECES, max_size=25).map("".join) | st.text(max_size=200))
def test_any_text_gives_findings_and_no_exception(text: str) -> None:
    check(text.encode(errors="replace"))


@settings(max_examples=count_examples(50), deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_give_findings_and_no_exception(data: bytes) -> None:
    check(data)


@settings(max_examples=count_examples(40), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_any_value_in_any_field_gives_findings_and_no_exception(data: st.DataObject) -> None:
    number, path = data.draw(st.sampled_from(PLACES))
    whole = json.loads(json.dumps(WHOLES[number]))
    target = whole
    for step in path[:-1]:
        target = target[step]
    if isinstance(path[-1], str) and data.draw(st.booleans()):
        target[data.draw(st.text(max_size=8))] = data.draw(JSON)
    else:
        target[path[-1]] = data.draw(JSON)
    check(yaml.dump(whole, Dumper=yaml.CSafeDumper).encode(errors="surrogatepass"))


@pytest.mark.parametrize("text", ["9" * 24 + "h", "999999h999999h999999h", "0.001us"])
def test_durations_of_any_size_end_as_findings(text: str) -> None:
    whole = full_app()
    whole["spec"]["edges"][0]["qos"]["deadline"] = text
    whole["spec"]["connectivity"]["grace"] = text
    check(yaml.safe_dump(whole).encode())
