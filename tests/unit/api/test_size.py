"""What an app takes of a program's memory: core fields are kept as text, and what an app counts is about what is kept of it."""

import json
import tracemalloc
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import app_body

from robotapp_api.checks.size import MOST_BYTES, measure_spec, size_problem
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.base import dump
from robotapp_api.model.names import Reason
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


Json = dict[str, Any]
_ENV = [{"name": f"A{index}"} for index in range(128)]
_INIT = [{"name": f"i{index}", "image": "x", "env": _ENV} for index in range(8)]
_SOURCES = [{"downwardAPI": {}}] * 60
_HEADERS = [{"name": "a", "value": ""}] * 64
_KEYS = {f"a.b/{index}": "" for index in range(32)}
SHAPES: dict[str, Json] = {
    "nothing more": {},
    "environment": {"env": _ENV},
    "init containers": {"env": _ENV, "template": {"spec": {"initContainers": _INIT}}},
    "volumes": {
        "template": {"spec": {"volumes": [{"name": f"v{n}", "projected": {"sources": _SOURCES}} for n in range(12)]}}
    },
    "probes": {"livenessProbe": {"httpGet": {"port": 1, "httpHeaders": _HEADERS}}},
    "devices": {"devices": [{"name": f"d{n}", "type": "usb"} for n in range(16)]},
    "requirements": {"requires": [{"type": f"usb{n}"} for n in range(16)]},
    "parameter files": {"parameters": [{"inline": "a: 1"}] * 16},
    "words": {"args": ["ab"] * 128, "command": ["ab"] * 64},
    "labels": {"template": {"metadata": {"labels": _KEYS, "annotations": _KEYS}}},
    "tolerations": {"template": {"spec": {"tolerations": [{"key": f"k{n}"} for n in range(64)]}}},
}


def spec_of(shape: Json, count: int, **more: Any) -> Json:
    components = [{"name": f"c{n}", "image": "x", **shape} for n in range(count)]
    return {"ros": {"distro": "humble"}, "components": components, **more}


def memory_of(spec: Json) -> int:
    tracemalloc.start()
    kept = RobotAppSpec.model_validate(spec)
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept.components
    return taken


@pytest.mark.parametrize("shape", SHAPES)
def test_what_an_app_counts_is_about_what_is_kept_of_it(shape: str) -> None:
    spec = spec_of(SHAPES[shape], 64)
    assert memory_of(spec) < 1.25 * measure_spec(spec).total_bytes


def test_edges_count_as_well() -> None:
    edges = [{"from": "c0", "to": "c1", "topic": f"/t{n}"} for n in range(256)]
    spec = spec_of({}, 2, edges=edges)
    assert measure_spec(spec).parts == 256
    assert memory_of(spec) < 1.25 * measure_spec(spec).total_bytes


def test_a_usual_app_is_far_below_the_limit() -> None:
    assert measure_spec(app_body()["spec"]).total_bytes < MOST_BYTES // 20


def test_the_largest_number_of_components_fits() -> None:
    assert size_problem(spec_of({"parameters": [{"inline": "a: 1"}], "env": _ENV[:8]}, 64)) is None


def test_an_app_that_is_too_large_says_what_counts_and_what_to_do() -> None:
    problem = size_problem(spec_of({"parameters": [{"inline": "a" * 60_000}], "args": ["x"] * 9}, 16))
    assert problem is not None
    assert problem.reason is Reason.TOO_LARGE
    assert problem.message.startswith(
        "the app counts 1032 KiB, at most 512 KiB are allowed: its text 939 KiB, 16 components 64 KiB"
    )
    assert "16 edges, devices, requirements, dependencies, parameter files and overrides 16 KiB" in problem.message
    assert "144 words, labels and annotations 13 KiB" in problem.message
    assert problem.message.endswith("environment too (envFrom), or make several apps of it")


@pytest.mark.parametrize(
    "part", [{"components": 5}, {"components": [1, None]}, {"edges": "x"}, {"components": [{"devices": 1}]}]
)
def test_what_is_no_list_counts_as_its_text(part: Json) -> None:
    assert measure_spec(part).parts == 0
