"""Names of robot and instance in texts that the operator expands."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.factories import component, make_app

from robotapp_api.model.app.component import Component
from robotapp_api.values.component_references import expanded_problem, list_expanded_texts, list_object_references
from robotapp_api.values.references import ObjectReference, expand, expand_sources, reference_values, unknown_reference

R = "$(ROBOTAPP_ROBOT)"
I = "$(ROBOTAPP_INSTANCE)"  # noqa: E741 - as R

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["configMap", "secret", "name", "key", "x"]), inner)
    ),
    max_leaves=12,
)


def driver(**fields: Any) -> Component:
    return make_app(component("driver", **fields)).spec.components[0]


@given(JSON)
def test_json_without_references_stays_as_it_is(value: Any) -> None:
    assert expand_sources(value, reference_values("amr-07")) == value


def test_names_and_keys_of_every_kind_of_source_are_expanded_and_nothing_else() -> None:
    volumes = [
        {"name": R, "configMap": {"name": f"a-{R}", "items": [{"key": f"{I}.yaml", "path": R}]}},
        {"name": "s", "secret": {"secretName": f"s-{R}", "items": [{"key": R, "path": "p"}]}},
        {"name": "c", "persistentVolumeClaim": {"claimName": f"c-{I}"}},
        {"name": "p", "projected": {"sources": [{"secret": {"name": R}}, {"configMap": {"name": R}}]}},
    ]
    assert expand_sources(volumes, reference_values("x")) == [
        {"name": R, "configMap": {"name": "a-x", "items": [{"key": "x.yaml", "path": R}]}},
        {"name": "s", "secret": {"secretName": "s-x", "items": [{"key": "x", "path": "p"}]}},
        {"name": "c", "persistentVolumeClaim": {"claimName": "c-x"}},
        {"name": "p", "projected": {"sources": [{"secret": {"name": "x"}}, {"configMap": {"name": "x"}}]}},
    ]
    variables = [
        {"name": "A", "value": R},
        {"name": "B", "valueFrom": {"secretKeyRef": {"name": f"s-{R}", "key": R}}},
    ]
    assert expand_sources(variables, reference_values("x")) == [
        {"name": "A", "value": R},
        {"name": "B", "valueFrom": {"secretKeyRef": {"name": "s-x", "key": "x"}}},
    ]


def test_only_two_references_are_expanded() -> None:
    assert expand(f"{R}/{I}/$(ROS_DOMAIN_ID)", reference_values("a")) == "a/a/$(ROS_DOMAIN_ID)"
    assert unknown_reference(f"{R}{I}") == ""
    assert unknown_reference(f"{R}-$(X)-$(Y)") == "$(X)"
    assert unknown_reference("$(open") == "$(open"


def test_the_objects_that_a_component_names_are_listed_with_where_they_stand() -> None:
    part = driver(
        env=[{"name": "A", "valueFrom": {"configMapKeyRef": {"name": "m", "key": "k", "optional": True}}}],
        template={
            "spec": {
                "volumes": [{"name": "v", "persistentVolumeClaim": {"claimName": "c"}}, {"name": "e", "emptyDir": {}}]
            }
        },
    )
    assert list(list_object_references(part, "at")) == [
        ObjectReference("ConfigMap", "m", ("k",), True, "at.env[0].valueFrom.configMapKeyRef.name"),
        ObjectReference(
            "PersistentVolumeClaim", "c", (), False, "at.template.spec.volumes[0].persistentVolumeClaim.claimName"
        ),
    ]


@pytest.mark.parametrize(
    ("fields", "robot", "says"),
    [
        ({"envFrom": [{"configMapRef": {"name": f"m-{R}"}}]}, "AMR_07", '"m-AMR_07" is no name of an object'),
        ({"envFrom": [{"configMapRef": {"name": f"{'m' * 240}-{R}"}}]}, "a" * 20, "at most 253"),
        ({"template": {"metadata": {"labels": {"site": f"{'s' * 40}-{R}"}}}}, "a" * 30, "is no value of a label"),
        ({"template": {"spec": {"imagePullSecrets": [{"name": R}]}}}, "A", '"A" is no name of an object'),
    ],
)
def test_what_is_no_name_for_a_robot_is_found(fields: dict[str, Any], robot: str, says: str) -> None:
    problems = [expanded_problem(text, reference_values(robot)) for text in list_expanded_texts(driver(**fields), "at")]
    assert any(says in problem for problem in problems)
    assert [
        expanded_problem(text, reference_values("amr-07")) for text in list_expanded_texts(driver(**fields), "at")
    ] == [""] * len(problems)
