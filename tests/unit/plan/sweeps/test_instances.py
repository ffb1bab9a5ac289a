"""Pods of a sweep's instance have its values; everything else of an instance is as for other apps."""

from typing import Any

import msgspec
import pytest
from tests.support.factories import component, make_app

from robotapp_claims.rules.objects import Pool
from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.render.instance_object import wanted_object
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.instances import instances_of
from robotapp_operator.plan.spec.validate import notes_of, problems_alone

MATRIX = {"parameters": [{"name": "speed", "values": ["0.5", "1.5"]}, {"name": "planner", "values": ["dwb", "mppi"]}]}


def sweep(*components: dict[str, Any], **spec: Any) -> App:
    return make_app(*(components or [component("sim", job={})]), matrix=MATRIX, **spec)


def first_instance(app: App) -> str:
    return next(iter(app.sweep))


def pod_of(app: App, instance: str) -> dict[str, Any]:
    children = wanted_children(desired_of(app, instance), domain=Domain(7), parameters={}, running=True)
    (child,) = [child for child in children if child.component == "sim"]
    template: dict[str, Any] = child.spec["template"]
    return template


def variables(template: dict[str, Any]) -> dict[str, str]:
    return {entry["name"]: entry.get("value", "") for entry in template["spec"]["containers"][0]["env"]}


def test_a_sweep_has_an_instance_for_each_combination() -> None:
    app = sweep()
    names = [instance.robot for instance in instances_of(app, {}, running=(), claimed=())]
    assert names == sorted(app.sweep)
    assert len(names) == 4
    assert all("dwb" in name or "mppi" in name for name in names)


def test_a_pod_has_the_values_of_its_instance_as_variables_and_no_robot() -> None:
    app = sweep()
    own = variables(pod_of(app, first_instance(app)))
    assert own["MATRIX_SPEED"] == "0.5"
    assert own["MATRIX_PLANNER"] == "dwb"
    assert (own["ROBOTAPP_INSTANCE"], own["ROBOTAPP_ROBOT"]) == (first_instance(app), "")


def test_values_come_before_the_variables_of_the_component_that_may_refer_to_them() -> None:
    app = sweep(component("sim", job={}, env=[{"name": "GOAL", "value": "$(MATRIX_SPEED)"}]))
    names = list(variables(pod_of(app, first_instance(app))))
    assert names.index("MATRIX_SPEED") < names.index("GOAL")


def test_inline_parameters_and_the_arguments_of_run_have_the_values_in_them() -> None:
    inline = "/**: {ros__parameters: {v: $(MATRIX_SPEED), robot: $(ROBOTAPP_ROBOT)}}"
    run = {"package": "nav", "executable": "sim", "args": ["--planner", "$(MATRIX_PLANNER)"]}
    app = sweep(component("sim", job={}, run=run, parameters=[{"inline": inline}]))
    template = pod_of(app, first_instance(app))
    (text,) = [text for key, text in template["metadata"]["annotations"].items() if "parameters" in key]
    assert text == "/**: {ros__parameters: {v: 0.5, robot: $(ROBOTAPP_ROBOT)}}"
    assert template["spec"]["containers"][0]["args"][4:6] == ["--planner", "dwb"]


def test_an_instance_may_run_on_any_robot_as_one_of_an_app_without_robots() -> None:
    app = sweep(component("sim", job={}, runsOn=["Robot"]))
    plain = make_app(component("sim", job={}, runsOn=["Robot"]))
    own, other = pod_of(app, first_instance(app)), pod_of(plain, "")
    assert own["spec"]["affinity"] == other["spec"]["affinity"]
    assert own["spec"]["tolerations"] == other["spec"]["tolerations"]


def test_a_further_value_is_no_edit_of_the_other_instances() -> None:
    more = {"parameters": [*MATRIX["parameters"][:1], {"name": "planner", "values": ["dwb", "mppi", "teb"]}]}
    before, after = sweep(), make_app(component("sim", job={}), matrix={**more, "parallelism": 3})
    assert set(before.sweep) < set(after.sweep)
    assert before.spec_hashes == after.spec_hashes
    assert pod_of(before, first_instance(before)) == pod_of(after, first_instance(before))


