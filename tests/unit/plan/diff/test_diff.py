"""From wanted and observed children to the missing writes."""

import dataclasses
from typing import Any

import msgspec
from tests.support.factories import VERSION, after, component, make_app

from robotapp_api.model.names import Annotation, Label
from robotapp_operator.plan.diff.diff import Observed, Plan, deployment_domain, plan, wanted_children
from robotapp_operator.plan.render.child import DEPLOYMENT, SERVICE, Child
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Deployment

DOMAIN = Domain(7, "dds.default.c.7")


def wanted(app: App, *, domain: Domain | None = DOMAIN, running: bool = True) -> list[Child]:
    return wanted_children(desired_of(app, ""), domain=domain, parameters={}, running=running)


def planned(
    app: App, children: list[Child], observed: dict[ChildRef, Observed], *, version: str = VERSION, **settled: Any
) -> Plan:
    return plan(app, children, observed, version=version, settled=settled)


def settled_world(app: App) -> dict[ChildRef, Observed]:
    return after(planned(app, wanted(app), {}), {}, app)


def bent(item: Observed, **changes: Any) -> Any:
    """A copy of a Deployment with some of its plain JSON changed: paths as keywords, `__` for a dot."""
    body = msgspec.to_builtins(item) | {"spec": item.spec, "text": b""}
    for path, value in changes.items():
        *parents, last = path.split("__")
        target = body
        for parent in parents:
            target = target[int(parent)] if isinstance(target, list) else target[parent]
        target[last] = value
    return msgspec.convert(body, type(item))


def driver_of(observed: dict[ChildRef, Observed]) -> ChildRef:
    return next(ref for ref in observed if ref.kind == DEPLOYMENT and "driver" in ref.name)


def test_everything_missing_is_created_infrastructure_first() -> None:
    app = make_app()
    changes = planned(app, wanted(app), {}).changes
    assert all(change.over is None for change in changes)
    names = [change.child.ref.name.split("-")[1] for change in changes if change.child.ref.kind == DEPLOYMENT]
    assert names == ["discovery", "discovery", "operator", "driver"]


def test_nothing_is_written_when_everything_is_there() -> None:
    app = make_app()
    assert not planned(app, wanted(app), settled_world(app))


def test_without_a_domain_a_ros_2_app_gets_nothing_at_all() -> None:
    assert wanted(make_app(), domain=None) == []


def test_ros_1_needs_no_domain() -> None:
    names = {child.ref.name.rsplit("-", 1)[0] for child in wanted(make_app(ros={"distro": "noetic"}), domain=None)}
    assert names == {"teleop-master", "teleop-operator", "teleop-driver"}


def test_a_removed_component_is_deleted_with_nothing_else() -> None:
    app = make_app(component("driver"), component("eyes"), component("logger"))
    fewer = make_app(component("driver"), component("eyes"), generation=2)
    result = planned(fewer, wanted(fewer), settled_world(app))
    assert [item.metadata.name.rsplit("-", 1)[0] for item in result.deletes] == ["teleop-logger"]
    assert not result.changes


def test_another_image_changes_one_deployment() -> None:
    app = make_app()
    newer = make_app(component("operator"), component("driver", image="reg/driver:2"), generation=2)
    (change,) = planned(newer, wanted(newer), settled_world(app)).changes
    assert change.over is not None
    assert "driver" in change.child.ref.name


def test_drift_of_a_field_we_render_is_repaired() -> None:
    app = make_app()
    observed = settled_world(app)
    ref = driver_of(observed)
    observed[ref] = bent(observed[ref], spec__replicas=5)
    (change,) = planned(app, wanted(app), observed).changes
    assert change.child.ref == ref


def test_a_variable_somebody_added_is_seen_as_drift_but_only_once() -> None:
    app = make_app()
    observed = settled_world(app)
    ref = driver_of(observed)
    env = [*observed[ref].spec["template"]["spec"]["containers"][0]["env"], {"name": "X", "value": "1"}]
    observed[ref] = bent(observed[ref], spec__template__spec__containers__0__env=env)
    (change,) = planned(app, wanted(app), observed).changes
    meta = observed[ref].metadata
    settled = {meta.uid: (meta.generation, change.child.hash)}
    assert not plan(app, wanted(app), observed, version=VERSION, settled=settled)


def test_a_domain_somebody_wrote_into_another_container_is_drift_but_only_once() -> None:
    app = make_app()
    observed = settled_world(app)
    ref = driver_of(observed)
    stray = [{"name": "sidecar", "env": [{"name": "ROS_DOMAIN_ID", "value": "99"}]}]
    observed[ref] = bent(observed[ref], spec__template__spec__initContainers=stray)
    (change,) = planned(app, wanted(app), observed).changes
    meta = observed[ref].metadata
    settled = {meta.uid: (meta.generation, change.child.hash)}
    assert not plan(app, wanted(app), observed, version=VERSION, settled=settled)


