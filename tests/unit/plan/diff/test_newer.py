"""A rollback: version N meets templates that N+1 wrote, and the user goes on editing.

N+1 renders every template differently. What a user must be able to do at once happens in the template as N+1 wrote it;
of everything else the user is told that it waits.
"""

import dataclasses
from typing import Any, Final

import pytest
from tests.support.factories import VERSION, after, component, make_app
from tests.unit.plan.diff.test_diff import bent, planned, settled_world, wanted

from robotapp_api.model.names import WAITING_STEP, Annotation, Label
from robotapp_claims.rules.objects import ROS_DOMAIN_ID
from robotapp_operator.plan.diff.diff import Observed, Plan, deployment_domain, template_env
from robotapp_operator.plan.render.child import DEPLOYMENT, SERVICE
from robotapp_operator.plan.spec.desired import App, Domain
from robotapp_operator.plan.spec.objects import ChildRef

NEWER: Final = "1.3.0"
PARTS: Final = (component("operator"), component("driver"))


def rolled_back(app: App) -> dict[ChildRef, Observed]:
    """The app's children as a newer operator has written them: with another template, and its version on them."""
    observed = settled_world(app)
    for ref, item in observed.items():
        if ref.kind == DEPLOYMENT:
            observed[ref] = bent(item, spec__template__spec__enableServiceLinks=True)
            observed[ref].metadata.annotations[Annotation.CONTENT_HASH] = "of-a-newer-version"
        observed[ref].metadata.annotations[Annotation.RENDERED_BY] = NEWER
    return observed


def edited(*parts: dict[str, Any], **spec: Any) -> App:
    return make_app(*(parts or PARTS), generation=2, **spec)


def plan_of(app: App, observed: dict[ChildRef, Observed], **how: Any) -> Plan:
    return planned(app, wanted(app, running=not app.spec.suspend, **how), observed)


def specs(result: Plan) -> dict[str, dict[str, Any]]:
    """What is written over templates of the newer operator, by component ("" for infrastructure)."""
    assert all(change.amended is not None for change in result.changes if change.over)
    return {change.child.labels.get(Label.COMPONENT, ""): change.amended for change in result.changes if change.amended}


