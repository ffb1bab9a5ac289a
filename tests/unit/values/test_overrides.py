"""What overrides make of a component, and which robots get them."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app

from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.packed import unpacked
from robotapp_api.values.overrides import apply_overrides, select_overrides

ROBOTS = {"nodeSelector": {"matchLabels": {"fleet": "a"}}}


def override(name: str, labels: dict[str, str], **fields: Any) -> dict[str, Any]:
    return {"name": name, "nodeSelector": {"matchLabels": labels}, "components": [{"name": "driver", **fields}]}


def spec_of(*overrides: dict[str, Any], **fields: Any) -> RobotAppSpec:
    return make_app(component("driver", **fields), component("mapper"), robots=ROBOTS, overrides=list(overrides)).spec


def made(spec: RobotAppSpec, labels: dict[str, str]) -> Any:
    return apply_overrides(spec, select_overrides(spec.overrides, labels)).components[0]


def test_variables_are_merged_by_name_and_keep_their_place() -> None:
    spec = spec_of(
        override("slow", {"kind": "old"}, env=[{"name": "B", "value": "2"}, {"name": "NEW", "value": "3"}]),
        env=[{"name": "A", "value": "1"}, {"name": "B", "value": "1"}, {"name": "C", "value": "$(B)"}],
    )
    assert unpacked(made(spec, {"kind": "old"}).env) == [
        {"name": "A", "value": "1"},
        {"name": "B", "value": "2"},
        {"name": "C", "value": "$(B)"},
        {"name": "NEW", "value": "3"},
    ]
    assert made(spec, {"kind": "new"}) == spec.components[0]


def test_resources_are_replaced_whole_images_too_and_files_come_last() -> None:
    more = [{"inline": "/**: {ros__parameters: {v: 0.5}}"}]
    base = [{"configMapKeyRef": {"name": "drv", "key": "a"}}]
    spec = spec_of(
        override("slow", {"kind": "old"}, image="x:2", resources={"limits": {"cpu": "1"}}, parameters=more),
        resources={"requests": {"memory": "1Gi"}},
        parameters=base,
        args=["run"],
    )
    part = made(spec, {"kind": "old"})
    assert part.image == "x:2"
    assert unpacked(part.resources) == {"limits": {"cpu": "1"}}
    assert [file.inline for file in part.parameters] == [None, more[0]["inline"]]


def test_a_later_override_wins() -> None:
    spec = spec_of(override("one", {"a": "1"}, image="x:1"), override("two", {"b": "1"}, image="x:2"))
    assert select_overrides(spec.overrides, {"a": "1", "b": "1"}) == {"driver": ("one", "two")}
    assert made(spec, {"a": "1", "b": "1"}).image == "x:2"
    assert made(spec, {"a": "1"}).image == "x:1"


@given(st.dictionaries(st.sampled_from("ab"), st.sampled_from("12")))
def test_robots_that_nothing_chooses_run_what_is_written(labels: dict[str, str]) -> None:
    spec = spec_of(override("one", {"a": "1"}, image="x:1"), override("two", {"b": "1"}, image="x:2"))
    wanted = "x:2" if labels.get("b") == "1" else "x:1" if labels.get("a") == "1" else spec.components[0].image
    assert made(spec, labels).image == wanted
    assert apply_overrides(spec, select_overrides(spec.overrides, labels)).components[1] == spec.components[1]


def test_names_that_the_spec_no_longer_has_count_for_nothing() -> None:
    spec = spec_of(override("one", {"a": "1"}, image="x:1"))
    assert apply_overrides(spec, {"driver": ("gone",), "nobody": ("one",)}).components == spec.components
