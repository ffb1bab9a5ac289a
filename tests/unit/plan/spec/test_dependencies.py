"""dependsOn: which components start, which wait, and circles that never would."""

from typing import Final

import msgspec
import pytest
from tests.support.factories import UID, component, make_app

from robotapp_api.checks.spec import find_circle, spec_problems
from robotapp_api.model.names import Label
from robotapp_operator.plan.diff.diff import Observed, wanted_children
from robotapp_operator.plan.render.child import DEPLOYMENT
from robotapp_operator.plan.spec.dependencies import describe_wait, unmet_dependencies
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment


def after(*names: str) -> list[dict[str, str]]:
    return [{"component": name} for name in names]


APP: Final = make_app(
    component("driver"),
    component("mapper", dependsOn=after("driver")),
    component("planner", dependsOn=after("driver", "mapper")),
)


def deployment(name: str, *, replicas: int = 1, ready: bool = True, owner: str = UID) -> Deployment:
    body = {
        "metadata": {
            "name": name,
            "uid": f"{name}-uid",
            "generation": 1,
            "labels": {Label.COMPONENT: name, Label.APP_UID: owner},
            "ownerReferences": [{"kind": "RobotApp", "name": "teleop", "uid": owner, "controller": True}],
        },
        "spec": {"replicas": replicas},
        "status": {
            "observedGeneration": 1,
            "replicas": replicas,
            "updatedReplicas": replicas,
            "readyReplicas": replicas if ready else 0,
        },
    }
    return msgspec.convert(body, Deployment)


def children(app: App, *items: Deployment) -> dict[str, int]:
    """Replicas of the components' Deployments that should be there."""
    observed: dict[ChildRef, Observed] = {
        ChildRef(DEPLOYMENT, desired_of(app, "").name_of(item.metadata.name)): item for item in items
    }
    wanted = wanted_children(desired_of(app, ""), domain=Domain(7), parameters={}, running=True, observed=observed)
    return {
        child.component: child.spec["replicas"] for child in wanted if child.component and child.ref.kind == DEPLOYMENT
    }


def test_a_component_is_created_when_those_it_depends_on_are_ready() -> None:
    assert children(APP) == {"driver": 1}
    assert children(APP, deployment("driver", ready=False)) == {"driver": 1}
    assert children(APP, deployment("driver")) == {"driver": 1, "mapper": 1}
    assert children(APP, deployment("driver"), deployment("mapper")) == {"driver": 1, "mapper": 1, "planner": 1}


def test_what_runs_goes_on_when_a_dependency_is_no_longer_ready() -> None:
    items = (deployment("driver", ready=False), deployment("mapper"), deployment("planner", ready=False))
    assert children(APP, *items) == {"driver": 1, "mapper": 1, "planner": 1}


def test_what_was_stopped_starts_in_order_again() -> None:
    stopped = (deployment("driver", replicas=0), deployment("mapper", replicas=0))
    assert children(APP, *stopped) == {"driver": 1, "mapper": 0}
    assert children(APP, deployment("driver"), stopped[1]) == {"driver": 1, "mapper": 1}


def test_a_deployment_of_somebody_else_is_no_dependency() -> None:
    assert unmet_dependencies(APP, [deployment("driver", owner="other")]) == unmet_dependencies(APP, [])


def test_the_wait_names_all_it_is_for_and_which_of_them_are_suspended() -> None:
    assert describe_wait(APP, ("driver",)) == "waits until driver is Ready (dependsOn)"
    assert describe_wait(APP, ("driver", "mapper")) == "waits until driver and mapper are Ready (dependsOn)"
    app = make_app(component("driver", replicas=0), component("mapper", dependsOn=after("driver")))
    assert describe_wait(app, ("driver",)) == "waits until driver (suspended by replicas: 0) is Ready (dependsOn)"


@pytest.mark.parametrize(
    ("dependencies", "circle"),
    [
        ({}, []),
        ({"a": ["b", "c"], "b": ["c"], "c": []}, []),
        ({"a": ["b"], "b": ["a"]}, ["a", "b"]),
        ({"a": ["b"], "b": ["c"], "c": ["d"], "d": ["b"]}, ["b", "c", "d"]),
        ({"a": ["x"]}, []),
    ],
)
def test_circles(dependencies: dict[str, list[str]], circle: list[str]) -> None:
    assert find_circle(dependencies) == circle


def test_a_circle_is_refused_with_the_names_in_it() -> None:
    app = make_app(component("a"), component("b", dependsOn=after("c")), component("c", dependsOn=after("b", "a")))
    (problem,) = spec_problems(app.spec)
    assert problem.field == "spec.components[1].dependsOn"
    assert problem.message.startswith("b waits for c waits for b, so none of them would ever be created")


def test_a_dependency_that_is_no_component_is_refused() -> None:
    (problem,) = spec_problems(make_app(component("a", dependsOn=after("x"))).spec)
    assert problem.message == '"x" is no component of this app; components are a'