def main(spec: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = spec["template"]["spec"]["containers"][0]
    return found


def test_without_an_edit_nothing_is_written_and_nothing_is_reported() -> None:
    app = make_app()
    assert plan_of(app, rolled_back(app)) == Plan()


def test_suspend_takes_every_pod_away_and_leaves_the_templates_as_they_are() -> None:
    observed = rolled_back(make_app())
    result = plan_of(edited(suspend=True), observed)
    deployments = [ref for ref in observed if ref.kind == DEPLOYMENT]
    assert len(result.changes) == len(deployments)
    for change in result.changes:
        assert change.over is not None
        assert change.amended is not None
        assert change.amended["replicas"] == 0
        assert change.amended["template"] == change.over.spec["template"]
    assert result.held == ()


def test_what_the_newer_operator_wrote_for_this_very_generation_stands_but_for_a_stop() -> None:
    app = make_app()
    observed = rolled_back(app)
    ref = next(ref for ref in observed if "driver" in ref.name and ref.kind == DEPLOYMENT)
    observed[ref] = bent(observed[ref], spec__replicas=2, spec__template__spec__containers__0__image="mirror/driver:1")
    assert plan_of(app, observed) == Plan()
    stopped = planned(app, wanted(app, running=False), observed)
    assert {change.amended["replicas"] for change in stopped.changes if change.amended} == {0}


def test_an_end_of_the_suspension_brings_the_pods_back() -> None:
    observed = rolled_back(make_app())
    for ref in [ref for ref in observed if ref.kind == DEPLOYMENT]:
        observed[ref] = bent(observed[ref], spec__replicas=0)
    result = plan_of(edited(), observed)
    assert {change.amended["replicas"] for change in result.changes if change.amended} == {1}
    assert len(result.changes) == len([ref for ref in observed if ref.kind == DEPLOYMENT])
    assert result.held == ()


def test_replicas_and_image_of_a_component_act_at_once() -> None:
    app = edited(component("operator"), component("driver", image="reg/driver:2", replicas=3))
    result = plan_of(app, rolled_back(make_app()))
    (spec,) = specs(result).values()
    assert (spec["replicas"], main(spec)["image"]) == (3, "reg/driver:2")
    assert spec["template"]["spec"]["enableServiceLinks"] is True
    assert spec["strategy"] == {"type": "RollingUpdate"}
    assert result.held == ()


def test_the_waiting_step_runs_in_the_new_image_too_unless_the_newer_operator_gave_it_another() -> None:
    app = edited(component("operator"), component("driver", image="reg/driver:2"))
    observed = rolled_back(make_app())
    ref = next(ref for ref in observed if "driver" in ref.name and ref.kind == DEPLOYMENT)
    steps = [step["name"] for step in observed[ref].spec["template"]["spec"]["initContainers"]]
    assert steps == [WAITING_STEP]
    spec = specs(plan_of(app, observed))["driver"]
    assert spec["template"]["spec"]["initContainers"][0]["image"] == "reg/driver:2"
    observed[ref] = bent(observed[ref], spec__template__spec__initContainers__0__image="reg/helper:9")
    spec = specs(plan_of(app, observed))["driver"]
    assert spec["template"]["spec"]["initContainers"][0]["image"] == "reg/helper:9"


def test_infrastructure_keeps_the_number_of_servers_that_the_newer_operator_wants() -> None:
    observed = rolled_back(make_app())
    for ref in [ref for ref in observed if "discovery" in ref.name]:
        observed[ref] = bent(observed[ref], spec__replicas=2) if ref.kind == DEPLOYMENT else observed[ref]
    assert plan_of(make_app(), observed) == Plan()
    assert {
        change.amended["replicas"] for change in plan_of(edited(suspend=True), observed).changes if change.amended
    } == {0}


def test_a_domain_that_is_not_held_leaves_every_variable_of_the_template() -> None:
    app = make_app()
    result = plan_of(app, rolled_back(app), domain=Domain(8, "dds.default.c.8"))
    for spec in specs(result).values():
        assert template_env(spec).get(ROS_DOMAIN_ID, "8") == "8"
        assert spec["template"]["metadata"]["annotations"][Annotation.DOMAIN_CLAIM] == "dds.default.c.8"
    written = after_amending(rolled_back(app), result)
    assert {deployment_domain(item) for ref, item in written.items() if ref.kind == DEPLOYMENT} <= {8, None}  # type: ignore[arg-type] - by kind
    assert plan_of(app, written, domain=Domain(8, "dds.default.c.8")) == Plan()


def after_amending(observed: dict[ChildRef, Observed], result: Plan) -> dict[ChildRef, Observed]:
    return observed | {
        change.child.ref: bent(change.over, spec=change.amended)
        for change in result.changes
        if change.over is not None and change.amended is not None
    }


HELD: Final[dict[str, tuple[tuple[dict[str, Any], ...], dict[str, Any]]]] = {
    "args": ((component("operator"), component("driver", args=["new"])), {}),
    "env": ((component("operator"), component("driver", env=[{"name": "A", "value": "1"}])), {}),
    "resources": ((component("operator"), component("driver", resources={"limits": {"cpu": "2"}})), {}),
    "middleware": (PARTS, {"ros2": {"rmw": "rmw_cyclonedds_cpp"}}),
    "scheduler": (PARTS, {"schedulerName": "another"}),
}


@pytest.mark.parametrize("edit", HELD)
def test_every_other_edit_waits_and_is_reported_with_both_versions(edit: str) -> None:
    parts, spec = HELD[edit]
    result = plan_of(edited(*parts, **spec), rolled_back(make_app()))
    driver = next(item for item in result.held if "driver" in item.name)
    assert (driver.newer, driver.ours) == (NEWER, VERSION)
    assert all(change.over is None or change.amended for change in result.changes)


def test_an_edit_of_one_component_is_not_reported_for_the_others() -> None:
    result = plan_of(edited(component("operator"), component("driver", args=["new"])), rolled_back(make_app()))
    assert [item for item in result.held if "operator" in item.name] == []


def test_an_edit_that_is_taken_back_is_not_reported_any_more() -> None:
    observed = rolled_back(make_app())
    assert plan_of(edited(component("operator"), component("driver", args=["new"])), observed).held
    assert plan_of(make_app(generation=3), observed) == Plan()


def test_services_of_a_newer_operator_stay_because_its_templates_name_them() -> None:
    app = make_app()
    observed = rolled_back(app)
    service = next(item for ref, item in observed.items() if ref.kind == SERVICE)
    theirs = bent(service, metadata__name="of-a-newer-version")
    observed[ChildRef(SERVICE, "of-a-newer-version")] = theirs
    assert not plan_of(app, observed).deletes
    assert theirs in planned(app, [], observed).deletes, "an instance that ends takes all with it"


@pytest.mark.parametrize("scheduler", ["", "default-scheduler"])
def test_a_forged_version_takes_neither_the_scheduler_nor_its_gate_off_a_template(scheduler: str) -> None:
    app = make_app(**({"schedulerName": scheduler} if scheduler else {}))
    observed = rolled_back(app)
    assert plan_of(app, observed) == Plan()
    ref = next(ref for ref in observed if "driver" in ref.name and ref.kind == DEPLOYMENT)
    before = observed[ref].spec["template"]["spec"]
    observed[ref] = bent(
        observed[ref],
        spec__template__spec__schedulerName="by-hand",
        spec__template__spec__schedulingGates=[{"name": "example.org/mine"}],
    )
    (spec,) = specs(plan_of(app, observed)).values()
    pod = spec["template"]["spec"]
    assert pod["schedulerName"] == before["schedulerName"]
    assert pod["schedulingGates"] == [{"name": "example.org/mine"}, *before.get("schedulingGates", [])]


def test_removed_components_go_and_added_ones_come() -> None:
    result = plan_of(edited(component("operator"), component("camera")), rolled_back(make_app()))
    assert [item.metadata.name.rsplit("-", 1)[0] for item in result.deletes] == ["teleop-driver"]
    assert [change.child.labels[Label.COMPONENT] for change in result.changes if change.over is None] == ["camera"]


def test_an_approval_of_this_version_has_it_write_its_own_templates() -> None:
    observed = rolled_back(make_app())
    app = edited(
        component("operator"), component("driver", args=["new"]), annotations={Annotation.APPROVE_UPDATE: VERSION}
    )
    result = plan_of(app, observed)
    assert result.held == ()
    assert all(change.amended is None for change in result.changes)
    assert plan_of(app, after(result, observed, app)) == Plan()


def test_what_a_webhook_changes_back_is_written_once_and_not_for_ever() -> None:
    app = edited(component("operator"), component("driver", image="reg/driver:2"))
    observed = rolled_back(make_app())
    (change,) = plan_of(app, observed).changes
    assert change.over is not None
    mirrored = {change.over.metadata.uid: (change.over.metadata.generation, change.child.hash)}
    assert planned(app, wanted(app), observed, **mirrored).changes == ()


def test_a_template_without_the_mark_is_judged_by_its_generation() -> None:
    observed = rolled_back(make_app())
    for item in observed.values():
        item.metadata.annotations.pop(Annotation.SPEC_HASH)
    assert plan_of(make_app(), observed).held == ()
    assert plan_of(edited(component("operator"), component("driver", args=["new"])), observed).held


def test_the_mark_ignores_what_acts_anyway_and_defaults_of_newer_schemas() -> None:
    app = make_app()
    acts = edited(component("operator", image="reg/o:2"), component("driver", replicas=3), suspend=True)
    assert acts.spec_hashes == app.spec_hashes
    assert make_app(ros2={"domain": 7}).spec_hashes == make_app(ros2={}).spec_hashes
    edit = make_app(component("operator"), component("driver", args=["a"]))
    assert {name for name, mark in edit.spec_hashes.items() if mark != app.spec_hashes[name]} == {"", "driver"}
    written_out = dataclasses.replace(app, spec=app.spec.model_validate(app.spec.model_dump()))
    assert written_out.spec_hashes == app.spec_hashes