def test_defaults_and_canonical_quantities_of_the_server_are_no_drift() -> None:
    app = make_app(component("driver", resources={"requests": {"cpu": "1000m", "memory": "1024Mi"}}))
    observed = settled_world(app)
    ref = driver_of(observed)
    observed[ref] = bent(
        observed[ref],
        spec__progressDeadlineSeconds=600,
        spec__template__spec__dnsPolicy="ClusterFirst",
        spec__template__spec__containers__0__resources={"requests": {"cpu": "1", "memory": "1Gi"}},
    )
    assert not planned(app, wanted(app), observed)


def test_a_field_we_no_longer_render_is_noticed_by_the_hash() -> None:
    app = make_app(component("driver", template={"spec": {"nodeSelector": {"a": "b"}}}), component("eyes"))
    plain = make_app(component("driver"), component("eyes"), generation=2)
    assert len(planned(plain, wanted(plain), settled_world(app)).changes) == 1


def test_what_somebody_else_controls_is_neither_written_nor_deleted() -> None:
    app = make_app()
    other = dataclasses.replace(app, uid="uid-2")
    theirs = settled_world(other)
    result = planned(app, wanted(app), theirs)
    assert not result
    assert len(result.foreign) == len(theirs)


def test_an_object_that_only_carries_our_label_is_never_deleted() -> None:
    app = make_app()
    orphan = msgspec.convert(
        {"metadata": {"name": "x", "uid": "u", "labels": {"robotics.io/app-uid": app.uid}}}, Deployment
    )
    assert not planned(app, [], {ChildRef(DEPLOYMENT, "x"): orphan}).deletes


def test_what_is_being_deleted_is_not_deleted_again() -> None:
    app = make_app()
    observed = settled_world(app)
    going = {ref: bent(item, metadata__deletionTimestamp="2026-01-01T00:00:00Z") for ref, item in observed.items()}
    assert not planned(app, [], going).deletes


def test_suspended_apps_keep_their_deployments_without_pods() -> None:
    app = make_app(suspend=True)
    deployments = [child for child in wanted(app, running=False) if child.ref.kind == DEPLOYMENT]
    assert deployments
    assert {child.spec["replicas"] for child in deployments} == {0}


def test_an_older_operator_leaves_a_newer_ones_template_alone() -> None:
    app = make_app()
    observed = settled_world(app)
    ref = driver_of(observed)
    newer = bent(observed[ref], spec__template__spec__enableServiceLinks=True)
    newer.metadata.annotations[Annotation.RENDERED_BY] = "1.10.0"
    observed[ref] = newer
    assert not planned(app, wanted(app), observed, version="1.9.0")
    assert planned(app, wanted(app), observed, version="1.10.0")


def held_world(**spec: Any) -> tuple[App, dict[ChildRef, Observed]]:
    """An app whose driver was rendered by an older operator with another template."""
    app = make_app(update={"operator": "OnDemand"}, **spec)
    observed = settled_world(app)
    ref = driver_of(observed)
    old = bent(observed[ref], spec__template__spec__enableServiceLinks=True)
    old.metadata.annotations.update({Annotation.RENDERED_BY: "1.0.0", Annotation.CONTENT_HASH: "old"})
    observed[ref] = old
    return app, observed


def test_on_demand_holds_what_only_a_newer_operator_would_change() -> None:
    app, observed = held_world()
    result = planned(app, wanted(app), observed)
    assert not result
    assert [(item.name.rsplit("-", 1)[0], item.ours) for item in result.held] == [("teleop-driver", VERSION)]


def test_on_demand_still_holds_a_template_after_an_edit_of_another_component() -> None:
    """The edit moves the app's generation, and a template that it does not change keeps the older one in its annotation."""
    _, observed = held_world()
    edited = make_app(
        component("operator", args=["new"]), component("driver"), update={"operator": "OnDemand"}, generation=2
    )
    result = planned(edited, wanted(edited), observed)
    assert [item.name.rsplit("-", 1)[0] for item in result.held] == ["teleop-driver"]
    assert [change.child.labels[Label.COMPONENT] for change in result.changes] == ["operator"]


def test_an_approval_of_this_version_releases_held_templates() -> None:
    app, observed = held_world(annotations={Annotation.APPROVE_UPDATE: VERSION})
    assert len(planned(app, wanted(app), observed).changes) == 1
    app, observed = held_world(annotations={Annotation.APPROVE_UPDATE: "1.1.0"})
    assert not planned(app, wanted(app), observed).changes


def test_on_demand_never_holds_the_users_own_edit_or_another_domain() -> None:
    app, observed = held_world()
    edit: dict[str, Any] = {"update": {"operator": "OnDemand"}, "generation": 2}
    for change in ({"args": ["new"]}, {"image": "reg/driver:2"}, {"replicas": 2}):
        edited = make_app(component("operator"), component("driver", **change), **edit)
        assert "driver" in [
            change.child.labels[Label.COMPONENT] for change in planned(edited, wanted(edited), observed).changes
        ]
    suspended = make_app(suspend=True, **edit)
    assert planned(suspended, wanted(suspended, running=False), observed).changes
    assert planned(app, wanted(app, domain=Domain(8, "dds.default.c.8")), observed).changes


