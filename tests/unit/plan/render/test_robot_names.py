"""Pods of a robot: names of objects, labels and paths have the robot's name in them."""

from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_api.checks.spec import spec_problems
from robotapp_operator.plan.render.infrastructure import infrastructure
from robotapp_operator.plan.render.parameters import parameter_states
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import Domain, desired_of
from robotapp_operator.plan.spec.validate import name_problems

ROBOTS = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}}
R = "$(ROBOTAPP_ROBOT)"
PART = component(
    "driver",
    args=["run", R],
    env=[{"name": "A", "value": R}, {"name": "B", "valueFrom": {"configMapKeyRef": {"name": f"m-{R}", "key": R}}}],
    volumeMounts=[{"name": "data", "mountPath": "/data", "subPath": f"bags/{R}"}],
    parameters=[
        {"configMapKeyRef": {"name": f"p-{R}", "key": "base.yaml", "optional": True}},
        {"secretKeyRef": {"name": f"k-{R}", "key": "k"}},
    ],
    template={
        "metadata": {"labels": {"site": f"yard-{R}"}},
        "spec": {
            "imagePullSecrets": [{"name": f"pull-{R}"}],
            "volumes": [{"name": "data", "persistentVolumeClaim": {"claimName": f"bags-{R}"}}],
            "initContainers": [{"name": "i", "image": "i", "envFrom": [{"secretRef": {"name": f"s-{R}"}}]}],
        },
    },
)


def rendered() -> dict[str, Any]:
    app = make_app(PART, robots=ROBOTS)
    state = parameter_states(app, "amr-07", {})["driver"]
    return pod_template(app.spec.components[0], desired_of(app, "amr-07"), domain=Domain(7), state=state)


def test_what_the_kubelet_does_not_expand_is_expanded_and_the_rest_is_left_to_it() -> None:
    template = rendered()
    spec = template["spec"]
    (container,) = spec["containers"]
    assert template["metadata"]["labels"]["site"] == "yard-amr-07"
    assert spec["imagePullSecrets"] == [{"name": "pull-amr-07"}]
    assert spec["volumes"][0] == {"name": "data", "persistentVolumeClaim": {"claimName": "bags-amr-07"}}
    assert spec["volumes"][1]["projected"]["sources"][0]["secret"]["name"] == "k-amr-07"
    assert spec["initContainers"][-1]["envFrom"] == [{"secretRef": {"name": "s-amr-07"}}]
    assert container["volumeMounts"][0]["subPath"] == "bags/amr-07"
    assert container["args"][:2] == ["run", R]
    own = {item["name"]: item for item in container["env"]}
    assert own["A"]["value"] == R
    assert own["B"]["valueFrom"]["configMapKeyRef"] == {"name": "m-amr-07", "key": "amr-07"}


def test_helper_pods_pull_with_the_secret_of_their_robot() -> None:
    app = make_app(PART, PART | {"name": "mapper"}, robots=ROBOTS)
    pods = [
        child.spec["template"]
        for child in infrastructure(desired_of(app, "amr-07"), running=True)
        if "template" in child.spec
    ]
    assert pods
    assert all(pod["spec"]["imagePullSecrets"] == [{"name": "pull-amr-07"}] for pod in pods)
    assert all(pod["metadata"]["labels"]["site"] == "yard-amr-07" for pod in pods)


@pytest.mark.parametrize("helper", ["ros2", "ros1"])
@pytest.mark.parametrize(
    ("template", "field"),
    [
        ({"metadata": {"labels": {"site": R}}}, 'metadata.labels["site"]'),
        ({"spec": {"imagePullSecrets": [{"name": f"pull-{R}"}]}}, "spec.imagePullSecrets[0].name"),
    ],
)
def test_helpers_of_an_app_without_robots_name_none(helper: str, template: dict[str, Any], field: str) -> None:
    """Their labels would be empty, and the pull secret one that nobody has."""
    fields: dict[str, Any] = {"ros1": {"template": template}, "ros": {"distro": "noetic"}}
    if helper == "ros2":
        fields = {"ros2": {"discovery": {"template": template}}}
    (problem,) = spec_problems(make_app(**fields).spec)
    assert problem.field.endswith(f".template.{field}")
    assert "the app has none" in problem.message
    assert not [*spec_problems(make_app(robots=ROBOTS, **fields).spec)]


def test_a_name_of_a_robot_that_no_object_may_have_is_named_for_helpers_too() -> None:
    template = {"spec": {"imagePullSecrets": [{"name": f"pull-{R}"}]}}
    for robot, problems in (("amr-07", 0), ("AMR_07", 1)):
        selector = {"nodeSelector": {"matchLabels": {"robotics.io/robot": robot}}}
        app = make_app(robots=selector, ros2={"discovery": {"template": template}})
        found = name_problems(app, [robot])
        assert [text.partition(": ")[0] for text in found.values()] == problems * [
            "spec.ros2.discovery.template.spec.imagePullSecrets[0].name"
        ]