def test_the_object_of_an_instance_has_its_values_and_no_robot() -> None:
    app = sweep()
    spec = wanted_object(app, first_instance(app))["spec"]
    assert spec["matrix"] == {"speed": "0.5", "planner": "dwb"}
    assert (spec["instance"], spec["robot"]) == (first_instance(app), "")


@pytest.mark.parametrize(
    ("part", "field", "words"),
    [
        ({"args": ["--v", "$(MATRIX_SPED)"]}, "spec.components[0].args", "MATRIX_SPEED, MATRIX_PLANNER"),
        (
            {"parameters": [{"inline": "/**: {ros__parameters: {v: $(MATRIX_PLANER)}}"}], "args": ["sim"]},
            "spec.components[0].parameters[0].inline",
            "MATRIX_PLANNER",
        ),
        (
            {"env": [{"name": "R", "valueFrom": {"configMapKeyRef": {"name": "$(ROBOTAPP_ROBOT)", "key": "k"}}}]},
            "spec.components[0].env[0].valueFrom.configMapKeyRef.name",
            "the app has none",
        ),
    ],
)
def test_what_no_instance_can_resolve_is_refused_with_the_cure(part: dict[str, Any], field: str, words: str) -> None:
    problems = problems_alone(sweep(component("sim", job={}, **part)))
    assert [problem.field for problem in problems] == [field]
    assert words in problems[0].message


def test_a_value_that_would_change_a_parameter_file_is_refused() -> None:
    matrix = {"parameters": [{"name": "goal", "values": ["a", "x: 1"]}]}
    inline = "/**: {ros__parameters: {goal: $(MATRIX_GOAL)}}"
    app = make_app(component("sim", job={}, args=["sim"], parameters=[{"inline": inline}]), matrix=matrix)
    (problem,) = problems_alone(app)
    assert "'x: 1'" in problem.message
    assert "args or env" in problem.message


def test_a_label_that_is_too_long_with_the_name_of_an_instance_is_refused() -> None:
    matrix = {"parameters": [{"name": "world", "values": ["short", "a-warehouse-with-a-very-long-name-of-its-own"]}]}
    labels = {"lab": "results-of-the-night-$(ROBOTAPP_INSTANCE)"}
    (problem,) = problems_alone(
        make_app(component("sim", job={}, template={"metadata": {"labels": labels}}), matrix=matrix)
    )
    assert problem.field == 'spec.components[0].template.metadata.labels["lab"]'
    assert "write a shorter text" in problem.message


def test_names_of_the_instance_and_variables_of_ones_own_are_accepted() -> None:
    part = component(
        "sim",
        job={},
        args=["$(MATRIX_MINE)", "$(MATRIX_SPEED)"],
        env=[{"name": "MATRIX_MINE", "value": "x"}],
        volumeMounts=[{"name": "out", "mountPath": "/out", "subPathExpr": "$(ROBOTAPP_APP)/$(ROBOTAPP_INSTANCE)"}],
        template={"spec": {"volumes": [{"name": "out", "persistentVolumeClaim": {"claimName": "results"}}]}},
    )
    assert not problems_alone(sweep(part))


def test_a_pool_that_is_too_small_for_the_parallelism_is_told_with_the_number() -> None:
    pool = msgspec.convert(
        {"metadata": {"name": "lab"}, "spec": {"ids": "1-20", "quota": {"namespaces": {"default": 3}}}}, Pool
    )
    (note,) = [note for note in notes_of(sweep(ros2={"pool": "lab"}), pool) if "parallelism" in note]
    assert "4 instances at once" in note
    assert "has 3 for namespace default" in note
    assert "write parallelism: 3" in note
    few = make_app(component("sim", job={}), matrix={**MATRIX, "parallelism": 3}, ros2={"pool": "lab"})
    assert not [note for note in notes_of(few, pool) if "parallelism" in note]
    shared = sweep(ros2={"pool": "lab", "isolation": "Discovery"})
    assert not [note for note in notes_of(shared, pool) if "parallelism" in note]