def older_services(app: App) -> dict[ChildRef, Observed]:
    """The app as an older operator rendered it: each discovery server found by a Service of its own."""
    observed = settled_world(app)
    for ref, item in list(observed.items()):
        item.metadata.annotations.update({Annotation.RENDERED_BY: "1.0.0", Annotation.CONTENT_HASH: "old"})
        if ref.kind == SERVICE:
            for number in range(2):
                old = bent(observed[ref], metadata__name=f"teleop-discovery-{number}")
                observed[ChildRef(SERVICE, old.metadata.name)] = old
            del observed[ref]
        elif "discovery" in ref.name:
            observed[ref] = bent(item, spec__template__spec__hostname=None, spec__template__spec__subdomain=None)
        else:
            observed[ref] = bent(item, spec__template__spec__enableServiceLinks=True)
    return observed


def names_of(items: Any) -> set[str]:
    return {item.metadata.name for item in items}


def test_services_that_held_templates_may_name_stay_until_the_last_of_these_is_rendered_anew() -> None:
    app = make_app(update={"operator": "OnDemand"})
    observed = older_services(app)
    result = planned(app, wanted(app), observed)
    assert [change.child.ref.kind for change in result.changes] == [SERVICE]
    assert len(result.held) == 4
    assert not result.deletes
    approved = make_app(update={"operator": "OnDemand"}, annotations={Annotation.APPROVE_UPDATE: VERSION})
    assert names_of(planned(approved, wanted(approved), observed).deletes) == {
        "teleop-discovery-0",
        "teleop-discovery-1",
    }
    gone = planned(app, [], observed)
    assert names_of(gone.deletes) == names_of(observed.values()), "an instance that ends takes all with it"


def test_servers_at_another_address_roll_with_the_first_component_that_looks_for_them_there() -> None:
    observed = older_services(make_app(update={"operator": "OnDemand"}))
    edited = make_app(
        component("operator", args=["new"]), component("driver"), update={"operator": "OnDemand"}, generation=2
    )
    result = planned(edited, wanted(edited), observed)
    written = [change.child.ref.name.split("-")[1] for change in result.changes if change.child.ref.kind == DEPLOYMENT]
    assert written == ["discovery", "discovery", "operator"]
    assert [item.name.split("-")[1] for item in result.held] == ["driver"]
    assert not result.deletes, "the driver finds the same servers by their old names"


def test_on_demand_never_holds_back_the_gate_that_keeps_pods_off_closed_robots() -> None:
    app = make_app(update={"operator": "OnDemand"}, schedulerName="default-scheduler")
    observed = settled_world(app)
    ref = driver_of(observed)
    observed[ref] = bent(observed[ref], spec__template__spec__schedulingGates=[])
    observed[ref].metadata.annotations.update({Annotation.RENDERED_BY: "1.0.0", Annotation.CONTENT_HASH: "old"})
    (change,) = planned(app, wanted(app), observed).changes
    assert change.child.ref == ref


def test_automatic_rolls_with_the_operator() -> None:
    app, observed = held_world()
    automatic = make_app()
    assert app.spec.update.operator == "OnDemand"
    assert len(planned(automatic, wanted(automatic), observed).changes) == 1


def test_the_named_domain_is_read_from_the_template() -> None:
    app = make_app()
    observed = settled_world(app)
    found = observed[driver_of(observed)]
    assert isinstance(found, Deployment)
    assert deployment_domain(found) == 7
    assert deployment_domain(msgspec.convert({"metadata": {}}, Deployment)) is None


def test_a_single_replica_is_recreated_and_keeps_no_history() -> None:
    app = make_app(component("one"), component("two", replicas=2))
    specs = {child.ref.name.split("-")[1]: child.spec for child in wanted(app) if child.ref.kind == DEPLOYMENT}
    assert specs["one"]["strategy"] == {"type": "Recreate"}
    assert specs["two"]["strategy"] == {"type": "RollingUpdate"}
    assert {spec["revisionHistoryLimit"] for spec in specs.values()} == {0}


def test_selectors_carry_no_uid() -> None:
    for child in wanted(make_app()):
        labels = child.spec["selector"].get("matchLabels", child.spec["selector"])
        assert "robotics.io/app-uid" not in labels


def test_every_child_is_owned_and_says_who_rendered_it() -> None:
    app = make_app()
    for child in wanted(app):
        meta = child.body(app, version=VERSION)["metadata"]
        (owner,) = meta["ownerReferences"]
        assert (owner["uid"], owner["controller"], owner["blockOwnerDeletion"]) == (app.uid, True, True)
        assert meta["annotations"][Annotation.RENDERED_BY] == VERSION
        assert meta["annotations"][Annotation.APP_GENERATION] == "1"
