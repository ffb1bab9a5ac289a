"""Deployments that others scaled are told from those that the operator itself changes, with the field to write."""

from typing import Any

import pytest
from tests.support.factories import VERSION, after, make_app

from robotapp_api.model.names import OPERATOR_MANAGER
from robotapp_operator.plan.diff.diff import plan, wanted_children
from robotapp_operator.plan.diff.scaled import note_scaled
from robotapp_operator.plan.render.child import Child
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import Deployment

APP = make_app(ros2={"discovery": {"mode": "Peers"}})


def wanted(app: App, *, running: bool = True) -> Child:
    children = wanted_children(desired_of(app, ""), domain=Domain(7, "c"), parameters={}, running=running)
    return next(child for child in children if child.component == "driver")


def stored(app: App, replicas: int, *, running: bool = True) -> Deployment:
    children = wanted_children(desired_of(app, ""), domain=Domain(7, "c"), parameters={}, running=running)
    found = after(plan(app, children, {}, version=VERSION, settled={}), {}, app)[wanted(app).ref]
    assert isinstance(found, Deployment)
    return Deployment(found.metadata, dict(found.spec) | {"replicas": replicas}, found.status)


def entry(manager: str, time: str = "2026-01-02T00:00:00Z", *, field: str = "f:replicas") -> dict[str, Any]:
    return {"manager": manager, "time": time, "subresource": "scale", "fieldsV1": {"f:spec": {field: {}}}}


def test_what_nobody_scaled_is_no_event() -> None:
    assert not note_scaled(APP, wanted(APP), stored(APP, 1), [entry("kubectl")])


@pytest.mark.parametrize(
    ("fields", "by"),
    [
        ([entry("kubectl"), entry("ours", "2026-01-01T00:00:00Z")], "scaled by kubectl and"),
        ([entry("kubectl", field="f:paused")], "scaled by another writer and"),
        ([entry("kube-controller-manager")], "scaled by kube-controller-manager (a HorizontalPodAutoscaler) and"),
        ([], "scaled by another writer and"),
    ],
)
def test_the_writer_and_the_field_to_change_are_named(fields: list[dict[str, Any]], by: str) -> None:
    note = note_scaled(APP, wanted(APP), stored(APP, 5), fields)
    assert by in note
    assert "set back to 1: the app decides; write spec.components[1].replicas of RobotApp teleop" in note
    assert ("delete the HorizontalPodAutoscaler" in note) == ("Autoscaler" in by)


def test_an_edit_of_the_app_is_no_scaling_by_others() -> None:
    assert not note_scaled(APP, wanted(APP, running=False), stored(APP, 1), [entry("kubectl")])


def test_what_the_operator_stopped_itself_is_no_scaling_by_others() -> None:
    assert not note_scaled(APP, wanted(APP), stored(APP, 0), [entry(OPERATOR_MANAGER)])


def test_pods_of_a_suspended_app_are_not_started_by_a_scale() -> None:
    app = make_app(ros2={"discovery": {"mode": "Peers"}}, suspend=True)
    note = note_scaled(app, wanted(app, running=False), stored(app, 1, running=False), [entry("kubectl")])
    assert note.endswith("the app is suspended; write spec.suspend: false")
