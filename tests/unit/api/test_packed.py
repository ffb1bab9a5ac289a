"""Core fields of a RobotApp are kept as text: what is read of them, and what they take of the memory."""

import json
import tracemalloc
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.base import dump
from robotapp_api.model.packed import PackedList, PackedMap, unpacked

SCALARS = (
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text(st.characters(exclude_categories=()), max_size=8)
)
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner))
OBJECTS = st.dictionaries(st.text(max_size=8), VALUES, max_size=4)


@given(st.lists(OBJECTS, max_size=4))
def test_a_packed_list_reads_as_the_list_it_was_made_of(items: list[dict[str, Any]]) -> None:
    packed = PackedList(items)
    assert list(packed) == items == packed.unpack() == unpacked(packed)
    assert (len(packed), bool(packed)) == (len(items), bool(items))
    assert packed == PackedList(items)
    assert packed == items


@given(OBJECTS)
def test_a_packed_map_reads_as_the_object_it_was_made_of(fields: dict[str, Any]) -> None:
    packed = PackedMap(fields)
    assert dict(packed) == fields == packed.unpack() == unpacked(packed)
    assert packed == PackedMap(fields)
    assert all(packed[name] == value for name, value in fields.items())
    assert packed.get("no such field") is None or "no such field" in fields


def test_a_change_of_what_was_read_reaches_no_other_reader() -> None:
    component = Component.model_validate({"name": "a", "image": "x", "env": [{"name": "A", "value": "1"}]})
    component.env.unpack()[0]["value"] = "2"
    next(iter(component.env))["value"] = "3"
    assert component.env[0]["value"] == "1"


def test_a_spec_is_written_as_it_was_read() -> None:
    body = {
        "name": "a",
        "image": "x",
        "env": [{"name": "A", "value": "1"}],
        "resources": {"limits": {"cpu": 1}},
        "template": {"spec": {"securityContext": {"runAsUser": 0}}},
    }
    component = Component.model_validate(body)
    assert dump(component).items() >= body.items()
    assert Component.model_validate(component.model_dump()) == component
    assert component.model_dump(mode="json", exclude_defaults=True)["env"] == body["env"]


def test_an_environment_takes_about_its_text() -> None:
    env = [{"name": f"A{index}"} for index in range(128)]
    first = [{"name": f"i{index}", "image": "x", "env": env} for index in range(8)]
    component = {"image": "x", "env": env, "template": {"spec": {"initContainers": first}}}
    spec = {"ros": {"distro": "humble"}, "components": [{"name": f"c{n}", **component} for n in range(16)]}
    size = len(json.dumps(spec))
    tracemalloc.start()
    kept = RobotAppSpec.model_validate(spec)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(kept.components) == 16
    assert size > 300_000
    assert taken < 2 * size
